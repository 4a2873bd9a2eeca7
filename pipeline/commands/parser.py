"""What all commands share: filling their parsers, and the error for a missing package."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..errors import RunError
from ..process.command_line import ArgumentParser

PACKAGES = {
    "bpy": "Blender (bpy), which needs Python 3.11 or 3.13",
    "cv2": "OpenCV",
    "scipy": "SciPy",
    "skimage": "scikit-image",
    "shtab": "shtab",
}
"""Modules that pip installs -> their names in messages."""
DASK = "distributed dask-jobqueue cryptography"
"""What --cluster needs, for pip."""
INSECURE = (
    "with --cluster ADDRESS: take a scheduler on another machine without TLS, though everybody in its network can run "
    "programs as you"
)
"""Help of ``--insecure``."""


def command_parser(
    prog: str, about: str, epilog: str, add_arguments: Callable[[argparse.ArgumentParser], None]
) -> ArgumentParser:
    """The parser of one command.

    Parameters
    ----------
    prog
        How the user calls it.
    about
        The description: one sentence.
    epilog
        Examples and notes at the end of ``--help``; ``%(prog)s`` stands for ``prog``.
    add_arguments
        Adds the arguments of the command.
    """
    parser = ArgumentParser(prog=prog)
    fill_parser(parser, about, epilog, add_arguments)
    return parser


def fill_parser(
    parser: argparse.ArgumentParser,
    about: str,
    epilog: str,
    add_arguments: Callable[[argparse.ArgumentParser], None],
) -> None:
    """Set the description and the epilog of a parser and add its arguments; see :func:`command_parser`."""
    parser.description = about
    parser.epilog = epilog
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    add_arguments(parser)


@contextmanager
def explained_imports() -> Iterator[None]:
    """Wrap imports of Blender, numpy and packages that a stock Blender lacks, so that what fails is a clear error.

    Raises
    ------
    RunError
        A package is missing, e.g. OpenCV in a Blender program without the extension.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name in ("dask", "distributed", "dask_jobqueue"):
            raise RunError(
                f"--cluster: expected Dask, this Python ({sys.executable}) has none; install it: pip install {DASK}"
            ) from None
        if (error.name or "").endswith(".cluster"):
            raise RunError(
                "--cluster: expected OneFrame as a package, found the extension, which may use no network; install it "
                'from its folder: pip install ".[cluster]"'
            ) from None
        if error.name not in PACKAGES:
            raise
        raise RunError(
            f"expected {PACKAGES[error.name]}, this Python has none; install OneFrame with pip in a separate Python, "
            "or, for OpenCV, use a Blender in which the OneFrame extension is enabled"
        ) from None
