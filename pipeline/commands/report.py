"""The command ``oneframe report``."""

import argparse
import sys
from pathlib import Path

from ..errors import InputError
from ..process.arguments import at_least

DEFAULT_VIEWS = 1000
"""As many as a page of 20 MB shows well."""

ABOUT = "Make one HTML page of a dataset or an evaluation, to look at in any browser, without a network."
EPILOG = """examples:
  %(prog)s dataset --out report.html
  %(prog)s dataset --out report.html --case aligned.toml
  %(prog)s dataset --out report.html --views 200 --no-check
  %(prog)s evaluation --out evaluation.html

DIR is a folder of oneframe render or of an evaluation. The page of a dataset shows its views with masks and depth,
their poses, distributions, what oneframe check finds, and provenance. It stays below 20 MB up to 1000 views.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of the dataset or the evaluation")
    dataset = parser.add_argument_group("dataset")
    dataset.add_argument(
        "--views", metavar="N", type=at_least(0), default=DEFAULT_VIEWS,
        help="show N evenly spaced views, 0 for all (default %(default)s)",
    )  # fmt: skip
    dataset.add_argument(
        "--no-check", action="store_true", help="skip the check, which reads every file of the dataset"
    )
    dataset.add_argument(
        "--case", metavar="CASE.toml", type=Path, help="also show the frame of the case that was rendered"
    )
    output = parser.add_argument_group("output")
    output.add_argument("--out", metavar="FILE", type=Path, required=True, help="HTML page to write")


def run(arguments: argparse.Namespace) -> None:
    """Write the page and report its size."""
    from ..case.case_file import read_case
    from ..dataset.layout import RECORD, advice_without_record, check_no_pack
    from ..evaluation.record.evaluation_record import EVALUATION
    from ..files.outputs import check_outputs, write_output

    root, out = arguments.folder, arguments.out
    check_no_pack(root)
    is_evaluation = (root / EVALUATION).is_file()
    if not is_evaluation and not (root / RECORD).is_file():
        raise InputError(
            f"{root}: expected the folder of a dataset or of an evaluation, found neither {RECORD} nor {EVALUATION} in "
            f"it; {advice_without_record(root)}"
        )
    case = None if arguments.case is None or is_evaluation else read_case(arguments.case)
    inputs = {"description": root / (EVALUATION if is_evaluation else RECORD)}
    check_outputs([out], inputs if case is None else inputs | case.input_files())
    if root.resolve() in out.resolve().parents:
        kind = "evaluation" if is_evaluation else "dataset"
        raise InputError(
            f"{out}: expected a file outside the folder of the {kind}, whose own files it shows; choose another place"
        )
    if is_evaluation:
        from ..report.evaluation_page import evaluation_page

        content = evaluation_page(root)
    else:
        from ..dataset.check.check_dataset import check_dataset
        from ..report.dataset_page import dataset_page

        check = None if arguments.no_check else check_dataset(root, stream=sys.stdout)
        content = dataset_page(root, views=arguments.views, check=check, case=case, stream=sys.stdout)
    write_output(out, content)
    sys.stdout.write(f"page of {len(content) / 1e6:.1f} MB: {out}\n")
