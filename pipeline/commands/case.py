"""The command ``oneframe case``."""

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from ..errors import InputError
from ..process.arguments import at_least
from ..process.own_process import own_output

if TYPE_CHECKING:
    from ..case.frame import Frame

ABOUT = "Put surface, structures, frame, mask and K into a case folder, with a case.toml that all other commands take."
EPILOG = """examples:
  %(prog)s --surface surface --frame frames/surgery_frame_001234_masked.png --camera camera.json --out case
  %(prog)s --surface surface --frame surgery.mp4 --frame-number 1234 --mask mask.png --camera camera.yaml --out case
  %(prog)s --surface surface --frame frames/*_masked.png --camera camera.json --out queue    (a case for each frame)
  %(prog)s --surface bone.stl --structure chorda=ct.ply --frame frame.png --K 12800 12800 959.5 539.5 --out case

The folder gets case.toml, frame.png (colours unchanged, alpha 0 where the frame shows no surface), surface.ply,
structures/*.ply and overlay.png: the frame with the surface at the pose of the case. Without --pose this is only an
initial guess, from where the drilled cavity is open; align it next. Names of files, comments and metadata are not
copied. Of several frames, each becomes a case in a folder of its own name, a queue: the first as above, the others
without a pose, with its surface and K, which is scaled to images of the same proportions; these stay where they are.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    surface = parser.add_argument_group("surface and structures")
    surface.add_argument(
        "--surface", metavar="PATH", type=Path, required=True,
        help="the folder of oneframe surface, with its structures, or a mesh: PLY, OBJ or STL",
    )  # fmt: skip
    surface.add_argument(
        "--structure", metavar="[NAME=]FILE", action="append", default=[], dest="structures",
        help="a structure in the frame and unit of the surface; its name, which overlays and datasets show, gives its "
        "colour (default: the anatomy in the file's name, else structure_1, ...)",
    )  # fmt: skip
    surface.add_argument(
        "--only", metavar="NAME", action="append",
        help="of the structures in the folder, take this one; may be repeated (default: all)",
    )  # fmt: skip
    surface.add_argument(
        "--units", choices=("mm", "m"), default="mm", help="unit of the meshes and of --pose (default mm)"
    )
    frame = parser.add_argument_group("frame")
    frame.add_argument(
        "--frame", metavar="FILE", type=Path, nargs="+", required=True,
        help="PNG, JPEG, TIFF or BMP, one or more; or a video",
    )  # fmt: skip
    frame.add_argument("--frame-number", metavar="N", type=at_least(0), help="frame N of the video, counted from 0")
    frame.add_argument(
        "--mask", metavar="FILE", type=Path,
        help="an image of the frame's size, grey or with alpha: 0 shows no surface; joins the frame's own alpha",
    )  # fmt: skip
    frame.add_argument(
        "--denoise", action="store_true", default=None,
        help="remove noise from the frame (non-local means), if it has so much that more is won than lost",
    )  # fmt: skip
    camera = parser.add_argument_group("camera")
    given = camera.add_mutually_exclusive_group(required=True)
    given.add_argument(
        "--camera", metavar="FILE", type=Path,
        help="K and distortion: JSON, YAML or XML of OpenCV, ROS, COLMAP, NumPy, Vision6D, another case",
    )  # fmt: skip
    given.add_argument(
        "--K", metavar=("FX", "FY", "CX", "CY"), nargs=4, type=at_least(-math.inf, float),
        help="in px; (0, 0) is the centre of the top-left pixel",
    )  # fmt: skip
    camera.add_argument(
        "--size", metavar=("W", "H"), nargs=2, type=int, help="size of the images that --K is for (default: the frame)"
    )
    camera.add_argument(
        "--distortion",
        metavar="X",
        nargs="+",
        type=at_least(-math.inf, float),
        help="with --K: OpenCV's k1 k2 p1 p2 [k3]",
    )
    camera.add_argument(
        "--rescale-camera", action="store_true", help="rescale a K that is for another size of the same picture"
    )
    parser.add_argument("--pose", metavar="FILE", type=Path, help="cam_from_mesh: .npy, text or JSON")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder of the case, or of the queue")
    parser.add_argument(
        "--overwrite", action="store_true", help="replace another case, frame or surface in that folder"
    )


def run(arguments: argparse.Namespace) -> None:
    """Read and check everything, write the folder, and say what it holds."""
    from ..camera.intrinsics_file import read_camera, typed_camera
    from ..case.case_file import Structure, read_case
    from ..case.case_folder import CASE
    from ..case.case_queue import NewFrame, add_frames, case_name
    from ..case.new_case import CaseInputs, make_case
    from ..case.surface_folder import RECORD
    from ..surface.structure_colour import structure_colour
    from ..volume.bone.structures import name_of_file

    for name in ("size", "distortion"):
        if getattr(arguments, name) is not None and arguments.K is None:
            raise InputError(f"command line: --{name}: expected --K with it; a file for --camera has its own")
    frame, *others = arguments.frame
    for name in ("frame_number", "mask", "pose", "denoise"):
        if others and getattr(arguments, name) is not None:
            raise InputError(
                f"command line: --{name.replace('_', '-')}: expected one frame with it, found {len(others) + 1}"
            )
    out = arguments.out / case_name(frame) if others else arguments.out
    output = own_output()
    structures: list[Structure] = []
    for text in arguments.structures:
        name, equals, file = text.partition("=")
        shown = name
        if not equals or Path(text).exists():
            shown, file = Path(text).stem, text
            name = name_of_file(Path(file), [structure.name for structure in structures])
        if not shown or not file:
            raise InputError(f"--structure: expected NAME=FILE or a file, found {text!r}")
        structures.append(Structure(name, Path(file), structure_colour(shown)))
    if arguments.camera is not None:
        camera = read_camera(arguments.camera)
    else:
        camera = typed_camera(arguments.K, size=arguments.size, distortion=arguments.distortion, name="--K")
    given = CaseInputs(
        surface=arguments.surface.parent if arguments.surface.name == RECORD else arguments.surface,
        structures=tuple(structures),
        only=None if arguments.only is None else tuple(arguments.only),
        units=arguments.units,
        frame=_frame(arguments, output),
        camera=camera,
        rescale_camera=arguments.rescale_camera,
        pose=arguments.pose,
        others=tuple(others),
    )
    output.writelines(f"{line}\n" for line in make_case(given, out, overwrite=arguments.overwrite))
    case, aligned = out / CASE, out / "aligned.toml"
    if others:
        added = add_frames(arguments.out, read_case(case), [NewFrame(path) for path in others])
        output.write(f"queue: {len(added) + 1} frames in {arguments.out}\nnext: open {case} in Blender and align it\n")
        return
    output.write(
        f"next: open {case} in Blender and align it, or: oneframe align {case} --landmarks FILE --out {aligned}\n"
    )


def _frame(arguments: argparse.Namespace, output: TextIO) -> "Frame":
    """The first frame that is named: an image, or one of a video; with its mask, and without noise if that is asked."""
    import numpy as np

    from ..case.frame import Frame, read_frame
    from ..images.pixel_values import to_uint8
    from ..video import SUFFIXES

    path = arguments.frame[0]
    if arguments.frame_number is not None:
        from ..video.film_reader import read_video_frame, video_info

        pixels = read_video_frame(path, arguments.frame_number)
        if pale := video_info(path).pale:
            output.write(f"note: {pale}\n")
        frame = Frame(path, pixels / np.float32(255), np.ones(pixels.shape[:2], np.bool_))
    elif path.suffix.lower() in SUFFIXES:
        raise InputError(f"{path.name}: expected an image, found a video; say which frame with --frame-number")
    else:
        frame = read_frame(path)
    if arguments.mask is not None:
        frame = frame.with_mask(arguments.mask)
    if arguments.denoise:
        from ..video.frame_measures import denoised

        codes, said = denoised(to_uint8(frame.colours), frame.shown)
        output.write(f"{said}\n")
        frame = frame if codes is None else replace(frame, colours=codes / np.float32(255))
    return frame
