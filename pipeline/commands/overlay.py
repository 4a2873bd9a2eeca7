"""The command ``oneframe overlay``."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from ..errors import InputError
from ..process.own_process import own_output

if TYPE_CHECKING:
    from ..case.loaded_case import LoadedCase

ABOUT = "Draw surface and structures over the frame, or over each frame of a video, as augmented reality shows them."
EPILOG = """examples:
  %(prog)s case.toml --out overlay.png
  %(prog)s case.toml --out overlay.png --under-instruments
  %(prog)s case.toml --video surgery.mp4 --poses poses.json --out overlay.mp4

What the bone hides is dashed, and fainter the deeper it lies below the surface; what is in front of it is solid. The
legend says how deep each structure lies, along the line of sight; the scale bar holds at the depth that it names. If
the lens has a distortion, the picture is the undistorted frame.

POSES has cam_from_mesh for each frame of the video: a .npy array N x 4 x 4, NaN for frames without a pose, or a JSON
list of 4x4 matrices, null for frames without. A JSON list of {"frame": 12, "cam_from_mesh": ...}, counted from 0, may
leave frames out. The video is written as MP4 (H.264) without sound.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument(
        "case", metavar="CASE.toml", type=Path, help="frame, camera, surface and pose; structures if it has any"
    )
    parser.add_argument(
        "--only", metavar="NAME", action="append", default=[],
        help="draw this structure; may be repeated (default: those that are not white, or else all)",
    )  # fmt: skip
    film = parser.add_argument_group("video")
    film.add_argument("--video", metavar="FILE", type=Path, help="draw over the frames of this video instead")
    film.add_argument("--poses", metavar="FILE", type=Path, help="a pose for each frame of the video (.npy or .json)")
    output = parser.add_argument_group("output")
    output.add_argument("--out", metavar="FILE", type=Path, required=True, help="PNG to write; MP4 with --video")
    output.add_argument(
        "--under-instruments", action="store_true",
        help="draw nothing where the frame's alpha is 0: what is there is in front of the bone",
    )  # fmt: skip
    output.add_argument("--plain", action="store_true", help="draw no legend and no scale bar")


def run(arguments: argparse.Namespace) -> None:
    """Draw the picture or the video and report what it shows."""
    if (arguments.video is None) != (arguments.poses is None):
        given, missing = ("--video", "--poses") if arguments.video else ("--poses", "--video")
        raise InputError(f"command line: {given}: expected {missing} with it")
    if arguments.video and arguments.under_instruments:
        raise InputError("command line: --under-instruments: expected no --video, whose frames have no alpha")
    from ..case.case_file import read_case
    from ..case.loaded_case import load_case
    from ..files.outputs import check_outputs

    output = own_output()
    case = read_case(arguments.case)
    inputs = case.input_files()
    if arguments.video:
        inputs |= {"video": arguments.video, "file of the poses": arguments.poses}
    check_outputs([arguments.out], inputs)
    loaded = load_case(case, aligned=not arguments.video).with_shown_structures(arguments.only)
    output.writelines(f"note: {message}\n" for message in loaded.messages)
    lines = _film(arguments, loaded, output) if arguments.video else _picture(arguments, loaded)
    drawn = {structure.name for structure, _ in loaded.surface.structures}
    if left := [structure.name for structure in case.structures if structure.name not in drawn]:
        lines.append(f"not drawn: {', '.join(left)}; --only NAME draws what it names")
    output.writelines(f"{line}\n" for line in lines)
    output.write(f"overlay: {arguments.out}\n")


def _film(arguments: argparse.Namespace, loaded: "LoadedCase", output: TextIO) -> list[str]:
    from ..blender.render.lettering import text_mask
    from ..blender.render.video import stream_video
    from ..files.outputs import made_folder, writing
    from ..overlay.overlay_film import OverlayFilm, opened_film, report_lines
    from ..progress import Progress

    with opened_film(arguments.video, arguments.poses, loaded) as (film, poses, messages):
        output.writelines(f"note: {message}\n" for message in messages)
        drawing = OverlayFilm(loaded, film, poses, None if arguments.plain else text_mask)
        with Progress(drawing.count, "frames", stream=output) as shown, writing(made_folder(arguments.out)):
            stream_video(arguments.out, drawing.pictures(shown.advance), drawing.count, fps=drawing.fps)
    return report_lines(drawing.report, loaded.case)


def _picture(arguments: argparse.Namespace, loaded: "LoadedCase") -> list[str]:
    from ..blender.render.lettering import text_mask
    from ..files.outputs import write_output
    from ..images.png import encode_png
    from ..overlay.overlay_picture import case_picture, picture_lines

    write = None if arguments.plain else text_mask
    picture = case_picture(loaded, write, under_instruments=arguments.under_instruments)
    write_output(arguments.out, encode_png(picture.image))
    return picture_lines(loaded, picture)
