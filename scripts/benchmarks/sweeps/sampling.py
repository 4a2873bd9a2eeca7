"""Sweeps of the constraints on sampled poses, until no pose meets them.

The surface is a ridged bowl in 2000 triangles; what a pose shows is measured as in a dataset, by the same grid of rays,
here through a z-buffer.
"""

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from oneframe.camera.pinhole import PinholeCamera
from oneframe.errors import InputError
from oneframe.poses.constraints import (
    LEAST_ACCEPTANCE,
    MAX_ATTEMPTS,
    Constraints,
    Drawn,
    ViewStatistics,
    plan_pose,
    sampling_doubt,
)
from oneframe.poses.distributions import Cone, ReferencePose
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import camera_centre, inverse_rigid, transform_points

from ..rendering.benchmark_case import CAM_FROM_MESH, VIEW_CAMERA, ridged_bowl
from .cells import Limit, Outcome, Sweep, Task

TOPIC = "sampling"
TRIANGLES = 2000
GRID = 16, 12
"""Rays along the sides of a view, as in a dataset."""
VIEWS = 24
CONES_DEG = (20.0, 60.0, 120.0)
SHARES = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
CLEARANCES_MM = (0.0, 100.0, 200.0, 250.0, 280.0, 300.0, 310.0, 320.0, 400.0)
ACCEPTANCES = (1.0, 0.1, 0.03, 0.01, 0.004, 0.002, 0.001, 0.0003, 0.0)
LONG_RUN = 100_000
"""Views of a run whose failure is computed from the rate of acceptance."""


@dataclass(frozen=True)
class GridProbe:
    """Measures what a pose shows of a surface; call it with ``cam_from_model`` (4x4, mm).

    Attributes
    ----------
    mesh
        The surface, model frame.
    camera
        Intrinsics of the views, at :data:`GRID` pixels.
    source_camera, source_pose, source_depth
        Intrinsics, pose and ``(H, W)`` depth, mm, of the source frame.
    """

    mesh: TriangleMesh
    camera: PinholeCamera
    source_camera: PinholeCamera
    source_pose: np.ndarray
    source_inverse_depth: np.ndarray

    @classmethod
    def of(cls, mesh: TriangleMesh, camera: PinholeCamera, source_pose: np.ndarray) -> "GridProbe":
        """The probe of a surface that a source frame of the views' own intrinsics saw."""
        source = camera.resized(camera.width // 4, camera.height // 4)
        raster = rasterise_depth(mesh, source, source_pose)
        return cls(mesh, camera.resized(*GRID), source, source_pose, raster.inverse_depth)

    def __call__(self, cam_from_model: np.ndarray) -> ViewStatistics:
        """Surface fraction and observed fraction of the view, and the camera's distance from the surface."""
        raster = rasterise_depth(self.mesh, self.camera, cam_from_model)
        shown = raster.face >= 0
        clearance = float(np.linalg.norm(self.mesh.vertices - camera_centre(cam_from_model), axis=1).min())
        if not shown.any():
            return ViewStatistics(0.0, 0.0, clearance)
        rays = self.camera.rays_cam(self.camera.pixel_grid())[shown] / raster.inverse_depth[shown][:, None]
        points = transform_points(self.source_pose @ inverse_rigid(cam_from_model), rays)
        u, v = np.rint(self.source_camera.project(points)).T
        inside = (u >= 0) & (v >= 0) & (u < self.source_camera.width) & (v < self.source_camera.height)
        inverse = self.source_inverse_depth[np.where(inside, v, 0).astype(int), np.where(inside, u, 0).astype(int)]
        # within 2 % of the distance: the views are coarse
        seen = inside & (np.abs(points[:, 2] * inverse - 1) < 0.02)
        return ViewStatistics(float(shown.mean()), float(seen.mean()), clearance)


def outcomes_of(
    distribution: Drawn, constraints: Constraints, probe: Callable[[np.ndarray], ViewStatistics], seed: int
) -> list[Outcome]:
    """Plan :data:`VIEWS` views: the value is the number of poses tried for one, the error the rate of refusals.

    After a first refusal the run would end, and so does this.
    """
    outcomes, attempts = [], []
    for index in range(VIEWS):
        try:
            planned = plan_pose(distribution, constraints, probe, seed=seed, index=index)
        except InputError as error:
            outcomes.append(Outcome("refuses", message=str(error), value=constraints.max_attempts))
            break
        attempts.append(planned.attempts)
        doubt = sampling_doubt(attempts)
        outcomes.append(Outcome("warns" if doubt else "works", 0.0, message=doubt, value=planned.attempts))
    return outcomes


def constrained(name: str, cone_deg: float, seed: int, value: float) -> list[Outcome]:
    """Plan views of a cone of this half-angle under one constraint."""
    mesh = ridged_bowl(TRIANGLES)
    mesh = mesh.moved(-mesh.vertices.mean(axis=0))
    probe = GridProbe.of(mesh, VIEW_CAMERA, CAM_FROM_MESH)
    reference = ReferencePose(CAM_FROM_MESH, np.zeros(3))
    cone = Cone(reference=reference, cone_deg=cone_deg, roll_deg=15, distance_min=0.9, distance_max=1.1, shift_mm=2)
    options: dict[str, Any] = {"reference_surface": probe(CAM_FROM_MESH).surface_fraction, name: value}
    return outcomes_of(cone, Constraints(**options), probe, seed)


@dataclass(frozen=True)
class Chance:
    """A distribution whose poses are accepted with a known probability: the acceptance is a number in the pose."""

    probability: float

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw a pose: the identity, with 1 or 0 in x."""
        pose = np.eye(4)
        pose[0, 3] = float(rng.random() < self.probability)
        return pose


def by_chance(seed: int, probability: float) -> list[Outcome]:
    """Plan views with a known rate of acceptance."""
    constraints = Constraints(min_surface=0.5)
    return outcomes_of(Chance(probability), constraints, lambda pose: ViewStatistics(pose[0, 3], 1, 1e3), seed)


def long_run(probability: float) -> list[Outcome]:
    """The error is the chance that a run of :data:`LONG_RUN` views fails."""
    none = (1 - probability) ** MAX_ATTEMPTS
    return [Outcome("works", -math.expm1(LONG_RUN * math.log1p(-none)) if none < 1 else 1.0)]


def tasks(seed: int, *, quick: bool) -> Iterator[Task]:
    """All measurements of the topic."""
    step, limit = 3 if quick else 1, Limit("LEAST_ACCEPTANCE", LEAST_ACCEPTANCE)
    yield from Sweep("acceptance", "known rate", ACCEPTANCES[::step], partial(by_chance, seed), limit).tasks()
    yield from Sweep("long run", f"{LONG_RUN} views", ACCEPTANCES[::step], long_run, limit).tasks()
    sweeps = {"min_observed": SHARES, "min_surface": SHARES, "min_clearance_mm": CLEARANCES_MM}
    for (name, values), cone_deg in itertools.product(sweeps.items(), CONES_DEG[:: 2 if quick else 1]):
        measure = partial(constrained, name, cone_deg, seed)
        yield from Sweep(name, f"cone {cone_deg:g}°", values[::step], measure, y=cone_deg).tasks()
