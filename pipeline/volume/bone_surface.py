"""From the voxels of bone to the surface that is written: extracted, smoothed, simplified.

Script and window both call :func:`bone_surface`, so that they give the same surface.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..errors import InputError
from ..surface.mesh import MOST_FACES
from .bone import CRUMB_MM3, without_crumbs
from .isosurface import Isosurface, RemovedField, isosurface
from .smoothing import STEPS, smoothed
from .volume import Volume

Report = Callable[[str, float], None]
"""Called with the name of a stage and its finished share, 0..1; what it raises ends the work."""

STAGES = ("extracted", "smoothed")


@dataclass(frozen=True)
class Finish:
    """What is done to the surface after it was extracted.

    Attributes
    ----------
    crumb_mm3
        Parts below this volume that the drill has cut off are dropped.
    smoothing_steps
        Steps of :func:`.smoothed`; what the drill made is not smoothed.
    """

    crumb_mm3: float = CRUMB_MM3
    smoothing_steps: int = STEPS


@dataclass(frozen=True)
class BoneSurface:
    """The surface, and how it became what it is.

    Attributes
    ----------
    surface
        Closed; ``drilled`` tells the vertices on what was removed.
    extracted_faces
        Number of faces before simplification.
    """

    surface: Isosurface
    extracted_faces: int


def bone_surface(
    volume: Volume,
    level_hu: float,
    solid: np.ndarray,
    removed: RemovedField | None = None,
    finish: Finish = Finish(),
    *,
    report: Report | None = None,
) -> BoneSurface:
    """The surface of bone.

    Parameters
    ----------
    level_hu
        Bone lies above it.
    solid
        ``(Z, Y, X)`` bool, as of :func:`.bone_voxels`.
    removed
        What was drilled away.

    Raises
    ------
    InputError
        No bone is left, or the surface has too many faces.
    """
    stages = {stage: None if report is None else partial(report, stage) for stage in STAGES}
    if removed is not None:
        solid = without_crumbs(solid, volume.grid, removed, smallest_mm3=finish.crumb_mm3)
    surface = isosurface(
        volume.values, level_hu, volume.grid, solid=solid, removed=removed, progress=stages["extracted"]
    )
    faces = len(surface.mesh.faces)
    if faces == 0:
        raise InputError("surface: expected bone, found none left; remove less")
    surface = smoothed(surface, finish.smoothing_steps, progress=stages["smoothed"])
    if len(surface.mesh.faces) > MOST_FACES:
        raise InputError(
            f"surface: expected up to {MOST_FACES:,} faces, found {len(surface.mesh.faces):,}; crop the volume, choose "
            "a higher threshold, or a larger tolerance"
        )
    return BoneSurface(surface, faces)
