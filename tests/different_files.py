"""Which files of two folders differ, by name: pytest would spend minutes on the difference of their bytes."""

from pathlib import Path


def different_files(one: Path, other: Path) -> list[str]:
    """Names relative to the folders, of files that only one has or whose bytes differ."""
    contents = [
        {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}
        for root in (one, other)
    ]
    return sorted(name for name in {*contents[0], *contents[1]} if contents[0].get(name) != contents[1].get(name))
