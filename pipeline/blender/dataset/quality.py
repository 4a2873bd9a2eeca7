"""The cheapest setting whose views stay within the tolerance, found by rendering pilot views.

The pilots are the view that comes nearest to the surface, and others spread over the rest. The surface is reduced step
by step, the settings are tried in the order of their cost by the fixed model of :mod:`pipeline.dataset.quality`, and
the first one that holds in all pilots is taken. Its errors there may reach :data:`SAFETY` of the tolerance: that leaves
room for the views that are no pilots.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...case.loaded_case import LoadedCase
from ...dataset.description import view_camera
from ...dataset.identity import geometry_hash
from ...dataset.options import DatasetOptions
from ...dataset.quality import FEW_FACES, REDUCTIONS, Setting, renderings, tolerance_of
from ...dataset.view import RenderedView
from ...dataset.view_error import ViewError, view_error
from ...surface.mesh import TriangleMesh
from ...surface.simplification import simplified
from ..colour.reference_view import reference_view_of
from .reduced_surface import rendered_view_of
from .view_renderer import ViewRenderer

PLANNED, PILOTS = 48, 6
"""Views whose poses are looked at, and pilots among them."""

SAFETY = 0.7
"""Share of the tolerance that pilots may use."""

LEAST_GAIN = 0.8
"""A reduction that leaves more than this share of the faces is not worth its error."""

Surfaces = list[tuple[tuple[float, ...], TriangleMesh]]
"""Reductions, mm, and what they leave."""


@dataclass(frozen=True)
class Choice:
    """What was chosen, and what to say about it.

    Attributes
    ----------
    setting, mesh
        The setting, and the surface that it renders, model frame, mm.
    message
        What was chosen and what it saves.
    """

    setting: Setting
    mesh: TriangleMesh
    message: str


def choose_setting(
    loaded: LoadedCase,
    options: DatasetOptions,
    given_poses: np.ndarray | None,
    *,
    threads: int,
    report: Callable[[str], None],
) -> Choice:
    """Choose the setting of a dataset.

    Parameters
    ----------
    loaded, options, given_poses
        As of :class:`.ViewRenderer`, with a quality other than ``exact``.
    threads
        Number of render threads.
    report
        Receives what is going on, as it may take a minute.

    Raises
    ------
    InputError
        No pose meets the constraints.
    """
    report(f"quality {options.quality}: rendering {PILOTS} pilot views")
    source, camera = reference_view_of(loaded), view_camera(loaded, options)
    with ViewRenderer(loaded, source, options, given_poses, threads=threads) as exact:
        poses, nearest_mm = _pilot_poses(exact, options, given_poses)
        truths, exact_ms = _rendered(exact, poses)
    footprint_mm = nearest_mm / max(camera.fx, camera.fy)
    pixels = camera.width * camera.height
    surfaces: Surfaces = [((), loaded.mesh)]
    if len(loaded.mesh.faces) > FEW_FACES * pixels:
        surfaces += _reduced(loaded.mesh, footprint_mm * tolerance_of(options).outline_px, report)
    x, y, z = map(float, source.pivot_model)
    settings = [
        Setting(renderer, colour, samples, reductions, len(mesh.faces), (x, y, z), geometry_hash(mesh))
        for reductions, mesh in surfaces
        for renderer, colour, samples in renderings(options)
    ]
    whole = next(each for each in settings if is_exact(each, options))
    for setting in sorted(settings, key=lambda each: each.cost(pixels)):
        if setting == whole:
            break
        mesh = dict(surfaces)[setting.reductions_mm]
        reduced_source = rendered_view_of(loaded, setting, mesh)
        error = ViewError(0.0, 0.0)
        with ViewRenderer(loaded, reduced_source, options, given_poses, setting=setting, threads=threads) as renderer:
            views, milliseconds = _rendered(renderer, poses)
        for view, truth in zip(views, truths, strict=True):
            error = error.worst(view_error(view, truth, camera))
        if error.within(tolerance_of(options), SAFETY):
            saved = f"a view takes {milliseconds:.0f} ms instead of {exact_ms:.0f} ms here"
            return Choice(setting, mesh, f"{_described(setting, options, loaded)}; pilot views: {_off(error)}; {saved}")
    return Choice(
        whole, loaded.mesh, f"quality {options.quality}: nothing cheaper than exact views holds the tolerance"
    )


def is_exact(setting: Setting, options: DatasetOptions) -> bool:
    """Whether a setting is what ``--quality exact`` renders."""
    rendering = (setting.renderer, setting.colour, setting.samples)
    return not setting.reductions_mm and rendering == ("cycles", options.colour, options.samples)


def _pilot_poses(
    renderer: ViewRenderer, options: DatasetOptions, given_poses: np.ndarray | None
) -> tuple[list[np.ndarray], float]:
    """Poses of the pilots, and the least distance of a camera from the surface, mm."""
    count = options.count if given_poses is None else len(given_poses)
    if given_poses is None and options.sampler != "trajectory":
        # a drawn view does not depend on their number, which may grow
        numbers = np.arange(PLANNED)
    else:
        numbers = np.unique(np.linspace(0, count - 1, min(PLANNED, count)).round().astype(int))
    planned = [renderer.plan(int(number)) for number in numbers]
    clearances = np.array([each.statistics.clearance_mm for each in planned])
    nearest = int(np.argmin(clearances))
    spread = np.linspace(0, len(planned) - 1, min(PILOTS, len(planned))).round().astype(int)
    chosen = dict.fromkeys([nearest, *spread.tolist()])
    return [planned[number].cam_from_model for number in [*chosen][:PILOTS]], float(clearances[nearest])


def _rendered(renderer: ViewRenderer, poses: list[np.ndarray]) -> tuple[list[RenderedView], float]:
    """The views, and their median time in ms; the first one is for warming up."""
    renderer.render(poses[0])
    views, times = [], []
    for pose in poses:
        start = time.perf_counter()
        views.append(renderer.render(pose))
        times.append(time.perf_counter() - start)
    return views, float(np.median(times)) * 1e3


def _reduced(mesh: TriangleMesh, unit_mm: float, report: Callable[[str], None]) -> Surfaces:
    """Reductions of the surface that are worth it, by the factors :data:`.REDUCTIONS` of a tolerance."""
    surfaces: Surfaces = []
    reductions: tuple[float, ...] = ()
    faces = len(mesh.faces)
    for factor in REDUCTIONS:
        # a number of few digits, which every machine writes alike
        tolerance_mm = float(f"{factor * unit_mm:.3g}")
        if tolerance_mm > 0:
            report(f"reducing {len(mesh.faces)} faces by {tolerance_mm:g} mm")
            mesh, reductions = simplified(mesh, tolerance_mm), (*reductions, tolerance_mm)
            if len(mesh.faces) <= LEAST_GAIN * faces:
                surfaces.append((reductions, mesh))
                faces = len(mesh.faces)
    return surfaces


def _described(setting: Setting, options: DatasetOptions, loaded: LoadedCase) -> str:
    rays = "1 sample" if setting.samples == 1 else f"{setting.samples} samples"
    surface = f"the whole surface of {setting.faces} faces"
    if setting.reductions_mm:
        within = f"within {setting.mesh_tolerance_mm:.2g} mm of the surface"
        surface = f"{setting.faces} of {len(loaded.mesh.faces)} faces, {within}"
    return f"quality {options.quality}: {setting.renderer}, {surface}, {setting.colour} colours, {rays}"


def _off(error: ViewError) -> str:
    return f"colours at most {error.colour:.2g}/255 off, outlines {error.outline_px:.2g} px"
