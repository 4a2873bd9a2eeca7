"""The command ``oneframe overlay``."""

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from ..errors import InputError
from ..process.command import option, positional, switch
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


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    case: Path = positional("CASE.toml", "frame, camera, surface and pose; structures if it has any")
    only: tuple[str, ...] = option(
        "NAME", "draw this structure; may be repeated (default: those that are not white, or else all)", (), each=True
    )  # fmt: skip
    video: Path | None = option("FILE", "draw over the frames of this video instead")
    poses: Path | None = option("FILE", "a pose for each frame of the video (.npy or .json)")
    out: Path = option("FILE", "PNG to write; MP4 with --video", MISSING)
    under_instruments: bool = switch("draw nothing where the frame's alpha is 0: what is there is in front of the bone")
    plain: bool = switch("draw no legend and no scale bar")


def run(arguments: Arguments) -> None:
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
    film = None if arguments.video is None or arguments.poses is None else (arguments.video, arguments.poses)
    if film:
        inputs |= dict(zip(("video", "file of the poses"), film, strict=True))
    check_outputs([arguments.out], inputs)
    loaded = load_case(case, aligned=not arguments.video).with_shown_structures(arguments.only)
    output.writelines(f"note: {message}\n" for message in loaded.messages)
    lines = _film(arguments, film, loaded, output) if film else _picture(arguments, loaded)
    drawn = {structure.name for structure, _ in loaded.surface.structures}
    if left := [structure.name for structure in case.structures if structure.name not in drawn]:
        lines.append(f"not drawn: {', '.join(left)}; --only NAME draws what it names")
    output.writelines(f"{line}\n" for line in lines)
    output.write(f"overlay: {arguments.out}\n")


def _film(arguments: Arguments, given: tuple[Path, Path], loaded: "LoadedCase", output: TextIO) -> list[str]:
    from ..blender.render.lettering import text_mask
    from ..blender.render.video import stream_video
    from ..files.outputs import made_folder, writing
    from ..overlay.overlay_film import OverlayFilm, opened_film
    from ..progress import Progress

    with opened_film(*given, loaded) as (film, poses, messages):
        output.writelines(f"note: {message}\n" for message in messages)
        drawing = OverlayFilm(loaded, film, poses, None if arguments.plain else text_mask)
        with Progress(drawing.count, "frames", stream=output) as shown, writing(made_folder(arguments.out)):
            pictures, aspect = drawing.pictures(shown.advance), drawing.pixel_aspect
            stream_video(arguments.out, pictures, drawing.count, fps=drawing.fps, pixel_aspect=aspect)
    return [*drawing.lines(), *(["the frames are undistorted"] if loaded.case.distortion else [])]


def _picture(arguments: Arguments, loaded: "LoadedCase") -> list[str]:
    from ..blender.render.lettering import text_mask
    from ..files.outputs import write_output
    from ..images.png import encode_png
    from ..overlay.overlay_picture import case_picture, picture_lines

    write = None if arguments.plain else text_mask
    picture = case_picture(loaded, write, under_instruments=arguments.under_instruments)
    write_output(arguments.out, encode_png(picture.image))
    return picture_lines(loaded, picture)
