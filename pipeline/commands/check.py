"""The command ``oneframe check``."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ..errors import InputError
from .parser import command_parser, explained_imports

EXIT_WRONG = 1

ABOUT = "Check whether a dataset is complete and consistent: files, hashes, tables, images, and poses against pixels."
"""The first sentence of its help, not a docstring: ``python -OO`` drops these."""
EPILOG = """examples:
  %(prog)s dataset
  %(prog)s dataset --views 0            (the pixels of every view)
  %(prog)s dataset --views 20 --fast    (a quick look)

Exit code: 0 complete and consistent; 1 something is wrong; 2 not a dataset, or wrong arguments.

To repair a dataset, delete the records frame/NNNNNN.json of the affected views and run the command that rendered it
again: it renders these views and writes all tables again.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    with explained_imports():
        from ..dataset.check.check_dataset import DEFAULT_VIEWS
    parser.add_argument("dataset", metavar="DIR", type=Path, help="folder of the dataset")
    effort = parser.add_argument_group("effort")
    effort.add_argument(
        "--views", metavar="N", type=int, default=DEFAULT_VIEWS,
        help="compare the pixels of N evenly spaced views, 0 for all (default %(default)s)",
    )  # fmt: skip
    effort.add_argument("--fast", action="store_true", help="skip the hashes of the files")


def main(argv: Sequence[str], prog: str = "oneframe check") -> int:
    """Parse the arguments and run."""
    arguments = command_parser(prog, ABOUT, EPILOG, add_arguments).parse(argv)
    if arguments.views < 0:
        raise InputError(f"command line: --views: expected a number of views or 0 for all, found {arguments.views}")
    return run(arguments)


def run(arguments: argparse.Namespace) -> int:
    """Check the dataset and report the findings."""
    with explained_imports():
        from ..dataset.check.check_dataset import check_dataset
    report = check_dataset(arguments.dataset, views=arguments.views, hashes=not arguments.fast, stream=sys.stdout)
    for line in (*report.findings.shown(), report.summary()):
        sys.stdout.write(line + "\n")
    return EXIT_WRONG if report.findings else 0
