"""The command ``oneframe check``."""

import sys
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..process.command import option, positional, switch

EXIT_WRONG = 1

ABOUT = "Check whether a dataset is complete and consistent: files, hashes, tables, images, and poses against pixels."
EPILOG = """examples:
  %(prog)s dataset
  %(prog)s dataset --views 0            (the pixels of every view)
  %(prog)s dataset --views 20 --fast    (a quick look)
  %(prog)s dataset --case case.toml

Exit code: 0 complete and consistent; 1 something is wrong; 2 not a dataset, or wrong arguments.

To repair a dataset, run the command that rendered it again, with --verify: it renders the affected views and writes all
tables again.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    dataset: Path = positional("DIR", "folder of the dataset")
    views: int = option(
        "N", "compare the pixels of N evenly spaced views, 0 for all (default %(default)s)", 200, least=0
    )  # fmt: skip
    fast: bool = switch("skip the hashes of the files")
    case: Path | None = option("CASE.toml", "compare the inputs with those of the case that was rendered")
    poses: Path | None = option("FILE", "the listed poses of the views, if the case does not name them")


def run(arguments: Arguments) -> int:
    """Check the dataset and report the findings."""
    if arguments.poses is not None and arguments.case is None:
        raise InputError("command line: --poses: expected also the case that was rendered; give it with --case")
    from ..case.case_file import read_case
    from ..dataset.check.check_dataset import check_dataset
    from ..dataset.layout import datasets_in

    case = None if arguments.case is None else read_case(arguments.case)
    wrong, output = 0, sys.stdout
    for folder in datasets_in(arguments.dataset):
        if folder != arguments.dataset:
            output.write(f"{folder}:\n")
        report = check_dataset(
            folder, views=arguments.views, hashes=not arguments.fast, case=case, poses=arguments.poses, stream=output
        )
        output.writelines(f"{line}\n" for line in (*report.findings.shown(), report.summary()))
        wrong += len(report.findings)
    return EXIT_WRONG if wrong else 0
