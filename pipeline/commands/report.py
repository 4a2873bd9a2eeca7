"""The command ``oneframe report``."""

import sys
from dataclasses import MISSING, dataclass
from pathlib import Path

from ..errors import InputError
from ..process.command import option, positional, switch

DEFAULT_VIEWS = 1000
"""As many as a page of 20 MB shows well."""

ABOUT = "Make one HTML page of a dataset, to look at in any browser, without a network."
EPILOG = """examples:
  %(prog)s dataset --out report.html
  %(prog)s dataset --out report.html --views 200 --no-check

The page shows views with their truths, what oneframe check finds, and provenance; below 20 MB up to 1000 views.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    folder: Path = positional("DIR", "folder of the dataset")
    views: int = option("N", "show N evenly spaced views, 0 for all (default %(default)s)", DEFAULT_VIEWS, least=0)
    no_check: bool = switch("skip the check, which reads every file of the dataset")
    out: Path = option("FILE", "HTML page to write", MISSING)


def run(arguments: Arguments) -> None:
    """Write the page and report its size."""
    from ..dataset.check.check_dataset import check_dataset
    from ..dataset.layout import RECORD, check_is_dataset
    from ..files.outputs import check_outputs, write_output
    from ..report.dataset_page import dataset_page

    root, out = arguments.folder, arguments.out
    check_is_dataset(root)
    check_outputs([out], {"description": root / RECORD})
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{out}: expected the name of a page, *.html, found {out.name!r}; choose another name")
    if root.resolve() in out.resolve().parents:
        raise InputError(
            f"{out}: expected a file outside the folder of the dataset, whose own files it shows; choose another place"
        )
    check = None if arguments.no_check else check_dataset(root, stream=sys.stdout)
    content = dataset_page(root, views=arguments.views, check=check, stream=sys.stdout)
    write_output(out, content)
    sys.stdout.write(f"page of {len(content) / 1e6:.1f} MB: {out}\n")
