"""Draws the first poses of the dataset in 3D views, as camera frusta around the surface.

The poses come from the planner of the dataset run itself. They are stored with a key of everything they depend on and
drawn only while the key matches the scene: they are never outdated, even after undo.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..class_registration import at_end
from ..pipeline.blender.dataset.view_planner import ViewPlanner
from ..pipeline.blender.render.engines import reference_view_of
from ..pipeline.camera.pinhole import PinholeCamera
from ..pipeline.case.loaded_case import LoadedCase
from ..pipeline.colour.reference_view import ReferenceView
from ..pipeline.dataset.option_arguments import merged_options
from ..pipeline.dataset.options import NONE, OPTIONS, DatasetOptions
from ..pipeline.errors import InputError
from ..pipeline.poses.constraints import PlannedPose
from ..pipeline.poses.pose_file import read_poses
from ..pipeline.transforms import inverse_rigid, transform_points
from ..state import from_scene
from ..state.known_case import further_frames, lamp_of
from ..state.scene_files import Stamp, known_stamp
from ..ui.frame_view import shows_frame
from ..ui.pane import Pane
from ..ui.strokes import Strokes

LENGTH = 0.10
"""Length of a frustum, relative to the camera's distance from the pivot."""

LINE_WIDTH = 1.5
LEAST_COLOUR, MOST_COLOUR = np.array([1.0, 0.35, 0.05]), np.array([0.1, 0.85, 0.45])
"""Of the views with the smallest and with the largest observed fraction."""

MIN_RANGE = 0.01
"""Fractions that differ by less get similar colours."""

_EDGES = np.array([[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1], [1, 5], [5, 2]])


@dataclass(frozen=True)
class PlannedPoses:
    """The first poses of a dataset.

    Attributes
    ----------
    key
        Key of everything they depend on.
    count
        Number of views of the whole dataset.
    lines
        ``(N, 10, 2, 3)`` ends of the frusta's lines, model frame, mm.
    observed
        ``(N,)`` fraction of the surface in view that the frame observed, 0..1.
    attempts
        Mean number of poses tried for one that meets the constraints.
    """

    key: str
    count: int
    lines: np.ndarray
    observed: np.ndarray
    attempts: float


_shown: list[PlannedPoses] = []
"""The poses planned last, unless they are hidden."""


def dataset_options(scene: bpy.types.Scene) -> DatasetOptions:
    """The options of the dataset, as the script reads them from the saved case."""
    case_path = Path(bpy.path.abspath(scene.oneframe.case_path) or "the scene")
    return merged_options(from_scene.dataset_table(scene), {}, case_path)


def content_key(
    scene: bpy.types.Scene, options: DatasetOptions, *, stamp: Callable[[Path], Stamp] = from_scene.stamp
) -> str:
    """A key that changes with everything that the views of the dataset depend on."""
    settings = scene.oneframe
    files = [
        # not resolved: that would look at the disk
        Path(bpy.path.abspath(path))
        for path in (settings.frame_path, from_scene.surface_of(scene).oneframe.mesh_path)
    ]
    if options.poses is not None:
        files.append(Path(options.poses))
    stamps = [(str(path), *stamp(path)) for path in files]
    pose = from_scene.cam_from_model(scene).tobytes()
    further = [(each.image, each.cam_from_mesh.tolist()) for each in further_frames(scene)]
    lamp = None if options.light == NONE else lamp_of(scene)
    content = (options, pose, from_scene.camera(scene), settings.distortion_text, settings.units, stamps, further, lamp)
    return hashlib.sha256(repr(content).encode()).hexdigest()


def pose_key(scene: bpy.types.Scene, *, stamp: Callable[[Path], Stamp] = from_scene.stamp) -> str:
    """A key like :func:`content_key` for the poses only: options of rendering do not change it."""
    # of what no pose depends on, the defaults
    fixed: dict[str, Any] = {name: option.default for name, option in OPTIONS.items() if not option.moves}
    options = replace(dataset_options(scene), **fixed)
    return content_key(scene, options, stamp=stamp)


def listed_poses(loaded: LoadedCase, options: DatasetOptions) -> np.ndarray | None:
    """``(N, 4, 4)`` cam_from_model, the explicit poses of the options, or ``None`` if they name a sampler."""
    if options.poses is None:
        return None
    mm_per_unit = loaded.case.mm_per_unit
    return read_poses(options.poses, mesh_from_model=loaded.surface.mesh_from_model, mm_per_unit=mm_per_unit)[0]


def plan(scene: bpy.types.Scene, number: int) -> PlannedPoses:
    """Plan the first ``number`` poses of the dataset, and show them."""
    options = dataset_options(scene)
    key, loaded = pose_key(scene), from_scene.loaded_case(scene)
    listed = listed_poses(loaded, options)
    count = options.count if listed is None else len(listed)
    reference = reference_view_of(loaded)
    planner = ViewPlanner(loaded, reference, options, listed)
    planned = [planner.plan(index) for index in range(min(number, count))]
    lines = frusta(planned, planner.camera, reference)
    statistics = [view.statistics for view in planned]
    observed, attempts = np.array([each.observed_fraction for each in statistics]), [view.attempts for view in planned]
    _shown[:] = [PlannedPoses(key, count, lines, observed, float(np.mean(attempts)))]
    return _shown[0]


def frusta(planned: list[PlannedPose], camera: PinholeCamera, reference: ReferenceView) -> np.ndarray:
    """``(N, 10, 2, 3)`` ends of the lines of each pose's frustum, model frame, mm; a triangle marks the image's top."""
    width, height = camera.size_wh
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height], [width / 2, -height / 4]]) - 0.5
    rays = np.concatenate([np.zeros((1, 3)), camera.rays_cam(corners)])
    lines = np.empty((len(planned), len(_EDGES), 2, 3))
    for number, view in enumerate(planned):
        pivot_cam = transform_points(view.cam_from_model, reference.pivot_model[None])[0]
        length = LENGTH * float(np.linalg.norm(pivot_cam))
        lines[number] = transform_points(inverse_rigid(view.cam_from_model), length * rays)[_EDGES]
    return lines


def hide() -> None:
    """Hide and discard the poses."""
    _shown.clear()


def shown() -> PlannedPoses | None:
    """The poses planned last, even if outdated; ``None`` if hidden."""
    return _shown[0] if _shown else None


def is_current(scene: bpy.types.Scene, *, stamp: Callable[[Path], Stamp] = from_scene.stamp) -> bool:
    """Whether the planned poses match the scene; for drawing, with ``stamp`` = :func:`.known_stamp`."""
    try:
        return bool(_shown) and _shown[0].key == pose_key(scene, stamp=stamp)
    except InputError:
        return False


class PlannedFrusta(Pane):
    """The poses around the surface; in the camera view the frusta would surround the eye."""

    place = "POST_VIEW"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(_shown) and not shows_frame(context) and is_current(context.scene, stamp=known_stamp)

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        planned, shader = _shown[0], gpu.shader.from_builtin("POLYLINE_FLAT_COLOR")
        low, high = planned.observed.min(), planned.observed.max()
        blend = (planned.observed[:, None] - low) / max(high - low, MIN_RANGE)
        colours = np.concatenate([LEAST_COLOUR * (1 - blend) + MOST_COLOUR * blend, np.ones_like(blend)], axis=1)
        vertices = planned.lines.reshape(-1, 3).astype(np.float32)
        per_vertex = np.repeat(colours, 2 * len(_EDGES), axis=0).astype(np.float32)
        batch = batch_for_shader(shader, "LINES", {"pos": vertices, "color": per_vertex})
        gpu.state.depth_test_set("LESS_EQUAL")
        with gpu.matrix.push_pop():
            gpu.matrix.multiply_matrix(from_scene.surface_of(context.scene).matrix_world)
            shader.bind()
            shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
            shader.uniform_float("lineWidth", LINE_WIDTH * context.preferences.system.ui_scale)
            batch.draw(shader)
        gpu.state.depth_test_set("NONE")


PARTS = (at_end(hide),)
