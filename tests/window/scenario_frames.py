"""The other frames of the film by pointer and keys: registered, stopped, looked at, taken, played, queued."""

from importlib import import_module

import bpy
import numpy as np
import x11
from user import part

WINDOW = 1024, 640
COUNT, LOST = 6, 5
DRAWN = 0.005
"""Share of a picture's pixels that clearly differ where surface or structures are drawn over it."""

REPORT_S, HEADER_PX = 8, 26
"""How long Blender shows what an operator reports; height of a closed panel's header, at interface scale 1."""


def pose(user):
    return part("state.from_scene").cam_from_model(user.window.scene)


def scenario(user):
    yield from user.open_case()
    yield from user.open_sidebar("OneFrame")
    user.call("open_video", "EXEC_DEFAULT", True, filepath=str(user.case.with_name("film.avi")))
    user.call("case_frame")
    before = pose(user)
    yield from see(user, 2, "0_not_registered", alone=True)
    yield from user.key("ESC", user.middle())
    yield from register(user)
    yield from look(user)
    yield from take(user)
    yield from play(user)
    assert np.array_equal(pose(user), before), "looking moves nothing"
    # all found frames in the queue: a button and Enter
    yield from user.press("queue_found")
    yield from user.key("RET")
    yield from user.until(lambda: len(part("case_queue.queued").queue_of(user.window.scene)) == COUNT, "the queue", 60)
    yield from show_queue(user)


def show_queue(user):
    """The panel Frames with the queue: *Case* is closed, *Advanced* and *Frames* opened, by their headers."""
    region = user.region("UI")
    for row in (0, 1, 4):
        yield from user.click((region.x + 80, region.y + region.height - HEADER_PX * (row + 0.5)))
        yield 0.5
    # until Blender takes its report away
    yield REPORT_S
    yield from user.picture("4_queue")


def ended(user):
    yield from user.until(lambda: not user.window.modal_operators, "the end")


def register(user):
    """Esc keeps what was found, beside the case; again, the others are found."""
    found, scene = part("frames.found"), user.window.scene
    yield from user.press("register_frames")
    yield from user.until(lambda: found.of(scene) and len(found.of(scene).frames) > 1, "frames", 120)
    yield from user.key("ESC", user.middle())
    yield from ended(user)
    stopped = dict(found.of(scene).frames)
    assert 1 < len(stopped) < COUNT, "what was found stays"
    yield from user.until(lambda: any(user.case.parent.glob("film_poses-*.json")), "the file", 30)
    yield from user.press("register_frames")
    yield from user.until(lambda: len(found.of(scene).frames) == COUNT, "all frames", 120)
    yield from ended(user)
    assert found.of(scene).summary() == "5 found, 0 doubtful, 1 lost"
    poses = {number: each.cam_from_model for number, each in found.of(scene).frames.items()}
    assert all(poses[number] is each.cam_from_model for number, each in stopped.items()), "none is found twice"


def place(user):
    """Over the Timeline, px of the window."""
    (timeline,) = (area for area in user.window.screen.areas if area.type == "DOPESHEET_EDITOR")
    region = user.region("WINDOW", timeline)
    return region.x + region.width / 2, region.y + region.height / 2


def see(user, at, name, *, alone):
    """The Timeline at a frame shows it: alone if it has no pose."""
    film = part("video.session").of(user.window.scene)
    user.window.scene.frame_set(film.scores.frames[at].index)
    yield from user.until(lambda: film.is_full, "the full frame")
    yield from user.picture(name)
    cv2, region = import_module("cv2"), user.region()
    view = part("ui.frame_view").FrameView.of(user.window.scene, region, user.view)
    width, height = view.camera.size_wh
    (left, right), up = np.rint(view.region_from_px([[-0.5, -0.5], [width - 0.5, height - 0.5]]).T).astype(int)
    left, right = left + region.x, right + region.x
    above, below = user.window.height - region.y - up
    shown = x11.capture()[above:below, left:right].astype(float)
    expected = cv2.resize(film.picture, (right - left, below - above), interpolation=cv2.INTER_LINEAR)
    drawn = float((np.abs(shown - expected).max(axis=2) > 60).mean())
    user.facts[f"{name}_drawn"] = round(drawn, 4)
    assert (drawn < DRAWN) == alone, drawn


def look(user):
    """The Timeline shows a frame, arrows go on, Esc goes back."""
    scene, film = user.window.scene, part("video.session").of(user.window.scene)
    yield from see(user, LOST, "2_lost", alone=True)
    yield from see(user, 2, "3_found", alone=False)
    yield from user.key("LEFT_ARROW", user.middle())
    yield from user.until(lambda: film.shown == 1, "arrows go through the film")
    yield from user.key("ESC", user.middle())
    assert not part("video.shown_frame").is_shown(scene)


def take(user):
    """Enter over the Timeline takes the frame at its pose, in one undo step."""

    def state():
        return user.window.scene.oneframe.frame_path, pose(user).tolist()

    before, found = state(), part("frames.found").frame_at(user.window.scene, 2)
    user.window.scene.frame_set(2)
    yield from user.key("RET", place(user))
    yield from user.until(lambda: state()[0] != before[0], "another frame", 30)
    assert np.array_equal(pose(user), found.cam_from_model)
    yield from user.press("rescale_camera")
    assert part("setup.alignment_record").pose_record(user.window.scene).method == "registered"
    for _ in range(2):
        yield from user.key("Z", user.middle(), ctrl=True)
    yield from user.until(lambda: state() == before, "all as before")
    assert part("frames.found").frame_at(user.window.scene, 2) is found
    yield from user.key("ESC", user.middle())


def play(user):
    film = part("video.session").of(user.window.scene)
    user.window.scene.frame_set(0)
    with user.context():
        bpy.ops.screen.animation_play()
    yield from user.until(lambda: film.shown == COUNT - 1, "the last picture", 120)
    yield from user.key("ESC", user.middle())
    yield 0.5
    assert not user.window.screen.is_animation_playing
    assert not part("video.shown_frame").is_shown(user.window.scene)
