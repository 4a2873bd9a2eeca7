"""What runs is stopped by Escape, or asked about when Blender quits."""

import bpy
from bl_ext.user_default.oneframe.dataset import background_job
from bl_ext.user_default.oneframe.refine.status_line import status


def scenario(user):
    user.call("open_case", filepath=str(user.case))
    # of the workbench
    scene = user.window.scene
    settings = scene.oneframe
    yield from user.open_sidebar("OneFrame")

    # colouring runs in steps; Esc stops it, and then nothing has changed
    surface = settings.surface
    with user.context():
        assert bpy.ops.oneframe.project_colour("INVOKE_DEFAULT", mode="texture") == {"RUNNING_MODAL"}
    # at once: it takes less time than a pointer that moves
    user.event("ESC", "PRESS", user.middle())
    user.event("ESC", "RELEASE")
    yield 0.1
    yield from user.until(lambda: not user.window.modal_operators, "the end of the operator")
    assert "oneframe_colour" not in surface
    user.call("project_colour", "INVOKE_DEFAULT", mode="texture")
    yield from user.until(lambda: "oneframe_colour" in surface, "the colours")
    assert bpy.data.is_dirty, "colours are a change that Blender asks about before it quits"
    user.call("preview_view")
    assert not [image.name for image in bpy.data.images if image.is_dirty]

    # a run renders a snapshot, and keeps the file "modified" even after it has been saved
    settings.dataset_out = str(user.folder / "dataset")
    settings.dataset.count = 2000
    user.call("render_dataset")
    bpy.ops.wm.save_as_mainfile(filepath=str(user.folder / "work.blend"))
    yield from user.until(lambda: bpy.data.is_dirty, "the mark of a running job")
    yield from user.key("Q", user.middle(), ctrl=True)
    yield 0.7
    yield from user.picture("quitting")
    assert "Render Dataset to dataset continues it next time" in status(scene)[0]
    yield from user.key("ESC")
    yield 0.3
    assert background_job.current().check(), "the run goes on until the user answers"
    user.call("cancel_dataset")
    yield from user.until(lambda: not background_job.current().running, "the end of the run")
