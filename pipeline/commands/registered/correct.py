"""The command ``oneframe correct``."""

import argparse
from pathlib import Path

from ...process.own_process import own_output

ABOUT = "Correct the surface by registered frames of it, for research: it must not guide a surgeon."
EPILOG = """examples:
  %(prog)s case.toml registered --video surgery.mp4 --out corrected
  %(prog)s case.toml registered --out corrected           (a folder of images, as oneframe register left it)

At least ten accepted frames over 15 degrees and more show where the surface is really; the case's own pose is taken for
right. A case with a lamp at the lens, see oneframe light, is corrected more exactly. DIR gets surface_corrected.ply,
with the values deviation (mm, positive towards the lens), std_mm and confirmed of each vertex; deviation.png, a map;
deviation.html, the model to turn; and case.toml, the case with that surface. What a second look at the frames does not
confirm is grey and keeps the old surface. The case itself is never changed. Register the frames again to the corrected
case for poses.

For research only: some of what is confirmed may be wrong, and must not guide a surgeon.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("case", metavar="CASE.toml", type=Path, help="the aligned case")
    parser.add_argument("frames", metavar="FRAMES", type=Path, help="the folder that oneframe register wrote")
    parser.add_argument("--video", metavar="FILE", type=Path, help="the video, if FRAMES are of one")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder to write")


def run(arguments: argparse.Namespace) -> None:
    """Correct the surface, write it with its case, map and page, and report what was found."""
    from ...blender.render.lettering import text_mask
    from ...case.case_file import read_case
    from ...case.loaded_case import load_case
    from ...progress import ShareProgress
    from ...registration.accepted_frames import accepted_frames
    from ...registration.correct_case import CaseCorrection
    from ...report.deviation_page import deviation_page
    from ...surface_correction import NOT_FOR_SURGERY

    loaded, output = load_case(read_case(arguments.case)), own_output()
    correction = CaseCorrection(loaded, accepted_frames(arguments.frames, arguments.video, loaded), arguments.out)
    correction.check()
    output.writelines(f"note: {message}\n" for message in (*loaded.messages, *correction.notes))
    with ShareProgress("of the correction", stream=output) as shown:
        found = correction.correct(shown.reach)
    places = correction.write(found, text_mask, deviation_page)
    output.writelines(f"{line}\n" for line in (*found.lines, *places, NOT_FOR_SURGERY))
