"""What goes wrong where a pack is written, as sentences."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import RunError


@contextmanager
def writing_pack(path: Path) -> Iterator[None]:
    """Turn an OSError inside the block, which writes a file of a pack and nothing else, into a sentence.

    Raises
    ------
    RunError
        The file or its folder cannot be written.
    """
    try:
        yield
    except OSError as error:
        safe = "the shards packed so far are safe"
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise RunError(
                f"{path.parent}: the disk is full; {safe}: free space and run the same command again"
            ) from None
        raise RunError(
            f"{path}: cannot write the file ({error.strerror}); {safe}: correct this and run the same command again"
        ) from None
