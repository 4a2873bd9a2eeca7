"""Arguments of commands, read before Blender loads: a mistake in them is reported at once."""

import argparse
import itertools
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from ..errors import InputError, RunError
from ..files.keys import nearest_name

PACKAGES = {
    "bpy": "Blender (bpy), which needs Python 3.11 or 3.13",
    "cv2": "OpenCV",
    "scipy": "SciPy",
    "skimage": "scikit-image",
}
"""Modules that pip installs -> their names in messages."""


class ArgumentParser(argparse.ArgumentParser):
    """Raises :class:`.InputError` for mistakes in the arguments; does not accept abbreviated options."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message: str) -> NoReturn:
        """Raise argparse's message as an :class:`.InputError`."""
        raise InputError(f"command line: {message}; --help shows all options")

    def parse(self, argv: Sequence[str]) -> argparse.Namespace:
        """Parse all arguments."""
        # before argparse, which would only report the option that the user misspelt as missing
        self._check_names(itertools.takewhile(lambda argument: argument != "--", argv))
        arguments, unknown = self.parse_known_args(argv)
        self._check_names(unknown)
        if unknown:
            raise InputError(f"command line: unknown argument {unknown[0]!r}; --help shows all options")
        return arguments

    def _check_names(self, arguments: Iterable[str]) -> None:
        known = tuple(option for action in self._actions for option in action.option_strings)
        for argument in arguments:
            name = argument.partition("=")[0]
            if name.startswith("--") and " " not in name and name not in known:
                raise InputError(f"command line: unknown argument {name!r}; {nearest_name(name, known)}")


def at_least(least: float, kind: Callable[[str], float] = int) -> Callable[[str], float]:
    """The ``type`` of an argument that is a finite number of a kind, and not below another."""

    def number(text: str) -> float:
        value = kind(text)
        if not max(least, -(2**63)) <= value < 2**63:
            expected = f"{least:g} or more" if value < least else "a finite number below 2^63"
            raise argparse.ArgumentTypeError(f"expected {expected}, found {text}")
        return value

    return number


@contextmanager
def explained_imports() -> Iterator[None]:
    """Wrap imports of Blender, numpy and packages that a stock Blender lacks, so that what fails is a clear error."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name in ("dask", "distributed"):
            raise RunError(
                f"--cluster: expected Dask, this Python ({sys.executable}) has none: pip install distributed"
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


@contextmanager
def resumable() -> Iterator[None]:
    """Say in the message of an interruption how to go on; also a decorator."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt("stopped; run the same command again to continue") from None
