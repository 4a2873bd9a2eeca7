"""The command ``oneframe light``."""

import datetime
from dataclasses import dataclass, replace
from pathlib import Path

from .. import __version__
from ..errors import InputError
from ..process.command import choice, option, positional, switch
from ..process.own_process import own_output

ABOUT = "Find the lamp at the lens, which moves with it, from the shading of the frame and of registered ones."
EPILOG = """examples:
  %(prog)s case.toml registered                           (a folder of images, as oneframe register left it)
  %(prog)s case.toml registered --video surgery.mp4
  %(prog)s case.toml registered --out lit.toml            (leave case.toml as it is)
  %(prog)s case.toml                                      (from the frames of the case alone)

Two registered frames and more tell a lamp at the lens from the light of a room, which stands still. One frame alone
does so seldom: then the command says that it does not know. The case gets a table [light]: where the lamp is in the
camera's axes, the ambient part beside it, and how sure they are; with vignetting, or that alone, where frames that were
left out tell so. Exit code 2: there is no lamp at the lens, or the frames do not tell, as where they are not of this
surface; nothing is written.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    case: Path = positional("CASE.toml", "the aligned case")
    frames: Path | None = positional(
        "FRAMES", "the folder that oneframe register wrote (default: the frames of the case alone)", None
    )  # fmt: skip
    video: Path | None = option("FILE", "the video, if FRAMES are of one")
    transfer: str | None = choice(
        "what the frames' code values are (default: as the case has it, else srgb)", choices=("srgb", "bt709", "linear")
    )  # fmt: skip
    out: Path | None = option("FILE", "write the case here, not over CASE.toml")
    overwrite: bool = switch("let --out replace a case of another frame or surface")


def run(arguments: Arguments) -> None:
    """Find the lamp, write it into the case and report what it explains."""
    if arguments.video and not arguments.frames:
        raise InputError("command line: --video: expected FRAMES with it, the folder that oneframe register wrote")
    from ..case.case_changes import check_replaced
    from ..case.case_file import read_case
    from ..case.case_writer import case_output, write_case
    from ..case.loaded_case import load_case
    from ..files.outputs import check_outputs, made_folder
    from ..light.find_lamp import find_lamp
    from ..registration.pose_list import accepted_frames, small_frames

    case, output, target = read_case(arguments.case), own_output(), arguments.out
    loaded = load_case(case)
    output.writelines(f"note: {message}\n" for message in loaded.messages)
    accepted = accepted_frames(arguments.frames, arguments.video, loaded) if arguments.frames else None
    check_outputs([case_output(target)] if target else [], accepted.files if accepted else {})
    if target and not arguments.overwrite:
        check_replaced(target, case)
    transfer = arguments.transfer or (case.light.transfer if case.light else "srgb")
    try:
        found = find_lamp(loaded.surface.mesh, small_frames(loaded, accepted), transfer)
    except InputError as error:
        raise InputError(f"{case.path.name}: {error}") from None
    if found.objection:
        more = "" if accepted is not None or found.frames > 1 else "; register further frames, and give their folder"
        raise InputError(f"{case.path.name}: {found.objection}{more}")
    lit = replace(case, light=found.recorded(f"OneFrame {__version__}, light", datetime.date.today().isoformat()))
    write_case(made_folder(target or case.path), lit)
    output.write(f"{found.figures}\nthe case with its lamp: {target or case.path}\n")
