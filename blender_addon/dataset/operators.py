"""Operators of the dataset: preview poses and one view, run in the background."""

import textwrap
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np

from ..class_registration import at_end, listening
from ..pipeline.blender.dataset.job import light_of, own_instruments
from ..pipeline.blender.dataset.view_renderer import ViewRenderer
from ..pipeline.blender.render.engines import reference_view_of
from ..pipeline.dataset.description import input_files
from ..pipeline.dataset.layout import CONTACT_SHEET
from ..pipeline.dataset.options import LIGHTS
from ..pipeline.errors import InputError
from ..state import from_scene
from ..state.events import areas
from ..state.scene_files import Stamp, known_stamp
from ..ui.frame_view import shows_frame
from ..ui.operator import Messages, NeedsAlignment, Reporting
from . import background_job, pose_preview
from .existing_dataset import check_folder, existing_views
from .snapshot import save_settings, usual_output, write_snapshot
from .wording import in_window_words

SCRIPT = "render_dataset.py"
PREVIEW_IMAGES = {light: f"OneFrame preview, light {light}" for light in LIGHTS}
"""Of a view in each light: the panel switches between before and after."""
PREVIEW_KEY, PREVIEW_SUMMARY = "oneframe_key", "oneframe_summary"
"""Custom properties of the preview's image: the key of everything it depends on, and its summary."""

THUMBNAIL_PX = 256
POPUP_CHARACTERS = 90


class _AboutOptions(NeedsAlignment, Reporting):
    """Mixin: the errors name options."""

    def worded(self, message: str) -> str:
        """The error with the options' labels."""
        return in_window_words(message)


class ONEFRAME_OT_preview_poses(_AboutOptions):
    """Show the first poses of the dataset as cameras around the surface; orange: little observed by the frame"""

    bl_label = "Preview Poses"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> Messages:
        planned = pose_preview.plan(context.scene, context.scene.oneframe.preview_poses)
        message = (
            f"{len(planned.lines)} of {planned.count} poses: the frame observed {planned.observed.min():.0%} to "
            f"{planned.observed.max():.0%} of the surface in view; {planned.attempts:.1f} attempts per pose"
        )
        if shows_frame(context):
            return message, "the poses are seen from elsewhere: orbit with the middle button, then Home"
        return message, "press Home in the view to see all of them"


class ONEFRAME_OT_hide_poses(Reporting):
    """Hide the previewed poses"""

    bl_label = "Hide Poses"
    bl_options = {"REGISTER"}

    needs = (lambda _context: pose_preview.shown() is not None, "No poses are shown")

    def run(self, context: bpy.types.Context) -> None:
        pose_preview.hide()


class ONEFRAME_OT_preview_view(_AboutOptions):
    """Render one view of the dataset exactly as the run will, and show it in the panel and in an Image Editor"""

    bl_label = "Preview View"
    bl_options = {"REGISTER"}

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        options, index = pose_preview.dataset_options(scene), scene.oneframe.preview_view
        key, loaded = _view_key(scene), from_scene.loaded_case(scene)
        listed = pose_preview.listed_poses(loaded, options)
        count = options.count if listed is None else len(listed)
        if index >= count:
            raise InputError(f"view {index}: expected a view of the dataset, 0 to {count - 1}; choose a smaller number")
        with ViewRenderer(
            loaded,
            reference_view_of(loaded, options.engine, light_of(loaded, options)),
            options,
            listed,
            own_instruments(input_files(loaded.case, options)),
        ) as renderer:
            view = renderer.make(index)
            messages = renderer.messages
        statistics = view.planned.statistics
        summary = (
            f"view {index}: surface covers {statistics.surface_fraction:.0%} of the image, the frame observed "
            f"{view.rendered.observed.sum() / max(int(view.rendered.mask.sum()), 1):.0%} of it"
        )
        image = _put_preview(PREVIEW_IMAGES[options.light], view.rendered.rgb, key, summary)
        _show_in_image_editors(image)
        return *messages, summary


class ONEFRAME_OT_render_dataset(_AboutOptions):
    """Render the dataset in the background; continues a stopped run, and extends a dataset if Views has grown"""

    bl_label = "Render Dataset"
    bl_options = {"REGISTER"}

    needs = (lambda _context: not background_job.is_running(), "A run is in progress: wait for it, or cancel it")

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        # before anything is written: check everything that the run would refuse
        loaded = from_scene.loaded_case(scene)
        options = pose_preview.dataset_options(scene)
        listed = pose_preview.listed_poses(loaded, options)
        out = output_folder(scene)
        count = options.count if listed is None else len(listed)
        check_folder(out, loaded, options, listed)
        had = existing_views(out)
        case_path = write_snapshot(scene, out)
        save_settings(scene)
        scene.oneframe.dataset_out = str(out)
        arguments = [str(case_path), "--out", str(out), "--progress-seconds", "1", "--end-with-input"]
        background_job.start(SCRIPT, arguments, out)
        if had is not None:
            how = f"extending the dataset from {had} to {count} views" if had < count else "continuing the dataset"
            return (f"{how} in {out} in the background; you can continue to work",)
        return (f"rendering to {out} in the background; you can continue to work",)


class ONEFRAME_OT_cancel_dataset(Reporting):
    """Stop the run; finished views stay, and Render Dataset continues after them"""

    bl_label = "Cancel Run"
    bl_options = {"REGISTER"}

    needs = (lambda _context: background_job.is_running(), "No run is in progress")

    def run(self, context: bpy.types.Context) -> None:
        job = background_job.current()
        if job is not None:
            job.cancel()


class ONEFRAME_OT_contact_sheet(Reporting):
    """Show a picture of some of the views, in a window of Blender's own"""

    bl_label = "Contact Sheet"
    bl_options = {"REGISTER"}

    needs = (lambda context: result_folder(context.scene) is not None, "Render the dataset first")

    def run(self, context: bpy.types.Context) -> None:
        folder = result_folder(context.scene)
        path = folder / CONTACT_SHEET if folder is not None else Path(CONTACT_SHEET)
        if not path.is_file():
            raise InputError(f"{path}: expected the contact sheet of a dataset, found none; render the dataset first")
        image = bpy.data.images.load(str(path), check_existing=True)
        image.reload()
        if bpy.app.background:
            return
        bpy.ops.wm.window_new()
        area = context.window_manager.windows[-1].screen.areas[0]
        area.ui_type = "IMAGE_EDITOR"
        area.spaces.active.image = image


def result_folder(scene: bpy.types.Scene) -> Path | None:
    """The dataset's folder if it exists."""
    text = scene.oneframe.dataset_out
    path = from_scene.absolute_path(text) if text else None
    return path if path is not None and path.is_dir() else None


def output_folder(scene: bpy.types.Scene) -> Path:
    """The dataset's folder: the chosen one, or the usual one."""
    chosen = scene.oneframe.dataset_out
    return from_scene.absolute_path(chosen) if chosen else usual_output(scene)


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
    key = pose_preview.content_key(scene, pose_preview.dataset_options(scene), stamp=stamp)
    return f"{key} {scene.oneframe.preview_view}"


def _put_preview(name: str, rgb: np.ndarray, key: str, summary: str) -> bpy.types.Image:
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
    return image


def _show_in_image_editors(image: bpy.types.Image) -> None:
    """Show a preview in the Image Editors that show no other image than one."""
    for _window, area in areas("IMAGE_EDITOR"):
        space = area.spaces.active
        if area.ui_type == "IMAGE_EDITOR" and (space.image is None or space.image.name in PREVIEW_IMAGES.values()):
            space.image = image
            area.tag_redraw()


def _job_changed(job: background_job.BackgroundJob) -> None:
    """Redraw the panel, and at the end the view; show a popup if the run has failed."""
    manager = bpy.context.window_manager
    for _window, area in areas("VIEW_3D"):
        for region in area.regions:
            if region.type == "UI" or not job.running:
                region.tag_redraw()
    # without a window Blender cannot open a menu, and reports no error
    if job.running or not job.error or bpy.app.background or not manager.windows:
        return

    def draw(menu: bpy.types.UIPopupMenu, _context: bpy.types.Context) -> None:
        for line in textwrap.wrap(job.error, POPUP_CHARACTERS):
            menu.layout.label(text=line)

    with bpy.context.temp_override(window=manager.windows[0]):
        manager.popup_menu(draw, title="The Dataset Run Has Failed", icon="ERROR")


def _remove_previews(*names: str) -> None:
    for name in names or PREVIEW_IMAGES.values():
        image = bpy.data.images.get(name)
        if image is not None:
            bpy.data.images.remove(image)


PARTS = (at_end(_remove_previews), listening(background_job.listeners, _job_changed))
