"""The findings of a check: all are counted, a readable number is shown."""

from dataclasses import dataclass, field

SHOWN, SHOWN_OF_A_KIND = 20, 5


@dataclass
class Findings:
    """Messages about what is wrong, by kind, in the order of their arrival."""

    by_kind: dict[str, list[str]] = field(default_factory=dict)

    def add(self, kind: str, message: object) -> None:
        """Add a finding; ``kind`` is a short plural such as ``"damaged files"``."""
        self.by_kind.setdefault(kind, []).append(str(message))

    def __len__(self) -> int:
        return sum(map(len, self.by_kind.values()))

    @property
    def messages(self) -> list[str]:
        """The messages of all kinds."""
        return [message for messages in self.by_kind.values() for message in messages]

    def shown(self) -> list[str]:
        """At most about :data:`SHOWN` lines: some findings of each kind, then how many more there are."""
        each = SHOWN_OF_A_KIND if len(self.by_kind) > 1 else SHOWN
        if len(self) <= SHOWN:
            each = SHOWN
        while each > 1 and sum(min(len(messages), each) for messages in self.by_kind.values()) > SHOWN:
            each -= 1
        lines = []
        for kind, messages in self.by_kind.items():
            lines += messages[:each]
            if len(messages) > each:
                lines.append(f"... and {len(messages) - each} more {kind}")
        return lines
