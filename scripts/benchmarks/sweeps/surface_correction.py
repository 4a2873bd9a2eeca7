"""Trials of the corrected surface: frames of the true one are registered to a wrong one, which they then correct."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from oneframe.case.frame import PosedFrame
from oneframe.case.loaded_case import LoadedCase
from oneframe.colour.lens_shading import LensShading, lens_shading_of
from oneframe.colour.ray_tracer import RayTracer
from oneframe.colour.reference_view import traced_view_of
from oneframe.colour.shading import ColouredSurface
from oneframe.errors import InputError
from oneframe.evaluation.scores.similarity import similarity
from oneframe.images.pixel_values import to_uint8
from oneframe.projection.rendered_view import RenderedView
from oneframe.projection.visible_surface import central_point
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.registration.colour_sources import Candidates, evenly
from oneframe.registration.register_frames import (
    CaseRegistrar,
    FurtherFrame,
    RegistrationRun,
    accepted_poses,
    colouring_frames,
    marked,
    small_frame,
)
from oneframe.surface.deviation import SurfaceTree
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface_correction.control_points import neighbour_means
from oneframe.surface_correction.correct_surface import (
    LONGER_SIDE_PX,
    MOST_FRAMES,
    SurfaceCorrection,
    correct_surface,
)
from oneframe.surface_correction.surface_check import SurfaceCheck

from ..alignment.registration_trials import pose_errors
from .registration import rough

TRUE = "true"
WRONG = FLOOR, WALL, BOTH, NOISE, SMOOTH = (
    "floor 2",
    "wall 1.5",
    "floor 1, wall 1.5, noise 0.15",
    "noise 0.3",
    "smoothed",
)
"""What is wrong with a surface, mm."""
FLOOR_AT, WALL_AT, ELSEWHERE = (0.60, 0.48), (0.75, 0.46), 0.05
"""Places in the sample's frame, relative to its size, and by how much of it the seed moves them."""
FLOOR_MM, WALL_MM, LARGER = 7.5, 8.0, (0.8, 1.25)
"""Radii of what is moved, and the factors by which the seed changes radii and amounts."""
ROUNDS = 25, 45
"""Of averaging with the neighbours: smoothed too much."""
CHANGED_MM, WRONG_MM = 0.2, 0.3
"""Displaced by more counts as changed; farther from the true surface than this must not pass as confirmed."""


@dataclass(frozen=True)
class FilmedScene:
    """A case with the true surface, as far as it is known, and frames at their true poses.

    Attributes
    ----------
    name, loaded
        Of the data, and the case in its true light.
    frames, left_out
        Those that are registered, at the size of registration, and those that views are compared with.
    tracked
        Whether the frames are a film's.
    """

    name: str
    loaded: LoadedCase
    frames: tuple[PosedFrame, ...]
    left_out: tuple[PosedFrame, ...]
    tracked: bool

    @cached_property
    def tree(self) -> SurfaceTree:
        """Rays against the true surface."""
        return SurfaceTree(self.loaded.surface.mesh)

    @cached_property
    def true_views(self) -> list[RenderedView]:
        """The true surface from where frames were left out."""
        return rendered(self.loaded, self.left_out)


@dataclass(frozen=True)
class CorrectionTrial:
    """One corrected surface: a row of the table.

    Attributes
    ----------
    scene, surface, seed
        The data, what was wrong, and the seed.
    accepted, refused
        Frames accepted on the wrong surface; why it was not corrected, or empty.
    said
        Share of the places that registration itself says to be wrong.
    before, before_95, changed, changed_95, elsewhere, elsewhere_95
        Distance from the true surface, mm, median and 95 % of the confirmed vertices, where changed and elsewhere.
    known, confirmed, confirmed_changed
        Share of the vertices that frames tell of; of these the share confirmed, and that of the changed ones.
    wrong_confirmed, passed
        Of the confirmed vertices those over 0.3 mm off; of those over 0.3 mm off, that frames tell of, the confirmed.
    within, within_elsewhere
        Share within two standard deviations, of what is confirmed.
    ssim_before, ssim, ssim_true, ssim_least
        Of views beside photographs that were left out, over the changed part, coloured from the case's frame, of the
        wrong, the corrected and the true surface; and the least gain of a photograph.
    ssim_confirmed, ssim_confirmed_true
        The same over what is changed and confirmed.
    deg_before, deg, px_before, px
        Of frames accepted on both surfaces: median rotation from the true pose, and displacement of the surface, at the
        size of registration.
    seconds
        Processor time of the correction.
    """

    scene: str
    surface: str
    seed: int
    accepted: int
    refused: str = ""
    said: float = math.nan
    before: float = math.nan
    before_95: float = math.nan
    changed: float = math.nan
    changed_95: float = math.nan
    elsewhere: float = math.nan
    elsewhere_95: float = math.nan
    known: float = math.nan
    confirmed: float = math.nan
    confirmed_changed: float = math.nan
    wrong_confirmed: float = math.nan
    passed: float = math.nan
    within: float = math.nan
    within_elsewhere: float = math.nan
    ssim_before: float = math.nan
    ssim: float = math.nan
    ssim_true: float = math.nan
    ssim_least: float = math.nan
    ssim_confirmed: float = math.nan
    ssim_confirmed_true: float = math.nan
    deg_before: float = math.nan
    deg: float = math.nan
    px_before: float = math.nan
    px: float = math.nan
    seconds: float = math.nan


def correction_trial(
    scene: FilmedScene, surface: str, seed: int, mesh: TriangleMesh, off_mm: np.ndarray | None
) -> CorrectionTrial:
    """Register a scene's frames to a mesh, correct it, and compare.

    ``(V,)`` mm is by how much its vertices were displaced; ``None`` if the true surface is not known.
    """
    loaded = with_surface(scene.loaded, mesh)
    posed, check = registered(scene, loaded)
    said = math.nan if check is None else check.share
    trial = CorrectionTrial(scene.name, surface, seed, len(posed), said=said)
    chosen = [sorted(posed)[at] for at in evenly(len(posed), MOST_FRAMES)]
    frames = [loaded.frame, *(replace(scene.frames[at], cam_from_model=posed[at]) for at in chosen)]
    frames = [small_frame(frame, LONGER_SIDE_PX) for frame in frames]
    began = time.process_time()
    try:
        found = correct_surface(mesh, frames, _light_of(loaded))
    except InputError as error:
        return replace(trial, refused=str(error))
    values: dict[str, Any] = {"seconds": time.process_time() - began, "known": float(np.isfinite(found.std_mm).mean())}
    values["confirmed"] = _share(found.confirmed, np.isfinite(found.std_mm))
    changed = np.ones(len(found.confirmed), bool)
    if off_mm is not None:
        changed = off_mm > CHANGED_MM
        values |= _errors(scene, mesh, found, changed)
        values |= _poses(scene, posed, registered(scene, with_surface(loaded, found.mesh))[0])
    values |= _views(scene, loaded, found, changed, exact=off_mm is not None)
    return replace(trial, **values)


def with_surface(loaded: LoadedCase, mesh: TriangleMesh) -> LoadedCase:
    """The case with another surface."""
    return replace(loaded, surface=replace(loaded.surface, mesh=mesh))


def registered(scene: FilmedScene, loaded: LoadedCase) -> tuple[dict[int, np.ndarray], SurfaceCheck | None]:
    """``cam_from_model`` of the frames that are accepted, by their places, and what they tell of the surface."""
    registrar, candidates = CaseRegistrar(loaded), Candidates()
    run = RegistrationRun(registrar, candidates, is_film=scene.tracked)
    for number, frame in enumerate(scene.frames):
        name = "" if scene.tracked else frame.path.name
        run.register(FurtherFrame(name, number, to_uint8(frame.image), frame.valid))
    judged = marked(run.judged(), run.change())
    return accepted_poses(judged), registrar.checked_surface(colouring_frames(candidates, judged))


def wrong_surface(surface: str, loaded: LoadedCase, rng: np.random.Generator) -> TriangleMesh:
    """The sample's surface made wrong in one of the ways of :data:`WRONG`."""
    mesh, forward = loaded.surface.mesh, loaded.frame.cam_from_model[2, :3]
    if surface == SMOOTH:
        vertices, means = mesh.vertices, neighbour_means(mesh)
        for _ in range(rng.integers(*ROUNDS)):
            vertices = means @ vertices
        return replace(mesh, vertices=vertices)
    offset = np.zeros_like(mesh.vertices)
    if surface in (FLOOR, BOTH):
        amount_mm, bump = _bump(loaded, FLOOR_AT, FLOOR_MM, rng)
        offset += (2.0 if surface == FLOOR else 1.0) * amount_mm * bump * forward
    if surface in (WALL, BOTH):
        amount_mm, bump = _bump(loaded, WALL_AT, WALL_MM, rng)
        normal = (mesh.smooth_normals * bump).sum(axis=0)
        across = normal - (normal @ forward) * forward
        offset += 1.5 * amount_mm * bump * across / np.linalg.norm(across)
    moved = replace(mesh, vertices=mesh.vertices + offset)
    rms_mm = {BOTH: 0.15, NOISE: 0.3}.get(surface)
    return moved if rms_mm is None else rough(moved, rms_mm, rng)


def _bump(
    loaded: LoadedCase, at: tuple[float, float], radius_mm: float, rng: np.random.Generator
) -> tuple[float, np.ndarray]:
    """A factor of either sign, and ``(V, 1)`` from 1 at a place of the frame to 0 at a radius."""
    frame, vertices = small_frame(loaded.frame), loaded.surface.mesh.vertices
    u, v = np.rint((at + rng.uniform(-ELSEWHERE, ELSEWHERE, 2)) * frame.camera.size_wh).astype(int)
    depth_mm = np.zeros(frame.camera.shape_hw)
    depth_mm[v, u] = rasterise_depth(loaded.surface.mesh, frame.camera, frame.cam_from_model).depth_mm[v, u]
    apart_mm = np.linalg.norm(vertices - central_point(depth_mm, frame.camera, frame.cam_from_model), axis=1)
    factor, radius_mm = rng.choice((-1.0, 1.0)) * rng.uniform(*LARGER), radius_mm * rng.uniform(*LARGER)
    return factor, (np.maximum(1 - (apart_mm / radius_mm) ** 2, 0) ** 2)[:, None]


def _light_of(loaded: LoadedCase) -> LensShading | None:
    return None if loaded.case.light is None else lens_shading_of(loaded)


def _share(part: np.ndarray, of: np.ndarray) -> float:
    return float(part[of].mean()) if of.any() else math.nan


def _errors(scene: FilmedScene, mesh: TriangleMesh, found: SurfaceCorrection, changed: np.ndarray) -> dict[str, float]:
    known, confirmed = np.isfinite(found.std_mm), found.confirmed
    before, after = np.zeros((2, len(known)))
    before[known], after[known] = (scene.tree.distances(each.vertices[known]) for each in (mesh, found.mesh))
    values = {
        "confirmed_changed": _share(confirmed, known & changed),
        "wrong_confirmed": _share(after > WRONG_MM, confirmed),
        "passed": _share(confirmed, known & (after > WRONG_MM)),
        "within": _share(after < 2 * found.std_mm, confirmed & changed),
        "within_elsewhere": _share(after < 2 * found.std_mm, confirmed & ~changed),
    }
    for name, errors, part in (
        ("before", before, changed),
        ("changed", after, changed),
        ("elsewhere", after, ~changed),
    ):
        own = errors[confirmed & part]
        if len(own):
            values[name], values[f"{name}_95"] = np.quantile(own, (0.5, 0.95)).tolist()
    return values


def _poses(scene: FilmedScene, before: dict[int, np.ndarray], after: dict[int, np.ndarray]) -> dict[str, float]:
    values: dict[str, float] = {}
    both = sorted(before.keys() & after.keys())
    for end, poses in (("_before", before), ("", after)) if both else ():
        frames = [(poses[at], scene.frames[at]) for at in both]
        errors = [
            pose_errors(pose, each.cam_from_model, scene.loaded.surface.mesh, each.camera) for pose, each in frames
        ]
        values[f"deg{end}"], _, values[f"px{end}"] = np.median(errors, axis=0).tolist()
    return values


def _views(
    scene: FilmedScene, loaded: LoadedCase, found: SurfaceCorrection, changed: np.ndarray, *, exact: bool
) -> dict[str, float]:
    corrected = with_surface(loaded, found.mesh)
    sides = [*(rendered(each, scene.left_out) for each in (loaded, corrected)), scene.true_views]
    whole, sure = list[list[float]](), list[list[float]]()
    for number, frame in enumerate(scene.left_out):
        face = rasterise_depth(found.mesh, frame.camera, frame.cam_from_model).face
        views = [side[number] for side in sides]
        seen = frame.valid & (face >= 0) & np.all([view.observed for view in views], axis=0)
        for scores, part in ((whole, changed), (sure, changed & found.confirmed)):
            mask = seen & part[found.mesh.faces[face]].all(axis=-1)
            if mask.any():
                scores.append([similarity(frame.image, view.rgb, mask).ssim for view in views])
    values = {}
    if whole:
        values["ssim_before"], values["ssim"], true = np.mean(whole, axis=0).tolist()
        values["ssim_least"] = min(after - before for before, after, _ in whole)
        values |= {"ssim_true": true} if exact else {}
    if sure:
        _, values["ssim_confirmed"], true = np.mean(sure, axis=0).tolist()
        values |= {"ssim_confirmed_true": true} if exact else {}
    return values


def rendered(loaded: LoadedCase, frames: Sequence[PosedFrame]) -> list[RenderedView]:
    """Views from where frames are, coloured from the case's own in the light that it has there."""
    light = _light_of(loaded)
    reference = traced_view_of(loaded, light)
    tracer = RayTracer(ColouredSurface(reference.mesh, reference.views, light=light), frames[0].camera)
    return [tracer.render(frame.cam_from_model) for frame in frames]
