"""The panel Dataset: options, previews, the run and its result."""

import bpy

from ..pipeline.dataset.layout import CONTACT_SHEET
from ..pipeline.dataset.options import LENS, NONE, PATHS, SHADOWS, option_groups
from ..pipeline.errors import InputError
from ..state import from_scene
from ..state.case_of_file import lamp_of
from ..ui.panel import AdvancedPanel, SidebarPanel, draw_text
from . import background_job, operators, view_preview
from .background_job import in_window_words


class ONEFRAME_PT_dataset(AdvancedPanel):
    """Render a dataset of posed views"""

    bl_label = "Dataset"
    bl_order = 5

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        # a run goes on, and can be cancelled, whatever becomes of the scene
        return from_scene.is_set_up(context.scene) or background_job.current() is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.oneframe
        layout.use_property_split, layout.use_property_decorate = True, False
        options = settings.dataset
        column = layout.column(align=True)
        column.prop(options, "count")
        column.prop(options, "sampler")
        try:
            view_preview.dataset_options(context.scene)
        except InputError as error:
            draw_text(layout, in_window_words(str(error)), icon="ERROR")


class ONEFRAME_PT_dataset_preview(SidebarPanel):
    """Preview one view"""

    bl_parent_id = "ONEFRAME_PT_dataset"
    bl_label = "Preview"

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        light = scene.oneframe.dataset.light  # type: ignore[attr-defined]  # from DatasetOptions
        row = layout.row(align=True)
        row.label(icon="LIGHT_POINT")
        for choice, text in ((NONE, "Frame"), (LENS, "Lens"), (SHADOWS, "Shadows")):
            row.prop_enum(scene.oneframe.dataset, "light", choice, text=text)
        if light != NONE and lamp_of(scene) is None:
            layout.operator("oneframe.find_lamp", icon="VIEWZOOM")
        row = layout.row(align=True)
        row.operator("oneframe.preview_view", text="View", icon="IMAGE_DATA")
        row.prop(scene.oneframe, "preview_view", text="")
        found = view_preview.preview(scene)
        if found is not None:
            image, summary, is_outdated = found
            if is_outdated:
                draw_text(layout, "The case has changed. Preview the view again.", icon="ERROR")
            else:
                layout.template_icon(image.preview_ensure().icon_id, scale=9)
                draw_text(layout, summary)


class ONEFRAME_PT_dataset_options(SidebarPanel):
    """How the views are rendered"""

    bl_parent_id = "ONEFRAME_PT_dataset"
    bl_label = "More Options"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, options = self.layout, context.scene.oneframe.dataset
        layout.use_property_split, layout.use_property_decorate = True, False
        column = layout.column(align=True)
        for option in option_groups()["views"]:
            if option.key not in {"count", *PATHS}:
                column.prop(options, option.key)
        column.prop(options, "stereo_mm")
        if options.stereo_mm or options.converge_mm:  # type: ignore[attr-defined]  # from DatasetOptions
            column.prop(options, "converge_mm")
        column.prop(options, "video")
        if options.video:  # type: ignore[attr-defined]  # from DatasetOptions
            column.prop(options, "video_frames")


class ONEFRAME_PT_dataset_run(SidebarPanel):
    """Render the dataset in the background"""

    bl_parent_id = "ONEFRAME_PT_dataset"
    bl_label = "Run"

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        layout.prop(scene.oneframe, "dataset_out", text="")
        layout.operator_context = "INVOKE_DEFAULT"
        job = background_job.current()
        if not background_job.is_running():
            layout.operator("oneframe.render_dataset", icon="RENDER_ANIMATION")
        if job is not None:
            _draw_job(layout, job)
        folder = operators.result_folder(scene)
        if folder is not None:
            row = layout.row(align=True)
            row.operator("wm.path_open", text="Open Folder", icon="FILE_FOLDER").filepath = str(folder)
            if (folder / CONTACT_SHEET).is_file():
                row.operator("oneframe.contact_sheet", icon="IMAGE_REFERENCE")


def _draw_job(layout: bpy.types.UILayout, job: background_job.BackgroundJob) -> None:
    progress = job.progress
    if job.running:
        if progress is None:
            layout.progress(factor=0.0, text="Starting background Blender")
        else:
            left = f", {progress.left} left" if progress.left else ""
            text = f"{progress.count} / {progress.total} {progress.noun}{left}"
            layout.progress(factor=progress.count / max(progress.total, 1), text=text)
        row = layout.row()
        row.enabled = not job.cancelled
        row.operator("oneframe.cancel_dataset", text="Stopping..." if job.cancelled else "Cancel", icon="CANCEL")
    elif job.cancelled:
        count = progress.count if progress is not None else 0
        draw_text(layout, f"Cancelled after about {count} views. Render Dataset continues the run.", icon="INFO")
    elif job.error:
        draw_text(layout, job.error, icon="ERROR")
    else:
        draw_text(layout, job.lines[-1] if job.lines else str(job.out), icon="CHECKMARK")
