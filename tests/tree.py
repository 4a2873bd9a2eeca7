"""The files of a folder and their bytes, and which of two folders' differ."""

import re
from pathlib import Path

VIDEO = "video/trajectory.mp4"
VIDEO_SUM = re.compile(rb'"video/trajectory.mp4": \{[^}]*\}')


def tree(folder: Path) -> dict[str, bytes]:
    """Bytes by name relative to the folder, but those of a dataset's video: the same frames have several encodings.

    Under load, Blender's H.264 encoder now and then chooses otherwise than before.
    """
    files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    if VIDEO in files:
        files[VIDEO] = b"video"
        if "checksums.json" in files:
            files["checksums.json"] = VIDEO_SUM.sub(b"", files["checksums.json"])
    return files


def different_files(one: Path, other: Path) -> list[str]:
    """Names of files that only one has or whose bytes differ; pytest would spend minutes on the bytes themselves."""
    contents = [tree(one), tree(other)]
    return sorted(name for name in {*contents[0], *contents[1]} if contents[0].get(name) != contents[1].get(name))
