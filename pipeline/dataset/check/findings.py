"""What a check found wrong: all of it counted, a readable number of sentences shown."""

from dataclasses import dataclass, field

SHOWN, SHOWN_OF_A_KIND = 20, 5


@dataclass
class Findings:
    """Sentences about what is wrong, by kind, in the order of their arrival."""

    by_kind: dict[str, list[str]] = field(default_factory=dict)

    def add(self, kind: str, sentence: object) -> None:
        """One more; ``kind`` is a short plural such as ``"damaged files"``."""
        self.by_kind.setdefault(kind, []).append(str(sentence))

    def __len__(self) -> int:
        return sum(map(len, self.by_kind.values()))

    @property
    def sentences(self) -> list[str]:
        """All of them."""
        return [sentence for sentences in self.by_kind.values() for sentence in sentences]

    def shown(self) -> list[str]:
        """At most about :data:`SHOWN` lines: some of every kind, then how many more there are of it."""
        each = SHOWN_OF_A_KIND if len(self.by_kind) > 1 else SHOWN
        if len(self) <= SHOWN:
            each = SHOWN
        while each > 1 and sum(min(len(sentences), each) for sentences in self.by_kind.values()) > SHOWN:
            each -= 1
        lines = []
        for kind, sentences in self.by_kind.items():
            lines += sentences[:each]
            if len(sentences) > each:
                lines.append(f"... and {len(sentences) - each} more {kind}")
        return lines
