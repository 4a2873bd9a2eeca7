"""What the user would lose is asked about: another case, quitting, a pose in doubt, the file of another case."""

from pathlib import Path

import bpy
from bl_ext.user_default.oneframe.dataset import background_job
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.refine.status_line import status
from bl_ext.user_default.oneframe.setup.case_in_scene import unsaved_parts


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
    yield from user.until(lambda: user.window.modal_operators, "the running operator")
    yield 0.5
    yield from user.key("ESC", user.middle())
    yield from user.until(lambda: not user.window.modal_operators, "the end of the operator")
    assert "oneframe_colour" not in surface
    user.call("project_colour", "INVOKE_DEFAULT", mode="texture")
    yield from user.until(lambda: "oneframe_colour" in surface, "the colours")
    assert bpy.data.is_dirty, "colours are a change that Blender asks about before it quits"
    user.call("preview_view")
    assert not [image.name for image in bpy.data.images if image.is_dirty]

    # another case: a question, however it would be opened; Return and Escape are safe answers, and leave no dialog
    user.call("nudge", "INVOKE_DEFAULT", axis="x")
    assert unsaved_parts(scene) == ("pose",)
    dropped = {"directory": str(user.case.parent), "files": [{"name": user.case.name}]}
    for operator, settings_of, answer in (
        ("open_case", {}, "ESC"),
        ("open_case", {"filepath": str(user.case)}, "RET"),
        ("open_sample", {}, "RET"),
        ("drop_files", dropped, "RET"),
    ):
        user.call(operator, "INVOKE_DEFAULT", **settings_of)
        yield 0.5
        yield from user.key(answer)
        yield 0.5
        assert unsaved_parts(user.window.scene) == ("pose",), operator
        assert not [area for area in user.window.screen.areas if area.type == "FILE_BROWSER"], operator
    # the key that its button underlines
    user.call("drop_files", "INVOKE_DEFAULT", **dropped)
    yield 0.5
    yield from user.key("O")
    yield from user.until(lambda: not unsaved_parts(user.window.scene), "the case as its file has it")

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

    # dialogs begin beside the case
    user.call("load_surface", "INVOKE_DEFAULT")
    selector = yield from user.file_selector()
    assert Path(selector.spaces.active.params.directory.decode()) == user.case.parent
    yield from user.leave_file_selector()

    # a pose that nobody has aligned: asked about, Return is the safe answer
    surface = user.folder / "bone.ply"
    surface.write_bytes((user.case.parent / "surface.ply").read_bytes())
    user.call("load_surface", filepath=str(surface))
    for answer in ("RET", "S"):
        assert all(area.type != "FILE_BROWSER" for area in user.window.screen.areas), "Return asks for no file"
        user.call("save_case", "INVOKE_DEFAULT")
        yield 0.7
        yield from user.key(answer)
        yield 0.7
    yield from user.leave_file_selector()

    # another surface has no file yet; that of the case before is replaced by choice only
    yield from user.key("RIGHT_ARROW", user.middle())
    text = user.case.read_bytes()
    for answer in ("RET", "R"):
        assert user.case.read_bytes() == text
        yield from user.press("save_case")
        yield from user.choose_file(user.case)
        yield 0.5
        yield from user.key(answer)
        yield 0.5
    yield from user.until(lambda: read_case(user.case).mesh.resolve() == surface, "the case replaced by choice")
