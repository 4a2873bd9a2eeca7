"""The decorator of the loops that numba compiles; without numba they run as they are: right, and very slowly."""

from collections.abc import Callable
from typing import Any, TypeVar

from ..errors import InputError

try:
    import numba
except ImportError:
    numba = None  # type: ignore[assignment]

Loop = TypeVar("Loop", bound=Callable[..., Any])


def compiled(loop: Loop) -> Loop:
    """A function of arrays and numbers, compiled at its first call for any input of these types.

    The code is kept beside the source, or in the user's cache where that folder cannot be written (``NUMBA_CACHE_DIR``
    names another), and compiled anew where neither can. Nothing is fused or reordered: every machine rounds alike.
    """
    if numba is None:
        return loop
    try:
        return numba.njit(loop, nogil=True, cache=True)  # type: ignore[return-value]
    except RuntimeError:
        # no folder for a cache
        return numba.njit(loop, nogil=True)  # type: ignore[return-value]


def require_compiler() -> None:
    """Check that loops are compiled."""
    if numba is None:
        raise InputError(
            "--engine raster: expected the package numba in this Python, found none; install it (pip install numba), "
            "use a Blender in which the OneFrame extension is enabled, or use --engine cycles"
        )
