"""Save Case after another frame and surface have come: it asks for a place, and replaces no other case unasked."""

import bpy

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case

TIMEOUT_S = 480


def scenario(user):
    frame, surface, other = (user.folder / name for name in ("photograph.png", "nerve.ply", "photograph.toml"))
    frame.write_bytes((user.case.parent / "frame.png").read_bytes() + b"\0")
    surface.write_bytes((user.case.parent / "structures" / "facial_nerve.ply").read_bytes())
    # of somebody else: the name that Save Case would give
    (user.folder / "case.toml").write_text("")

    yield from user.open_case()
    settings = user.window.scene.oneframe
    yield from user.open_sidebar("OneFrame")
    yield from user.key("RIGHT_ARROW", user.middle())
    yield from user.press("save_case")
    yield from user.until(lambda: b"manual" in user.case.read_bytes(), "the case to be saved without a question")
    text = user.case.read_bytes()

    yield from user.show_step("setup")
    for name, path in (("frame", frame), ("camera", user.case), ("surface", surface)):
        yield from user.press(f"load_{name}")
        yield from user.choose_file(path)
    yield from user.until(lambda: settings.surface.oneframe.mesh_path == str(surface), "the other surface")
    yield from user.key("RIGHT_ARROW", user.middle())

    # the case of before is a question; Return keeps it
    yield from user.press("save_case")
    yield from user.file_selector()
    yield from user.choose_file(user.case)
    yield 0.5
    yield from user.key("RET")
    yield 0.5
    assert user.case.read_bytes() == text

    # the place that is suggested
    yield from user.press("save_case")
    yield from user.accept_file()
    yield from user.until(other.exists, "the other case")
    saved = read_case(other)
    assert (saved.image, saved.mesh, saved.alignment["method"]) == (frame, surface, "manual")

    # by choice it is replaced
    with user.context():
        bpy.ops.oneframe.save_case("INVOKE_DEFAULT", save_as=True)
    yield from user.choose_file(user.case)
    yield 0.5
    yield from user.key("R")
    yield from user.until(lambda: read_case(user.case).image.resolve() == frame, "the case replaced by choice")
