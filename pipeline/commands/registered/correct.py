"""The command ``oneframe correct``."""

import argparse
from dataclasses import replace
from pathlib import Path

from ... import __version__
from ...errors import InputError
from ...process.own_process import own_output

ABOUT = "Correct the surface by registered frames of it, for research: it must not guide a surgeon."
EPILOG = """examples:
  %(prog)s case.toml registered --video surgery.mp4 --out corrected
  %(prog)s case.toml registered --out corrected           (a folder of images, as oneframe register left it)

At least ten accepted frames over 15 degrees and more show where the surface is really; the case's own pose is taken for
right. A case with a lamp at the lens, see oneframe light, is corrected more exactly. DIR gets surface_corrected.ply,
with the values deviation (mm, positive towards the lens), std_mm and confirmed of each vertex; deviation.png, a map;
and case.toml, the case with that surface. What a second look at the frames does not confirm is grey in the map and
keeps the old surface. The case itself is never changed. Register the frames again to the corrected case for poses.

For research only: some of what is confirmed may be wrong, and must not guide a surgeon.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this command."""
    parser.add_argument("case", metavar="CASE.toml", type=Path, help="the aligned case")
    parser.add_argument("frames", metavar="FRAMES", type=Path, help="the folder that oneframe register wrote")
    parser.add_argument("--video", metavar="FILE", type=Path, help="the video, if FRAMES are of one")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder to write")


def run(arguments: argparse.Namespace) -> None:
    """Correct the surface, write it with its case and map, and report what was found."""
    import numpy as np

    from ...blender.render.lettering import text_mask
    from ...case.case_file import read_case
    from ...case.case_update import check_replaced
    from ...case.case_writer import write_case
    from ...case.loaded_case import load_case
    from ...colour.lens_shading import lens_shading_of
    from ...files.outputs import check_outputs, check_own_folder, made_folder, write_output, writing
    from ...images.png import encode_png
    from ...progress import ShareProgress
    from ...registration.accepted_frames import accepted_frames, small_frames
    from ...surface.mesh_reader import stated_space
    from ...surface.mesh_writer import encoded_ply
    from ...surface_correction.correct_surface import LONGER_SIDE_PX, MOST_FRAMES, correct_surface
    from ...surface_correction.deviation_map import CASE, MAP, NAMES, SURFACE, deviation_map

    case, output, out = read_case(arguments.case), own_output(), arguments.out
    corrected = replace(case, mesh=out / SURFACE)
    loaded = load_case(case)
    output.writelines(f"note: {message}\n" for message in loaded.messages)
    accepted = accepted_frames(arguments.frames, arguments.video, loaded)
    inputs = case.input_files() | accepted.files
    check_own_folder(out, NAMES, inputs)
    check_outputs([out / name for name in (SURFACE, MAP, CASE)], inputs)
    check_replaced(out / CASE, corrected)
    light = None if case.light is None else lens_shading_of(loaded)
    if light is None:
        output.write(
            "note: the case has no lamp at the lens: what its light does as it moves is taken for a wrong surface; "
            "find it with oneframe light first\n"
        )
    frames = small_frames(loaded, accepted, MOST_FRAMES, LONGER_SIDE_PX)
    with ShareProgress("of the correction", stream=output) as shown:
        try:
            found = correct_surface(loaded.surface.mesh, frames, light, np.random.default_rng(0), shown.reach)
        except InputError as error:
            raise InputError(f"{arguments.frames}: {error}") from None
    mesh = found.mesh.moved(loaded.surface.mesh_from_model[:3, 3]).scaled(1 / case.mm_per_unit)
    values = {"deviation": found.deviation_mm, "std_mm": found.std_mm, "confirmed": found.confirmed}
    with writing(made_folder(out / SURFACE)):
        write_output(out / SURFACE, encoded_ply(mesh, space=stated_space(case.mesh), values=values))
        write_output(out / MAP, encode_png(deviation_map(loaded, found, text_mask)))
        comment = (
            f"{SURFACE} is {case.mesh.name} corrected by registered frames, for research only: it must not guide a "
            f"surgeon (OneFrame {__version__}, correct)\n{found.words}\nthe surface as it was: {case.mesh}"
        )
        write_case(out / CASE, corrected, comment=comment)
    output.write(f"{found.words}\n")
    output.write(f"the corrected surface: {out / SURFACE}\nwhere it differs: {out / MAP}\nits case: {out / CASE}\n")
    output.write("for research only: it must not guide a surgeon\n")
