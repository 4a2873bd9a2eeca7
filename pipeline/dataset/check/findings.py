"""The findings of a check: all are counted, a readable number is kept and shown."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from ...errors import InputError, RunError, printable

SHOWN, SHOWN_OF_A_KIND = 20, 5
LONGEST = 500
"""Characters of a message: a damaged file can put anything in it."""


@dataclass
class Findings:
    """Messages about what is wrong, by kind, in the order of their arrival: the first ones, and how many there are.

    Paths are relative to ``root``: findings that are passed on tell nothing of this computer.
    """

    root: Path | None = None
    first: dict[str, list[str]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, kind: str, message: object) -> None:
        """Add a finding; ``kind`` is a short plural such as ``"damaged files"``."""
        self.counts[kind] = self.counts.get(kind, 0) + 1
        kept = self.first.setdefault(kind, [])
        if len(kept) < SHOWN:
            text = str(message).replace(f"{self.root}/", "")
            kept.append(printable(text if len(text) <= LONGEST else text[: LONGEST - 3] + "...", kept=""))

    @contextmanager
    def collecting(self, kind: str) -> Iterator[None]:
        """Turn the InputError or RunError that ends the block into a finding."""
        try:
            yield
        except (InputError, RunError) as error:
            self.add(kind, error)

    def __len__(self) -> int:
        return sum(self.counts.values())

    def shown(self) -> list[str]:
        """At most about :data:`SHOWN` lines: some findings of each kind, then how many more there are."""
        each = SHOWN_OF_A_KIND if len(self.first) > 1 else SHOWN
        if len(self) <= SHOWN:
            each = SHOWN
        while each > 1 and sum(min(len(messages), each) for messages in self.first.values()) > SHOWN:
            each -= 1
        lines = []
        for kind, messages in self.first.items():
            lines += messages[:each]
            more = self.counts[kind] - min(len(messages), each)
            if more:
                lines.append(f"... and {more} more {kind}")
        return lines
