"""The surface that a setting renders: reduced from the one given, and kept in a file for the processes of a run."""

import io
import zipfile
from dataclasses import dataclass, replace
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


@dataclass(frozen=True)
class KeptSurface:
    """A reduced surface, and what a process needs to know of the one given to do without it.

    Attributes
    ----------
    mesh
        The reduced surface, model frame, mm.
    mesh_from_model
        4x4, mm.
    radius_mm, geometry_sha256, file_sha256
        Of the surface given: its :attr:`.TriangleMesh.radius`, its :func:`.geometry_hash`, and the hash of its file.
    """

    mesh: TriangleMesh
    mesh_from_model: np.ndarray
    radius_mm: float
    geometry_sha256: str
    file_sha256: str


def rendered_mesh(given: TriangleMesh, setting: Setting, out: Path) -> TriangleMesh:
    """The mesh that a setting renders: the one given, the one kept in a dataset's folder, or reduced anew.

    Raises
    ------
    RunError
        The reduction does not give the surface of the setting.
    """
    if setting.mesh_tolerance_mm == 0:
        return given
    kept = kept_surface(setting, out)
    if kept is not None:
        return kept.mesh
    mesh = simplified(given, setting.mesh_tolerance_mm)
    if geometry_hash(mesh) != setting.surface_sha256:
        raise RunError(
            f"{out}: the surface of the dataset cannot be made again by this version; use the version that made it"
        )
    return mesh


def keep_surface(kept: KeptSurface, setting: Setting, out: Path) -> None:
    """Keep a reduced surface in a dataset's folder while a run works in it, for its other processes.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    stream = io.BytesIO()
    np.savez(
        stream,
        vertices=kept.mesh.vertices,
        faces=kept.mesh.faces,
        mesh_from_model=kept.mesh_from_model,
        radius_mm=kept.radius_mm,
        geometry_sha256=kept.geometry_sha256,
        file_sha256=kept.file_sha256,
    )
    write_bytes_atomically(_file(out, setting), stream.getvalue())


def kept_surface(setting: Setting, out: Path) -> KeptSurface | None:
    """The surface of a setting that is kept in a dataset's folder, if there is one and it is whole."""
    try:
        with np.load(_file(out, setting), allow_pickle=False) as content:
            kept = KeptSurface(
                TriangleMesh(content["vertices"], content["faces"]),
                content["mesh_from_model"],
                float(content["radius_mm"]),
                str(content["geometry_sha256"]),
                str(content["file_sha256"]),
            )
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    return kept if geometry_hash(kept.mesh) == setting.surface_sha256 else None


def _file(out: Path, setting: Setting) -> Path:
    return out / WORK / f"surface-{setting.surface_sha256[:16]}.npz"


def rendered_view_of(loaded: LoadedCase, pivot_model: tuple[float, float, float], mesh: TriangleMesh) -> ReferenceView:
    """The frame's view of the mesh that a setting renders, with the pivot of the surface given, mm.

    Raises
    ------
    InputError
        No pixel of the frame shows the surface.
    """
    view = colouring_view_of(replace(loaded, mesh=mesh))
    return replace(view, pivot_model=np.array(pivot_model), raster=None)
