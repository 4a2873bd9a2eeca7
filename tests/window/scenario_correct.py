"""The surface corrected by the film's frames: stopped, corrected beside the case, opened as a case; both buttons."""

from importlib import import_module

import addon_utils
import bpy

WINDOW = 1024, 900
PACKAGE = "bl_ext.user_default.oneframe"
COUNT = 11


def part(name):
    return import_module(f"{PACKAGE}.{name}")


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def scenario(user):
    addon_utils.enable(PACKAGE)
    case = user.case.parent / "eleven" / "case.toml"
    yield from user.open_case(case)
    yield from user.open_sidebar("OneFrame")
    yield from user.show_step("frames")
    with user.context():
        bpy.ops.oneframe.open_video("EXEC_DEFAULT", True, filepath=str(case.with_name("eleven.avi")))
        bpy.ops.oneframe.case_frame()
    found, scene, folder = part("frames.found"), user.window.scene, case.with_name("case_eleven_corrected")
    yield from user.press("register_frames")
    yield from user.until(lambda: not user.window.modal_operators and found.of(scene), "the frames", 120)
    assert found.of(scene).summary() == f"{COUNT} found, 0 doubtful, 0 lost", found.of(scene).summary()
    before = files(case.parent)
    yield from user.press("correct_surface")
    yield from user.until(lambda: user.window.modal_operators, "the work", 30)
    yield from user.key("ESC", user.middle())
    yield from user.until(lambda: not user.window.modal_operators, "the end", 30)
    yield 2.0
    assert not folder.exists(), "Esc leaves nothing"
    assert files(case.parent) == before
    yield from user.press("correct_surface")
    yield from user.until(
        lambda: (folder / "case.toml").exists() and not user.window.modal_operators, "the result", 200
    )
    yield from user.redraw()
    yield from user.picture("1_corrected")
    assert files(case.parent) == before, "the case stays"
    assert sorted(files(folder)) == ["case.toml", "deviation.html", "deviation.png", "surface_corrected.ply"]
    yield from user.press("open_case", filepath=str(folder / "case.toml"))
    yield from user.until(lambda: user.window.scene.oneframe.case_path == str(folder / "case.toml"), "the case", 30)
    yield from user.redraw()
    yield from user.picture("2_opened")
    assert found.of(user.window.scene) is None, "poses that were found on the old surface"
