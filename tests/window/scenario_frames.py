"""A film by pointer and keys: alone, over a case, scrubbed, its frames registered, looked at, taken, played, queued."""

from importlib import import_module

import bpy
import numpy as np
import x11
from user import part

WINDOW = 1024, 640
COUNT, LOST = 6, 5
SAME = 12
"""Code values by which the picture of the window may differ from the film on average: it is scaled."""
DRAWN = 0.005
"""Share of a picture's pixels that clearly differ where surface or structures are drawn over it."""
REPORT_S, HEADER_PX = 8, 26
"""How long Blender shows what an operator reports; height of a closed panel's header, at interface scale 1."""


def scenario(user):
    yield from alone(user, user.case.with_name("film.avi"))
    yield from user.open_case()
    yield from user.open_sidebar("OneFrame")
    film = part("video.session").of(user.window.scene)
    before = user.pose
    yield from scrub(user, film)
    yield from see(user, 2, "0_not_registered", alone=True)
    yield from user.key("ESC", user.middle())
    yield from register(user)
    yield from look(user, film)
    yield from take(user)
    yield from play(user, film)
    assert np.array_equal(user.pose, before), "looking moves nothing"
    # all found frames in the queue: a button and Enter
    yield from user.press("queue_found")
    yield from user.key("RET")
    yield from user.until(lambda: len(part("setup.queued").queue_of(user.window.scene)) == COUNT, "the queue", 60)
    yield from show_queue(user)


def alone(user, path):
    """Before there is a case: the best frame fills the view above the Timeline; Esc stops the scoring."""
    session = part("video.session")
    for stopped in (True, False):
        user.call("open_video", "INVOKE_DEFAULT", filepath=str(path))
        assert len(user.window.modal_operators) == 1, "it is scored in the background"
        if stopped:
            yield from user.key("ESC")
            assert not user.window.modal_operators
            assert not user.window.scene.oneframe_video.path
    yield from user.until(lambda: session.of(user.window.scene) is not None, "the scores", 90)
    yield from user.at_workbench()
    film = session.of(user.window.scene)
    yield from user.until(lambda: film.is_full, "the full frame")
    yield from user.picture("1_alone")
    with user.context():
        low, high = part("view.zoom").free_rectangle(user.area)
    height, width = film.picture.shape[:2]
    size = np.array([width, height]) * np.min((high - low) / [width, height])
    off = difference(user, film, (low + high - size) / 2, (low + high + size) / 2)
    assert off.mean() < SAME, off.mean()


def difference(user, film, low, high):
    """Of the window from the film's picture between two places of the view, px of its region; code values."""
    cv2, region = import_module("cv2"), user.region()
    left, right = (round(region.x + x) for x in (low[0], high[0]))
    below, above = (round(user.window.height - region.y - y) for y in (low[1], high[1]))
    seen = x11.capture()[above:below, left:right].astype(float)
    expected = cv2.resize(film.picture, (right - left, below - above), interpolation=cv2.INTER_AREA)
    return np.abs(seen - expected)


def place(user, film, at):
    """Where a frame is in the Timeline, px of the window."""
    (timeline,) = (area for area in user.window.screen.areas if area.type == "DOPESHEET_EDITOR")
    region = user.region("WINDOW", timeline)
    x, _ = region.view2d.view_to_region(film.scores.frames[at].index, 0.0, clip=False)
    # where the frames are written: there a drag scrubs
    return region.x + x, region.y + region.height - 8


def scrub(user, film):
    """A drag in the Timeline shows the frames under the pointer, and moves nothing; arrows step, also in the view."""
    before, shown_frame = user.pose, part("video.shown_frame")
    assert not shown_frame.is_shown(user.window.scene), "the case's frame is in view until the Timeline is used"
    start, end = place(user, film, 0), place(user, film, 4)
    yield from user.move(start)
    user.event("LEFTMOUSE", "PRESS", start)
    seen = []
    for step in range(1, 7):
        user.event("MOUSEMOVE", "NOTHING", tuple(np.array(start) + (np.array(end) - start) * step / 6))
        yield 0.1
        seen.append(film.shown)
    yield from user.until(lambda: film.shown == 4, "the frame under the pointer")
    user.event("LEFTMOUSE", "RELEASE", end)
    assert seen == sorted(seen), seen
    assert len(set(seen)) > 3, seen
    yield from user.key("RIGHT_ARROW", end)
    yield from user.until(lambda: film.shown == LOST, "the next frame")
    yield from user.key("LEFT_ARROW", user.middle())
    yield from user.until(lambda: film.shown == 4, "the frame before, also over the view")
    assert np.array_equal(user.pose, before), "the tool did not get drag and keys"


def ended(user):
    yield from user.until(lambda: not user.window.modal_operators, "the end")


def register(user):
    """Esc keeps what was found, beside the case; again, the others are found."""
    film_poses, scene = part("frames.film_poses"), user.window.scene
    yield from user.press("register_frames")
    yield from user.until(lambda: film_poses.of(scene) and len(film_poses.of(scene).frames) > 1, "frames", 120)
    yield from user.key("ESC", user.middle())
    yield from ended(user)
    stopped = dict(film_poses.of(scene).frames)
    assert 1 < len(stopped) < COUNT, "what was found stays"
    yield from user.until(lambda: any(user.case.parent.glob("film_poses-*.json")), "the file", 30)
    yield from user.press("register_frames")
    yield from user.until(lambda: len(film_poses.of(scene).frames) == COUNT, "all frames", 120)
    yield from ended(user)
    assert film_poses.of(scene).summary() == "5 found, 0 doubtful, 1 lost"
    poses = {number: each.cam_from_model for number, each in film_poses.of(scene).frames.items()}
    assert all(poses[number] is each.cam_from_model for number, each in stopped.items()), "none is found twice"


def see(user, at, name, *, alone):
    """The Timeline at a frame shows it: alone if it has no pose."""
    film = part("video.session").of(user.window.scene)
    user.window.scene.frame_set(film.scores.frames[at].index)
    yield from user.until(lambda: film.is_full, "the full frame")
    yield from user.picture(name)
    view = user.frame_view
    width, height = view.camera.size_wh
    corners = view.region_from_px([[-0.5, height - 0.5], [width - 0.5, -0.5]])
    drawn = float((difference(user, film, *corners).max(axis=2) > 60).mean())
    user.facts[f"{name}_drawn"] = round(drawn, 4)
    assert (drawn < DRAWN) == alone, drawn


def look(user, film):
    """The Timeline shows a frame with the surface, Esc goes back, and the arrows move the surface again."""
    scene = user.window.scene
    yield from see(user, LOST, "2_lost", alone=True)
    yield from see(user, 2, "3_found", alone=False)
    yield from user.key("ESC", user.middle())
    assert not part("video.shown_frame").is_shown(scene)
    before = user.pose
    yield from user.key("RIGHT_ARROW", user.middle())
    yield from user.until(lambda: not np.array_equal(user.pose, before), "a nudge of the surface")
    assert film.shown == 2
    yield from user.undo(lambda: np.array_equal(user.pose, before), "the pose after undo")


def take(user):
    """Enter over the Timeline takes the frame at its pose, in one undo step, and the film stays open."""
    session, film_poses = part("video.session"), part("frames.film_poses")

    def state():
        return user.window.scene.oneframe.frame_path, user.pose.tolist()

    before, taken = state(), film_poses.frame_at(user.window.scene, 2)
    film = session.of(user.window.scene)
    user.window.scene.frame_set(2)
    yield from user.key("RET", place(user, film, 3))
    yield from user.until(lambda: state()[0] != before[0], "another frame", 30)
    assert np.array_equal(user.pose, taken.cam_from_model)
    yield from user.press("rescale_camera")
    assert part("setup.alignment_record").pose_record(user.window.scene).method == "registered"
    for _ in range(2):
        yield from user.key("Z", user.middle(), ctrl=True)
    yield from user.until(lambda: state() == before, "all as before")
    assert session.of(user.window.scene) is film
    assert film_poses.frame_at(user.window.scene, 2) is taken
    yield from user.key("ESC", user.middle())


def play(user, film):
    """Blender's own player, until Escape."""
    user.window.scene.frame_set(0)
    with user.context():
        bpy.ops.screen.animation_play()
    yield from user.until(lambda: film.shown == COUNT - 1, "the last picture", 120)
    yield from user.key("ESC", user.middle())
    yield 0.5
    assert not user.window.screen.is_animation_playing
    assert not part("video.shown_frame").is_shown(user.window.scene)


def show_queue(user):
    """The panel Frames with the queue: *Case* is closed, *Advanced* and *Frames* opened, by their headers."""
    region = user.region("UI")
    for row in (0, 1, 4):
        yield from user.click((region.x + 80, region.y + region.height - HEADER_PX * (row + 0.5)))
        yield 0.5
    # until Blender takes its report away
    yield REPORT_S
    yield from user.picture("4_queue")
