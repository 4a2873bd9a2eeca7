"""Tell whether a dataset is whole and consistent: files, hashes, tables, images, and poses against pixels.

python scripts/check_dataset.py DIR [--views N] [--fast]
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from pipeline.dataset.check.check_dataset import DEFAULT_VIEWS, check_dataset
from pipeline.errors import InputError

EXIT_WRONG, EXIT_INPUT, EXIT_STOPPED = 1, 2, 130

ABOUT = """
Exit code: 0 whole and consistent; 1 not; 2 not a dataset at all, or wrong arguments.

To mend a dataset, delete the records frame/NNNNNN.json of the views concerned and run the same command of
render_dataset.py again: it renders these views anew and writes all tables again.
"""


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="check_dataset.py",
        description=__doc__.splitlines()[0],
        epilog=ABOUT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("dataset", metavar="DIR", type=Path, help="folder of the dataset")
    parser.add_argument(
        "--views",
        metavar="N",
        type=int,
        default=DEFAULT_VIEWS,
        help="compare the pixels of N evenly spaced views, 0 for all (default %(default)s)",
    )
    parser.add_argument("--fast", action="store_true", help="do not compare the hashes of the files")
    arguments = parser.parse_args(argv)
    if arguments.views < 0:
        parser.error(f"--views: expected a number of views or 0 for all, found {arguments.views}")
    return arguments


def main(argv: Sequence[str]) -> int:
    arguments = parse_arguments(argv)
    try:
        report = check_dataset(arguments.dataset, views=arguments.views, hashes=not arguments.fast, stream=sys.stdout)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_INPUT
    except KeyboardInterrupt:
        print("error: stopped", file=sys.stderr)
        return EXIT_STOPPED
    for line in report.findings.shown():
        print(line)
    print(report.summary())
    return EXIT_WRONG if report.findings else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
