"""The preview of one view of the dataset, rendered exactly as the run will, in the panel and as an image."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from ..class_registration import at_end
from ..pipeline.blender.dataset.job import light_of
from ..pipeline.blender.dataset.view_renderer import ViewRenderer
from ..pipeline.blender.render.engines import reference_view_of
from ..pipeline.case.loaded_case import LoadedCase, check_listed
from ..pipeline.dataset.option_arguments import merged_options
from ..pipeline.dataset.options import LIGHTS, NONE, DatasetOptions
from ..pipeline.errors import InputError
from ..pipeline.poses.pose_file import read_poses
from ..state import from_scene
from ..state.case_of_file import further_frames, lamp_of
from ..state.scene_files import Stamp, known_stamp
from ..ui.operator import Messages, NeedsAlignment, Reporting
from .background_job import in_window_words

PREVIEW_IMAGES = {light: f"OneFrame preview, light {light}" for light in LIGHTS}
"""Of a view in each light: the panel switches between before and after."""
PREVIEW_KEY, PREVIEW_SUMMARY = "oneframe_key", "oneframe_summary"
"""Custom properties of the preview's image: the key of everything it depends on, and its summary."""

THUMBNAIL_PX = 256


def dataset_options(scene: bpy.types.Scene) -> DatasetOptions:
    """The options of the dataset, as the script reads them from the saved case."""
    case_path = Path(bpy.path.abspath(scene.oneframe.case_path) or "the scene")
    return merged_options(from_scene.dataset_table(scene), {}, case_path)


def listed_poses(loaded: LoadedCase, options: DatasetOptions) -> np.ndarray | None:
    """``(N, 4, 4)`` cam_from_model, the explicit poses of the options, or ``None`` if they name a sampler."""
    if options.poses is None:
        return None
    mm_per_unit = loaded.case.mm_per_unit
    poses, _ = read_poses(options.poses, mesh_from_model=loaded.surface.mesh_from_model, mm_per_unit=mm_per_unit)
    check_listed(loaded, poses, Path(options.poses).name)
    return poses


class AboutOptions(NeedsAlignment, Reporting):
    """Mixin: the errors name options."""

    def worded(self, message: str) -> str:
        """The error with the options' labels."""
        return in_window_words(message)


class ONEFRAME_OT_preview_view(AboutOptions):
    """Render one view of the dataset exactly as the run will, and show it in the panel"""

    bl_label = "Preview View"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        options, index = dataset_options(scene), scene.oneframe.preview_view
        key, loaded = _view_key(scene), from_scene.loaded_case(scene)
        listed = listed_poses(loaded, options)
        count = options.count if listed is None else len(listed)
        if index >= count:
            raise InputError(f"view {index}: expected a view of the dataset, 0 to {count - 1}; choose a smaller number")
        with ViewRenderer(
            loaded,
            reference_view_of(loaded, options.engine, light_of(loaded, options)),
            options,
            listed,
        ) as renderer:
            view = renderer.make(index)
            messages = renderer.messages
        statistics = view.planned.statistics
        summary = (
            f"view {index}: surface covers {statistics.surface_fraction:.0%} of the image, the frame observed "
            f"{view.rendered.observed.sum() / max(int(view.rendered.mask.sum()), 1):.0%} of it"
        )
        _put_preview(PREVIEW_IMAGES[options.light], view.rendered.rgb, key, summary)
        return *messages, summary


def preview(scene: bpy.types.Scene) -> tuple[bpy.types.Image, str, bool] | None:
    """The preview in the chosen light: image, summary, and whether it is outdated; ``None`` if there is none."""
    light = scene.oneframe.dataset.light  # type: ignore[attr-defined]  # from DatasetOptions
    image = bpy.data.images.get(PREVIEW_IMAGES[light])
    if image is None or PREVIEW_KEY not in image:
        return None
    try:
        outdated = image[PREVIEW_KEY] != _view_key(scene, stamp=known_stamp)
    except InputError:
        outdated = True
    return image, image.get(PREVIEW_SUMMARY, ""), outdated


def _view_key(scene: bpy.types.Scene, *, stamp: Callable[[Path], Stamp] = from_scene.stamp) -> str:
    """A key that changes with everything that the previewed view depends on."""
    settings, options = scene.oneframe, dataset_options(scene)
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
    return hashlib.sha256(repr((content, settings.preview_view)).encode()).hexdigest()


def _put_preview(name: str, rgb: np.ndarray, key: str, summary: str) -> None:
    """Put a view ``(H, W, 3)``, code values 0..1, into an image and its thumbnail."""
    height, width = rgb.shape[:2]
    image = bpy.data.images.get(name)
    if image is None or tuple(image.size) != (width, height):
        _remove_previews(name)
        image = bpy.data.images.new(name, width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = rgb[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    # else Blender would count it among the user's images that are not saved
    image.pack()
    step = max(1, -(-max(width, height) // THUMBNAIL_PX))
    small = np.ascontiguousarray(rgba[::step, ::step])
    thumbnail = image.preview_ensure()
    thumbnail.image_size = small.shape[1::-1]
    thumbnail.image_pixels_float.foreach_set(small.ravel())
    image[PREVIEW_KEY], image[PREVIEW_SUMMARY] = key, summary


def _remove_previews(*names: str) -> None:
    for name in names or PREVIEW_IMAGES.values():
        image = bpy.data.images.get(name)
        if image is not None:
            bpy.data.images.remove(image)


PARTS = (at_end(_remove_previews),)
