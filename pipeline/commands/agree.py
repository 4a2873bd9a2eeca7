"""The command ``oneframe agree``."""

import argparse
from pathlib import Path

from ..process.arguments import at_least
from ..process.own_process import own_output

ABOUT = "Compare the poses of two annotators: in degrees, mm and px, beside what their stated errors let expect."
EPILOG = """examples:
  %(prog)s queue_of_anna queue_of_ben --out agreement
  %(prog)s anna.toml ben.toml --out agreement

Two queues (folders of cases, as the add-on makes them) are compared case by case, by the names of their folders; cases
without a pose in either are left out. The folder gets agreement.csv and pictures of the worst pairs: the frame with
both overlays.
"""
DEFAULT_PICTURES = 4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("first", metavar="FIRST", type=Path, help="a queue, or a case file")
    parser.add_argument("second", metavar="SECOND", type=Path, help="the other annotator's")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder to write")
    parser.add_argument(
        "--pictures", metavar="N", type=at_least(0), default=DEFAULT_PICTURES,
        help="pairs of which pictures are written, the worst first (default %(default)s)",
    )  # fmt: skip


def run(arguments: argparse.Namespace) -> None:
    """Compare, write table and pictures, and print the table."""
    from ..evaluation.agreement import HEADER, agreements, pair_picture, paired_cases, summary
    from ..files.outputs import check_own_folder, made_folder, write_output, writing
    from ..files.tables import write_csv
    from ..images.png import encode_png

    folder: Path = arguments.out
    pairs, output = paired_cases(arguments.first, arguments.second), own_output()
    compared = [case for _, *both in pairs for case in both]
    inputs = {f"{what} of {case.path}": path for case in compared for what, path in case.input_files().items()}
    check_own_folder(folder, r"agreement\.csv|worst_\d+_.*\.png", inputs)
    found = sorted(agreements(pairs), key=lambda each: -each[0].px)
    with writing(made_folder(folder / "agreement.csv")):
        write_csv(folder / "agreement.csv", HEADER, [each.row for each, _, _ in found])
    for number, (each, *cases) in enumerate(found[: arguments.pictures], start=1):
        path = folder / f"worst_{number}_{each.name}.png"
        write_output(path, encode_png(pair_picture(*cases)))
    for each, _, _ in found:
        expected = f" (expected {each.expected_px:.1f} px)" if each.expected_px > 0 else ""
        line = f"{each.name}: {each.angle_deg:.2f} degrees, {each.shift_mm:.2f} mm, {each.px:.1f} px"
        output.write(line + expected + "\n")
    output.writelines(f"{line}\n" for line in summary([each for each, _, _ in found]))
