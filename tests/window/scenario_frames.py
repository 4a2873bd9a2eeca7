"""The other frames of the film by hand: registered, stopped, looked at, played, colour sources, the first pose."""

from importlib import import_module

import addon_utils
import bpy
import numpy as np

PACKAGE = "bl_ext.user_default.oneframe"
COUNT, LOST = 6, 5


def part(name):
    return import_module(f"{PACKAGE}.{name}")


def pose(user):
    return part("state.from_scene").cam_from_model(user.window.scene)


def scenario(user):
    addon_utils.enable(PACKAGE)
    yield from user.open_case()
    yield from user.open_sidebar("OneFrame")
    yield from user.show_step("frames")
    with user.context():
        bpy.ops.oneframe.open_video("EXEC_DEFAULT", True, filepath=str(user.case.with_name("film.avi")))
        bpy.ops.oneframe.case_frame()
    before = pose(user)
    yield from register(user)
    yield from look(user)
    yield from play(user)
    assert np.array_equal(pose(user), before), "looking moves nothing"
    yield from user.press("use_colour_sources")
    yield from user.until(lambda: user.window.scene.oneframe.case_frames_text, "further frames", 120)
    yield from correct(user)


def ended(user):
    yield from user.until(lambda: not user.window.modal_operators, "the end")


def register(user):
    """Esc keeps what was found; from the start again, all are found."""
    found, scene = part("frames.found"), user.window.scene
    yield from user.press("register_frames")
    yield from user.until(lambda: found.of(scene) and len(found.of(scene).frames) > 1, "frames", 120)
    yield from user.key("ESC", user.middle())
    yield from ended(user)
    assert 1 < len(found.of(scene).frames) < COUNT, "what was found stays"
    yield from user.picture("1_stopped")
    yield from user.press("register_frames")
    yield from user.until(lambda: len(found.of(scene).frames) == COUNT, "all frames", 120)
    yield from ended(user)
    assert found.of(scene).summary() == "5 found, 0 doubtful, 1 lost"


def look(user):
    """A click on the strip shows a frame, arrows go on, Esc goes back."""
    scene, region = user.window.scene, user.region()
    film = part("video.session").of(scene)
    with user.context():
        layout = part("video.strip_layout").StripLayout.of(bpy.context)
    for at, name in ((LOST, "2_lost"), (2, "3_found")):
        place = region.x + float(layout.x_of(film.times_s[at])), region.y + sum(layout.curve) / 2
        yield from user.click(place)
        yield from user.until(lambda: film.is_full, "the full frame")
        assert (part("state.another_frame").seen(scene).cam_from_model is None) == (at == LOST)
        yield from user.picture(name)
    yield from user.key("LEFT_ARROW", user.middle())
    assert film.shown == 1, "arrows go through the film"
    yield from user.key("ESC", user.middle())
    assert not part("video.shown_frame").is_shown(scene)


def play(user):
    film = part("video.session").of(user.window.scene)
    yield from user.press("play_frames")
    yield from user.until(lambda: film.shown == COUNT - 1, "the last picture", 120)
    yield from ended(user)
    yield from user.key("ESC", user.middle())


def correct(user):
    scene, true = user.window.scene, pose(user)
    # fewer rounds: quicker, and less exact
    part("pipeline.blender.registration.correct_source").MOST_ROUNDS = 2
    turned = part("pipeline.transforms").se3_exp(np.array([0.4, -0.4, 2.0, 0.004, -0.006, 0.02]))
    with user.context():
        part("state.pose").set_cam_from_model(scene, turned @ true)
        bpy.ops.ed.undo_push(message="rough")
    yield from user.show_step("frames")
    rough = pose(user)
    yield from user.press("correct_first_pose")
    yield from user.until(lambda: not np.array_equal(pose(user), rough), "a corrected pose", 300)
    found = pose(user)
    yield from user.key("SPACE", user.middle())
    yield from user.until(lambda: np.array_equal(pose(user), rough), "the pose before")
    yield from user.picture("4_before")
    yield from user.key("RET", user.middle())
    yield from ended(user)
    assert np.array_equal(pose(user), found)
    assert np.linalg.norm((found - true)[:3, 3]) < 0.5 * np.linalg.norm((rough - true)[:3, 3])
    yield from user.picture("5_corrected")
    yield from user.key("Z", user.middle(), ctrl=True)
    yield from user.until(lambda: np.allclose(pose(user), rough), "the rough pose")
