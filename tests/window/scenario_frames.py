"""The other frames of the film by hand: registered, stopped, looked at, played, a correction kept, colour sources."""

from importlib import import_module

import addon_utils
import bpy
import numpy as np

PACKAGE = "bl_ext.user_default.oneframe"
FILM = "film.avi"


def part(name):
    return import_module(f"{PACKAGE}.{name}")


def pose(user):
    return part("state.from_scene").cam_from_model(user.window.scene)


def scenario(user):
    addon_utils.enable(PACKAGE)
    yield from user.open_case()
    yield from user.open_sidebar("OneFrame")
    yield from user.show_step("frames")
    yield from user.picture("1_no_film")
    with user.context():
        bpy.ops.oneframe.open_video("EXEC_DEFAULT", True, filepath=str(user.case.with_name(FILM)))
        bpy.ops.oneframe.case_frame()
    yield from user.redraw()
    yield from user.picture("2_film")
    before = pose(user)
    yield from register(user)
    yield from look(user)
    yield from play(user)
    assert np.array_equal(pose(user), before), "looking moves nothing"
    yield from sources(user)
    yield from correct(user)


def register(user):
    found, scene = part("frames.found"), user.window.scene
    yield from user.press("register_frames")
    yield from user.until(lambda: found.of(scene) and len(found.of(scene).frames) > 2, "frames", 120)
    yield from user.picture("3_registering")
    yield from user.key("ESC", user.middle())
    yield from user.until(lambda: not user.window.modal_operators, "the end")
    assert 2 < len(found.of(scene).frames) < 12, "what was found stays"
    yield from user.picture("4_stopped")
    yield from user.press("register_frames")
    yield from user.until(lambda: len(found.of(scene).frames) == 12, "all frames", 240)
    yield from user.until(lambda: not user.window.modal_operators, "the end")
    user.facts["found"] = found.of(scene).summary()
    yield from user.picture("5_registered")


def place(user, film, at):
    with user.context():
        layout = part("video.strip_layout").StripLayout.of(bpy.context)
    region = user.region()
    return region.x + float(layout.x_of(film.times_s[at])), region.y + sum(layout.curve) / 2


def look(user):
    scene = user.window.scene
    film = part("video.session").of(scene)
    for at, name in ((5, "6_looked_at"), (11, "7_lost")):
        yield from user.click(place(user, film, at))
        yield from user.until(lambda: film.is_full, "the full frame")
        seen = part("state.another_frame").seen(scene)
        assert seen is not None
        yield from user.picture(name)
    yield from user.key("LEFT_ARROW", user.middle())
    assert film.shown == 10, "arrows go through the film"
    yield from user.key("ESC", user.middle())
    assert not part("video.shown_frame").is_shown(scene)
    yield from user.picture("8_back")


def play(user):
    scene = user.window.scene
    film, shown = part("video.session").of(scene), []

    def followed():
        shown.extend([film.shown] if film.shown not in shown else [])
        return len(shown) > 4

    yield from user.press("play_frames")
    yield from user.until(followed, "five pictures", 60)
    yield from user.picture("9_playing")
    yield from user.click(user.middle())
    yield from user.until(lambda: not user.window.modal_operators, "the end")
    assert shown[1:] == sorted(shown[1:]), "from the first frame on"
    user.facts["played"] = shown
    yield from user.key("ESC", user.middle())


def sources(user):
    scene = user.window.scene
    yield from user.press("use_colour_sources")
    yield from user.until(lambda: scene.oneframe.case_frames_text, "further frames", 120)
    yield from user.picture("10_sources")


def correct(user):
    scene, true = user.window.scene, pose(user)
    turned = part("pipeline.transforms").se3_exp(np.array([0.4, -0.4, 2.0, 0.02, -0.03, 0.02]))
    with user.context():
        part("state.pose").set_cam_from_model(scene, turned @ true)
        bpy.ops.ed.undo_push(message="rough")
    yield from user.redraw()
    rough = pose(user)
    yield from user.press("correct_first_pose")
    yield from user.until(lambda: not np.array_equal(pose(user), rough), "a corrected pose", 400)
    found = pose(user)
    yield from user.picture("11_after")
    yield from user.key("SPACE", user.middle())
    yield from user.until(lambda: np.array_equal(pose(user), rough), "the pose before")
    yield from user.picture("12_before")
    yield from user.key("RET", user.middle())
    yield from user.until(lambda: not user.window.modal_operators, "the end")
    assert np.array_equal(pose(user), found)
    yield from user.picture("13_corrected")
    user.facts["corrected by px"] = part("setup.alignment_record").pose_record(scene)["moved_px"]
    yield from user.key("Z", user.middle(), ctrl=True)
    yield from user.until(lambda: np.allclose(pose(user), rough), "the rough pose")
