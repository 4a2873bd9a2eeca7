"""The command ``oneframe case``."""

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..process.command import choice, option, switch
from ..process.own_process import own_output

if TYPE_CHECKING:
    from ..case.frame import Frame

ABOUT = "Put surface, structures, frame, mask and K into a case folder, with a case.toml that all other commands take."
EPILOG = """examples:
  %(prog)s --surface surface --frame frames/surgery_frame_001234_masked.png --camera camera.json --out case
  %(prog)s --surface surface --frame surgery.mp4 --frame-number 1234 --mask mask.png --camera camera.yaml --out case
  %(prog)s --surface bone.stl --structure chorda=ct.ply --frame frame.png --K 12800 12800 959.5 539.5 --out case

The folder gets case.toml, frame.png (colours unchanged, alpha 0 where the frame shows no surface), surface.ply,
structures/*.ply and overlay.png: the frame with the surface at the pose of the case. Without --pose this is only an
initial guess, from where the drilled cavity is open; align it next. Names of files, comments and metadata are not
copied. Of files with several cameras or poses, say which after #: scene_camera.json#7 and scene_gt.json#7/1 (image 7,
object 1) of BOP, "cameras.txt#camera 3" and images.txt#NAME.png of COLMAP, which needs --units.
"""


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    surface: Path = option(
        "PATH", "the folder of oneframe surface, with its structures, or a mesh: PLY, OBJ or STL", MISSING
    )  # fmt: skip
    structures: tuple[str, ...] = option(
        "[NAME=]FILE", "a structure in the frame and unit of the surface; its name, which overlays and datasets "
        "show, gives its colour (default: the anatomy in the file's name, else structure_1, ...)",
        (), each=True, flag="--structure",
    )  # fmt: skip
    units: str | None = choice("unit of the meshes and of --pose (default mm)", choices=("mm", "m"))
    frame: Path = option("FILE", "PNG or JPEG, or a video", MISSING)
    frame_number: int | None = option("N", "frame N of the video, counted from 0", least=0)
    mask: Path | None = option(
        "FILE", "of the frame's size, grey or with alpha: 0 shows no surface, one other value the rest; joins the "
        "frame's own alpha"
    )  # fmt: skip
    camera: Path | None = option(
        "FILE", "K and distortion: JSON, YAML of OpenCV, ROS or Kalibr, BOP, COLMAP, another case",
        excludes="camera",
    )  # fmt: skip
    K: tuple[float, float, float, float] | None = option(
        ("FX", "FY", "CX", "CY"), "of the frame, px; (0, 0) is the centre of the top-left pixel", excludes="camera"
    )  # fmt: skip
    rescale_camera: bool = switch("rescale a K that is for another size of the same picture")
    pose: Path | None = option("FILE", "cam_from_mesh: .npy, text, JSON, BOP's scene_gt.json, COLMAP's images.txt")
    out: Path = option("DIR", "folder of the case", MISSING)
    overwrite: bool = switch("replace another case, frame or surface in that folder")


def run(arguments: Arguments) -> None:
    """Read and check everything, write the folder, and say what it holds."""
    from ..camera.intrinsics_file import CameraFile, read_camera
    from ..case.case_file import Structure
    from ..case.case_folder import CASE
    from ..case.new_case import CaseInputs, make_case
    from ..case.surface_folder import RECORD
    from ..surface.structure_colour import structure_colour
    from ..volume.bone.structures import name_of_file

    out, output = arguments.out, own_output()
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
    elif arguments.K is not None:
        fx, fy, cx, cy = arguments.K
        camera = CameraFile.of_matrix(Path("--K"), [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], None, (), where="--K")
    given = CaseInputs(
        surface=arguments.surface.parent if arguments.surface.name == RECORD else arguments.surface,
        structures=tuple(structures),
        units=arguments.units,
        frame=_frame(arguments),
        camera=camera,
        rescale_camera=arguments.rescale_camera,
        pose=arguments.pose,
    )
    output.writelines(f"{line}\n" for line in make_case(given, out, overwrite=arguments.overwrite))
    case, aligned = out / CASE, out / "aligned.toml"
    output.write(
        f"next: open {case} in Blender and align it, or: oneframe align {case} --landmarks FILE --out {aligned}\n"
    )


def _frame(arguments: Arguments) -> "Frame":
    """The frame: an image, or one of a video; with its mask."""
    import numpy as np

    from ..case.frame import Frame, read_frame
    from ..video import SUFFIXES

    path = arguments.frame
    if arguments.frame_number is not None:
        from ..video.film_reader import film_frame
        from ..video.frame_folder import DEINTERLACE
        from ..video.frame_scores import COMBED

        decoded, film = film_frame(path, arguments.frame_number)
        colours, shown = decoded.image / np.float32(255), np.ones(decoded.image.shape[:2], np.bool_)
        notes = film.notes
        if decoded.comb > COMBED:
            notes.append(f"the frame is interlaced, and shows two moments; {DEINTERLACE}")
        frame = Frame(path, colours, shown, pixel_aspect=film.pixel_aspect, notes=tuple(notes))
    elif path.suffix.lower() in SUFFIXES:
        raise InputError(f"{path.name}: expected an image, found a video; say which frame with --frame-number")
    else:
        frame = read_frame(path)
    if arguments.mask is not None:
        frame = frame.with_mask(arguments.mask)
    return frame
