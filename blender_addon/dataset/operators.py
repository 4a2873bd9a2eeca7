"""Operators of the dataset's run in the background, and of what it has made."""

from pathlib import Path

import bpy

from ..pipeline.dataset.layout import CONTACT_SHEET
from ..pipeline.errors import InputError
from ..state import from_scene
from ..ui.operator import Messages, Reporting
from . import background_job
from .output import check_folder, existing_views, output_folder, save_settings, write_snapshot
from .view_preview import AboutOptions, dataset_options, listed_poses

SCRIPT = "render_dataset.py"


class ONEFRAME_OT_render_dataset(AboutOptions):
    """Render the dataset in the background; continues a stopped run, and extends a dataset if Views has grown"""

    bl_label = "Render Dataset"
    bl_options = {"REGISTER"}

    needs = (lambda _context: not background_job.is_running(), "A run is in progress: wait for it, or cancel it")

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        # before anything is written: check everything that the run would refuse
        loaded = from_scene.loaded_case(scene)
        options = dataset_options(scene)
        listed = listed_poses(loaded, options)
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
