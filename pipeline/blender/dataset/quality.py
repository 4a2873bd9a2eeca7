"""The cheapest setting whose views stay within the tolerance, found by rendering pilot views.

The pilots are the view that comes nearest to the surface, and others spread over the rest. Surfaces are tried from the
coarsest reduction to the one given, and on each of them the renderings in the order of their cost by the fixed model of
:mod:`pipeline.dataset.quality`. The first one that holds in all pilots is taken: a reduction that goes too far does so
for every renderer, and a renderer that shows something else does so on every surface. Its errors may reach
:data:`SAFETY` of the tolerance, which leaves room for the views that are no pilots.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...case.loaded_case import LoadedCase
from ...dataset.description import view_camera
from ...dataset.identity import geometry_hash
from ...dataset.options import DatasetOptions
from ...dataset.quality import FEW_FACES, REDUCTIONS, Setting, cost, renderings, tolerance_of
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
    unit_mm = footprint_mm * tolerance_of(options).outline_px
    x, y, z = map(float, source.pivot_model)
    exact_cost = cost("cycles", options.samples, camera, loaded.mesh)
    for tolerance_mm, mesh in _surfaces(loaded.mesh, camera, unit_mm, report):
        seen = rendered_view_of(loaded, (x, y, z), mesh)
        sha256 = geometry_hash(mesh)
        stand_ins = sorted(renderings(options), key=lambda each: cost(each[0], each[2], camera, mesh))
        for renderer, colour, samples in stand_ins:
            setting = Setting(renderer, colour, samples, tolerance_mm, len(mesh.faces), (x, y, z), sha256)
            if cost(renderer, samples, camera, mesh) >= exact_cost:
                break
            with ViewRenderer(loaded, seen, options, given_poses, setting=setting, threads=threads) as cheaper:
                views, milliseconds = _rendered(cheaper, poses)
            error = ViewError(0.0, 0.0)
            for view, truth in zip(views, truths, strict=True):
                error = error.worst(view_error(view, truth, camera))
            report(f"{_described(setting, loaded)}: {_off(error)}")
            if error.within(tolerance_of(options), SAFETY):
                saved = f"a view takes {milliseconds:.0f} ms instead of {exact_ms:.0f} ms here"
                return Choice(setting, mesh, f"quality {options.quality}: {_described(setting, loaded)}; {saved}")
            if (colour, samples) == (options.colour, options.samples):
                # what is wrong is the surface, with every renderer
                break
    faces, sha256 = len(loaded.mesh.faces), geometry_hash(loaded.mesh)
    whole = Setting("cycles", options.colour, options.samples, 0.0, faces, (x, y, z), sha256)
    return Choice(
        whole, loaded.mesh, f"quality {options.quality}: nothing cheaper than exact views holds the tolerance"
    )


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


def _surfaces(
    mesh: TriangleMesh, camera: PinholeCamera, unit_mm: float, report: Callable[[str], None]
) -> Iterator[tuple[float, TriangleMesh]]:
    """Reductions of a surface with their tolerances, mm, where they are worth it, and then the surface itself."""
    if len(mesh.faces) > FEW_FACES * camera.width * camera.height and unit_mm > 0:
        for factor in REDUCTIONS:
            # a number of few digits, which every machine writes alike
            tolerance_mm = float(f"{factor * unit_mm:.3g}")
            report(f"reducing the surface of {len(mesh.faces)} faces by {tolerance_mm:g} mm")
            reduced = simplified(mesh, tolerance_mm)
            if len(reduced.faces) > LEAST_GAIN * len(mesh.faces):
                break
            yield tolerance_mm, reduced
    yield 0.0, mesh


def _described(setting: Setting, loaded: LoadedCase) -> str:
    rays = "1 sample" if setting.samples == 1 else f"{setting.samples} samples"
    surface = f"the whole surface of {setting.faces} faces"
    if setting.mesh_tolerance_mm > 0:
        within = f"within {setting.mesh_tolerance_mm:.2g} mm of the surface"
        surface = f"{setting.faces} of {len(loaded.mesh.faces)} faces, {within}"
    return f"{setting.renderer}, {surface}, {setting.colour} colours, {rays}"


def _off(error: ViewError) -> str:
    return f"colours at most {error.colour:.2g}/255 off in pilot views, outlines {error.outline_px:.2g} px"
