"""Reading a folder that nobody vouches for: regular files only, never more than can be right, never waiting.

A file of a dataset may be a pipe, a device, a link to itself, or of any size. Each of these is a
:class:`DamagedFile`, found before anything is read.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ...files.content import regular_file

LARGEST_SMALL_FILE = 1 << 20
"""Bytes of a JSON file that does not grow with the number of views."""
ROTATION_TOLERANCE = 1e-9
_BLOCK = 1 << 20


class DamagedFile(ValueError):
    """A file of a dataset is missing or does not hold what it should; the message names the file."""


@contextmanager
def opened(root: Path, name: str) -> Iterator[tuple[BinaryIO, int]]:
    """Open the file ``name`` in ``root``; gives the stream and the size in bytes.

    Raises
    ------
    DamagedFile
        Missing, not a regular file, or unreadable, also while the block reads it.
    """
    try:
        with open(root / name, "rb", opener=regular_file) as stream:
            yield stream, os.fstat(stream.fileno()).st_size
    except OSError as error:
        raise DamagedFile(f"{name}: cannot read the file ({error.strerror or error})") from None


def read_bytes(root: Path, name: str, most: int) -> bytes:
    """Read a file of at most ``most`` bytes.

    Raises
    ------
    DamagedFile
        As :func:`opened`; or the file is empty or longer.
    """
    with opened(root, name) as (stream, size):
        if not 0 < size <= most:
            found = f"{size} bytes" if size else "an empty file"
            raise DamagedFile(f"{name}: expected a file of at most {most} bytes, found {found}")
        data = stream.read(size + 1)
    if len(data) != size:
        raise DamagedFile(f"{name}: expected {size} bytes, found {len(data)}: the file is changing")
    return data


def hash_of(root: Path, name: str, size: int) -> str | None:
    """SHA-256 of a file, or ``None`` if it does not have ``size`` bytes; then it is not read.

    Raises
    ------
    DamagedFile
        As :func:`opened`.
    """
    digest = hashlib.sha256()
    with opened(root, name) as (stream, found):
        if found != size:
            return None
        left = size
        while left and (block := stream.read(min(_BLOCK, left))):
            digest.update(block)
            left -= len(block)
    return digest.hexdigest()


def read_object(root: Path, name: str, most: int = LARGEST_SMALL_FILE) -> dict[str, Any]:
    """Read the object in a JSON file of at most ``most`` bytes.

    Raises
    ------
    DamagedFile
        As :func:`read_bytes`; or not JSON, not an object, or an object with a key twice.
    """
    return parsed_object(read_bytes(root, name, most), name)


def parsed_object(data: bytes, name: str) -> dict[str, Any]:
    """Parse the object in a JSON text; :class:`DamagedFile` if there is none."""
    content = _parsed(data, name)
    if not isinstance(content, dict):
        raise DamagedFile(f"{name}: expected an object, found {shortened(content)}")
    return content


def read_list(root: Path, name: str, most: int) -> list[Any]:
    """The same for a file that holds a list."""
    content = _parsed(read_bytes(root, name, most), name)
    if not isinstance(content, list):
        raise DamagedFile(f"{name}: expected a list, found {shortened(content)}")
    return content


def _parsed(data: bytes, name: str) -> Any:
    """Parse JSON; strict: UTF-8, numbers that JSON has, no key twice."""
    try:
        return json.loads(data.decode(), object_pairs_hook=_different_keys, parse_constant=_no_constant)
    except RecursionError:
        raise DamagedFile(f"{name}: expected JSON, found brackets nested too deeply") from None
    except ValueError as error:
        raise DamagedFile(f"{name}: expected JSON, found a mistake: {error}") from None


def _different_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) != len(pairs):
        # readers disagree about which one counts
        raise ValueError(f"an object has a key twice, among {shortened([key for key, _ in pairs])}")
    return content


def _no_constant(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")


def mapping(content: Mapping, key: str, where: str) -> dict[str, Any]:
    """The object at a key of an object; :class:`DamagedFile` if there is none."""
    value = content.get(key)
    if not isinstance(value, dict):
        raise DamagedFile(f"{where}: expected {key} with entries, found {shortened(value)}")
    return value


def numbers(content: Mapping, key: str, shape: tuple[int, ...] | None, where: str) -> np.ndarray:
    """The finite numbers of a shape (``None``: any list) at a key of an object; :class:`DamagedFile` if not there."""
    try:
        # texts and integers beyond 64 bits give other kinds
        values = np.array(content[key])
    except (KeyError, ValueError):
        values = np.array("")
    values = values.astype(np.float64) if values.dtype.kind in "iuf" else np.array(np.nan)
    fits = values.ndim == 1 if shape is None else values.shape == shape
    if not fits or not np.isfinite(values).all():
        meant = (
            "a list of numbers" if shape is None else " x ".join(map(str, shape)) + " numbers" if shape else "a number"
        )
        raise DamagedFile(f"{where}: expected {key} to be {meant}, found {shortened(content.get(key))}")
    return values


def whole_number(content: Mapping, key: str, where: str, *, least: int = 0, most: int = 2**53) -> int:
    """The whole number at a key of an object; :class:`DamagedFile` if there is none."""
    value = content.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        limits = f"from {least}" if most == 2**53 else f"from {least} to {most}"
        raise DamagedFile(f"{where}: expected {key} to be a whole number {limits}, found {shortened(value)}")
    return value


def require_keys(content: Mapping, expected: set[str], where: str) -> None:
    """Check that an object has exactly these keys; :class:`DamagedFile` if not."""
    missing, unknown = expected - content.keys(), content.keys() - expected
    if missing or unknown:
        problems = [
            f"{what} {shortened(sorted(keys))}"
            for what, keys in (("missing", missing), ("unknown", unknown)) if keys
        ]  # fmt: skip
        raise DamagedFile(f"{where}: expected other keys: {', '.join(problems)}")


def check_rotation(rotation: np.ndarray, where: str) -> None:
    """Check that a ``(3, 3)`` matrix is orthonormal with determinant 1; :class:`DamagedFile` if not."""
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if not deviation <= ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise DamagedFile(
            f"{where}: expected a rotation, found a matrix off by {deviation:.2g} with determinant "
            f"{np.linalg.det(rotation):.6g}"
        )


def shortened(value: object) -> str:
    """A value as JSON of at most 60 characters, for messages."""
    try:
        text = json.dumps(value, default=str)
    except (RecursionError, ValueError):
        return "a value that is too long to show"
    return text if len(text) <= 60 else text[:57] + "..."
