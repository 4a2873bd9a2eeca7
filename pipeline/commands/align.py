"""The command ``oneframe align``."""

import datetime
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .. import __version__
from ..process.command import option, positional, switch
from ..process.own_process import own_output

if TYPE_CHECKING:
    from ..case.case_file import Case

ABOUT = "Find the pose of a frame from landmarks and report its uncertainty, or refine the pose against the image."
EPILOG = """examples:
  %(prog)s case.toml --landmarks landmarks.csv --out aligned.toml
  %(prog)s case.toml --out aligned.toml         (the landmarks of the case file)
  %(prog)s rough.toml --refine --out refined.toml

Landmarks are 2D-3D correspondences: a name, a point in the frame of the mesh file and a pixel of the undistorted
frame. They come from --landmarks (CSV or JSON) or else from the case file. The command prints the pose in both
directions, the residual of every pair and the uncertainty. The pose in the case file may be rough, or missing: it only
decides between poses that fit equally well. Exit code 2: the pairs do not determine a pose.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    case: Path = positional("CASE.toml", "frame, camera, surface, and a rough pose or none")
    landmarks: Path | None = option("FILE", "landmarks as CSV or JSON (default: those of the case)")
    click_sigma_px: float = option(
        "X", "standard deviation of the click noise along each image axis, in px (default %(default)g)", 2.0
    )  # fmt: skip
    refine: bool = switch(
        "refine the pose against the image, from the pose of the landmarks or, without any, of the case"
    )  # fmt: skip
    out: Path | None = option("FILE", "write the case with the new pose and the landmarks")
    overwrite: bool = switch("let --out replace a case of another frame or surface")


def run(arguments: Arguments) -> None:
    """Align the case, print the report and write the requested files."""
    from ..alignment.align_case import align_case
    from ..case.case_writer import write_case
    from ..case.landmarks import read_landmarks
    from ..files.outputs import made_folder, writing

    output, case = own_output(), _checked_case(arguments)
    if arguments.landmarks:
        case = replace(case, landmarks=read_landmarks(arguments.landmarks, mm_per_unit=case.mm_per_unit))
    aligned = align_case(
        case,
        click_sigma_px=arguments.click_sigma_px,
        refine=arguments.refine,
        tool=f"OneFrame {__version__}, align",
        date=datetime.date.today().isoformat(),
    )
    output.write("\n".join(aligned.lines()) + "\n")
    if arguments.out:
        with writing(made_folder(arguments.out)):
            write_case(arguments.out, aligned.loaded.case)
        output.write(f"aligned case: {arguments.out}\n")


def _checked_case(arguments: Arguments) -> "Case":
    """The case, once it is sure that the outputs replace nothing that they should not."""
    from ..case.case_changes import check_replaced
    from ..case.case_file import read_case
    from ..case.case_writer import case_output
    from ..files.outputs import check_outputs

    case = read_case(arguments.case, posed=False)
    inputs = case.input_files() | ({"file of the landmarks": arguments.landmarks} if arguments.landmarks else {})
    check_outputs([case_output(arguments.out)] if arguments.out else [], inputs)
    if arguments.out and not arguments.overwrite:
        check_replaced(arguments.out, case)
    return case
