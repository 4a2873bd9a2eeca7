"""The surface that a setting renders: reduced from the one given, and kept in a file for the processes of a run."""

import io
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...case.loaded_case import LoadedCase
from ...dataset.identity import geometry_hash
from ...dataset.layout import WORK
from ...dataset.quality import Setting
from ...errors import RunError
from ...files.content import write_bytes_atomically
from ...surface.mesh import TriangleMesh
from ...surface.simplification import simplified
from ..colour.reference_view import ReferenceView, colouring_view_of


def rendered_mesh(given: TriangleMesh, setting: Setting, out: Path) -> TriangleMesh:
    """The mesh that a setting renders: the one given, the one kept in a dataset's folder, or reduced anew.

    Raises
    ------
    RunError
        The reduction does not give the surface of the setting.
    """
    if setting.mesh_tolerance_mm == 0:
        return given
    kept = _kept(out, setting)
    if kept is not None:
        return kept
    mesh = simplified(given, setting.mesh_tolerance_mm)
    if geometry_hash(mesh) != setting.surface_sha256:
        raise RunError(
            f"{out}: the surface of the dataset cannot be made again by this version; use the version that made it"
        )
    return mesh


def keep_mesh(mesh: TriangleMesh, setting: Setting, out: Path) -> None:
    """Keep a reduced mesh in a dataset's folder while a run works in it, for its other processes.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    if setting.mesh_tolerance_mm > 0 and not _file(out, setting).exists():
        stream = io.BytesIO()
        np.savez(stream, vertices=mesh.vertices, faces=mesh.faces)
        write_bytes_atomically(_file(out, setting), stream.getvalue())


def _file(out: Path, setting: Setting) -> Path:
    return out / WORK / f"surface-{setting.surface_sha256[:16]}.npz"


def _kept(out: Path, setting: Setting) -> TriangleMesh | None:
    try:
        with np.load(_file(out, setting), allow_pickle=False) as content:
            mesh = TriangleMesh(content["vertices"], content["faces"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return mesh if geometry_hash(mesh) == setting.surface_sha256 else None


def rendered_view_of(loaded: LoadedCase, pivot_model: tuple[float, float, float], mesh: TriangleMesh) -> ReferenceView:
    """The frame's view of the mesh that a setting renders, with the pivot of the surface given, mm.

    Raises
    ------
    InputError
        No pixel of the frame shows the surface.
    """
    view = colouring_view_of(replace(loaded, mesh=mesh))
    return replace(view, pivot_model=np.array(pivot_model), raster=None)
