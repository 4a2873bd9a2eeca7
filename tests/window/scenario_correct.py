"""The correction of the surface by the film's frames is stopped; what it writes is in tests/addon."""

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
