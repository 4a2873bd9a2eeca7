"""What a dataset's filters know, and what those of one view share.

A filter changes a rendered view: by shadows, by what surrounds the surface, by what stands in front of it. Those of a
dataset are made from its staging, and follow one another in a list.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..colour.lens_shading import LensShading
from ..colour.reference_view import ReferenceView
from ..projection.rendered_view import RenderedView
from ..transforms import inverse_rigid
from .occluders import Occluders, Room, draw_occluders
from .shadow import Shadow


@dataclass(frozen=True, eq=False)
class Staging:
    """What the filters of a dataset are made from.

    Attributes
    ----------
    options
        The content of its options.
    reference
        The reference view, limited to what the options let count as seen.
    camera
        Intrinsics of the views.
    camera_from_planned
        ``(4, 4)`` rigid, mm: from the camera whose poses are planned, by which what stands in front is held.
    light
        The light at the lens of the views; ``None`` without one.
    room
        The surface that what stands in front keeps clear of.
    """

    options: Mapping[str, Any]
    reference: ReferenceView
    camera: PinholeCamera
    camera_from_planned: np.ndarray
    light: LensShading | None
    room: Room


@dataclass(frozen=True, eq=False)
class StagedView:
    """One view: its number in the dataset, its pose (4x4, mm), and what is there by seed and number alone."""

    staging: Staging
    index: int
    cam_from_model: np.ndarray

    @cached_property
    def occluders(self) -> Occluders | None:
        """What stands in front, the same for both eyes; ``None`` for nothing."""
        staging, mean = self.staging, self.staging.options["occluders"]
        if not mean:
            return None
        planned = inverse_rigid(staging.camera_from_planned) @ self.cam_from_model
        seed = staging.options["seed"], self.index
        return draw_occluders(mean, seed, staging.room, staging.camera, planned)

    @cached_property
    def shadow(self) -> Shadow | None:
        """Its shadow in the light at the lens."""
        light, camera = self.staging.light, self.staging.camera
        if light is None or self.occluders is None:
            return None
        return Shadow(self.occluders.mesh, light, camera, self.cam_from_model)


Filter = Callable[[RenderedView, StagedView], RenderedView]
"""Changes a view."""
