"""Files of what was made in this session: in a temporary folder, until Save Case puts them beside the case."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..pipeline.case.case_file import structure_colour
from ..pipeline.case.surface_folder import SURFACE, structure_file
from ..pipeline.surface.mesh import TriangleMesh
from ..pipeline.surface.mesh_writer import write_ply
from ..state.scene_files import session_folder


def write_meshes(surface: TriangleMesh, structures: Mapping[str, TriangleMesh]) -> dict[str, Path]:
    """Write meshes as ``oneframe surface`` does, into a new temporary folder; the surface has the name ``""``."""
    folder = session_folder()
    paths = {"": folder / SURFACE}
    write_ply(paths[""], surface)
    for name, mesh in structures.items():
        paths[name] = folder / structure_file(name)
        paths[name].parent.mkdir(exist_ok=True)
        shade = np.rint(np.array(structure_colour(name)) * 255).astype(np.uint8)
        write_ply(paths[name], mesh, colours=np.tile(shade, (len(mesh.vertices), 1)))
    return paths
