"""Files of what was made from the CT: in a temporary folder first, beside the case once that is saved."""

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np

from ..pipeline.case.structure_colour import structure_colour
from ..pipeline.files.kinds import PLY
from ..pipeline.files.outputs import Output, check_outputs, companion
from ..pipeline.surface.mesh import TriangleMesh
from ..pipeline.surface.mesh_writer import write_ply
from ..pipeline.volume.drill_plan import KIND, write_drill_plan
from ..state import from_scene
from ..state.inputs import input_files
from . import drill_strokes

SURFACE, DRILL = "surface.ply", "drill.toml"
_PREFIX = "oneframe-ct-"


def write_meshes(surface: TriangleMesh, structures: Mapping[str, TriangleMesh]) -> dict[str, Path]:
    """Write meshes as ``oneframe surface`` does, into a new temporary folder; the surface has the name ``""``."""
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=bpy.app.tempdir))
    paths = {"": folder / SURFACE}
    write_ply(paths[""], surface)
    for name, mesh in structures.items():
        paths[name] = folder / "structures" / f"{name}.ply"
        paths[name].parent.mkdir(exist_ok=True)
        shade = np.rint(np.array(structure_colour(name)) * 255).astype(np.uint8)
        write_ply(paths[name], mesh, colours=np.tile(shade, (len(mesh.vertices), 1)))
    return paths


def is_temporary(path: Path) -> bool:
    """Whether a file is one of :func:`write_meshes`, which ends with this session of Blender."""
    return any(part.startswith(_PREFIX) for part in path.parts)


def keep_beside(scene: bpy.types.Scene, folder: Path) -> list[Path]:
    """Move the surface and structures made from the CT beside the case, and write what was drilled there.

    Returns
    -------
    The files that were written.

    Raises
    ------
    InputError
        There are files of these names that the add-on did not write.
    """
    surface = from_scene.surface_of(scene)
    moved: list[tuple[bpy.types.Object, Path, Path]] = []
    for made in (surface, *(child for child in surface.children if child.oneframe.role == "STRUCTURE")):
        source = from_scene.absolute_path(made.oneframe.mesh_path)
        if made.oneframe.mesh_path and is_temporary(source):
            moved.append((made, source, folder / source.relative_to(_session_folder(source))))
    plan = drill_strokes.plan_of(scene)
    outputs = [companion(target, PLY) for _, _, target in moved]
    drill = folder / DRILL if plan.strokes else None
    if drill is not None:
        outputs.append(Output(drill, KIND))
    inputs = {name: path for name, path in input_files(scene).items() if name == "frame"}
    check_outputs(outputs, inputs)
    for made, source, target in moved:
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
        made.oneframe.mesh_path = str(target)
    if drill is not None:
        write_drill_plan(drill, plan, {})
    return [target for _, _, target in moved] + ([] if drill is None else [drill])


def _session_folder(path: Path) -> Path:
    return next(parent for parent in path.parents if parent.name.startswith(_PREFIX))
