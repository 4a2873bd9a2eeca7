"""The frame from a video by hand: the strip without a case, then over one; scrub, zoom, step, take, undo."""

from importlib import import_module

import bpy
import numpy as np
import x11
from user import part

KINDS = ("clear", "tool", "clear", "blur", "clear", "glare", "clear")
EACH = 7
SIZE_WH = 480, 360
SAME = 12
"""Code values by which the picture of the window may differ from the film on average: it is scaled."""


def scenario(user):
    path = user.folder / "surgery.avi"
    written_film(path, user.case.parent / "frame.png")
    yield from alone(user, path)
    yield from set_up(user)
    film = part("video.session").of(user.window.scene)
    yield from scrub(user, film)
    yield from zoom(user, film)
    yield from keys(user, film)
    yield from take(user, film)


def written_film(path, picture):
    """A film of the sample's frame with faults."""
    cv2 = import_module("cv2")
    from video.surgical_film import Event, surgical_film, write_film

    image = cv2.resize(cv2.imread(str(picture))[..., ::-1], SIZE_WH, interpolation=cv2.INTER_AREA)
    events = [Event(kind, EACH * number, EACH * (number + 1)) for number, kind in enumerate(KINDS)]
    write_film(path, surgical_film([image], events, np.random.default_rng(3)), "MJPG")


def alone(user, path):
    """Before there is a case: the best frame fills the view over the strip."""
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
    assert KINDS[film.shown // EACH] == "clear"
    with user.context():
        low, high = part("view.zoom").free_rectangle(user.area)
    height, width = film.picture.shape[:2]
    size = np.array([width, height]) * np.min((high - low) / [width, height])
    check_picture(user, film, (low + high - size) / 2, (low + high + size) / 2)


def set_up(user):
    """The frame in view is taken; with K and a small surface there is something to align."""
    film = part("video.session").of(user.window.scene)
    yield from user.key("RET", place(user, film, 20))
    yield from user.until(lambda: user.window.scene.oneframe.frame_path, "a frame", 30)
    scene, mesh = user.window.scene, user.folder / "surface.ply"
    x, y = np.meshgrid(np.linspace(-20, 20, 21), np.linspace(-15, 15, 16))
    points = np.stack([x, y, 3 * np.sin(x / 4) * np.cos(y / 3)], -1).reshape(-1, 3)
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (each.ravel() for each in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).astype(np.int32)
    part("pipeline.surface.mesh_writer").write_ply(mesh, part("pipeline.surface.mesh").TriangleMesh(points, faces))
    typed = scene.oneframe.camera
    typed.fx = typed.fy = "1500"
    user.call("set_camera", "EXEC_DEFAULT", True)
    user.call("load_surface", "EXEC_DEFAULT", True, filepath=str(mesh))
    yield from user.at_workbench()


def layout(user):
    with user.context():
        return part("video.strip_layout").StripLayout.of(bpy.context)


def place(user, film, at, row="curve"):
    """Where a frame is in the strip, px of the window."""
    found, region = layout(user), user.region()
    return region.x + float(found.x_of(film.times_s[at])), region.y + sum(getattr(found, row)) / 2


def frame_corners(user):
    """Lower left and upper right corner of the frame in the view, px of its region."""
    seen = part("ui.frame_view").FrameView.of(user.window.scene, user.region(), user.view)
    width, height = seen.camera.size_wh
    return seen.region_from_px([-0.5, height - 0.5]), seen.region_from_px([width - 0.5, -0.5])


def check_picture(user, film, low, high):
    """The window shows the film's picture between these places, px of the region."""
    cv2, region = import_module("cv2"), user.region()
    left, right = (round(region.x + x) for x in (low[0], high[0]))
    below, above = (round(user.window.height - region.y - y) for y in (low[1], high[1]))
    seen = x11.capture()[above:below, left:right].astype(float)
    expected = cv2.resize(film.picture, (right - left, below - above), interpolation=cv2.INTER_AREA)
    assert np.abs(seen - expected).mean() < SAME, np.abs(seen - expected).mean()


def placed(user):
    return np.array(user.window.scene.oneframe.surface.matrix_world)


def scrub(user, film):
    """A drag shows the frames under the pointer, first as thumbnails, and moves nothing."""
    shown_frame, scene = part("video.shown_frame"), user.window.scene
    scene.oneframe_view.contour = False
    scene.oneframe_view.opacity = 0
    pose, before = placed(user), film.shown
    assert not shown_frame.is_shown(scene), "the case's frame is in view until the strip is used"
    start, end = place(user, film, 4), place(user, film, 38)
    yield from user.move(start)
    user.event("LEFTMOUSE", "PRESS", start)
    seen = []
    for step in range(1, 7):
        user.event("MOUSEMOVE", "NOTHING", tuple(np.array(start) + (np.array(end) - start) * step / 6))
        yield 0.1
        seen.append(film.shown)
    assert seen == sorted(seen), seen
    assert seen[-1] == 38, "the frame under the pointer"
    assert len(set(seen)) > 4, seen
    assert before not in seen[:1]
    user.event("LEFTMOUSE", "RELEASE", end)
    yield from user.until(lambda: film.is_full, "the full frame")
    yield from user.redraw()
    check_picture(user, film, *frame_corners(user))
    yield from user.picture("3_scrubbed")
    assert (placed(user) == pose).all(), "the tool did not get the drag"
    low, _ = frame_corners(user)
    assert low[1] >= layout(user).high[1], "the whole frame is above the strip"


def zoom(user, film):
    """The wheel zooms the time about the pointer, and beside the strip the view."""
    whole, view_zoom = film.span_s, user.view.view_camera_zoom
    at = place(user, film, 20)
    time_s = layout(user).time_at(at[0] - user.region().x)
    yield from user.move(at)
    for _ in range(3):
        user.event("WHEELUPMOUSE", "PRESS", at)
        yield 0.1
    begin, end = film.span_s
    assert end - begin < 0.5 * (whole[1] - whole[0])
    assert abs(layout(user).time_at(at[0] - user.region().x) - time_s) < 0.01
    assert user.view.view_camera_zoom == view_zoom
    yield from user.key("HOME", at)
    assert film.span_s == film.whole_span_s
    yield from user.move(user.middle())
    user.event("WHEELUPMOUSE", "PRESS", user.middle())
    yield from user.until(lambda: user.view.view_camera_zoom != view_zoom, "the view zooms")
    assert film.span_s == film.whole_span_s
    yield from user.key("HOME", user.middle())


def keys(user, film):
    """Arrows step through the film, over the strip and while its frames are in view; then they move the surface."""
    at, pose = place(user, film, 20), placed(user)
    yield from user.key("RIGHT_ARROW", at)
    assert film.shown == 39
    for _ in range(3):
        yield from user.key("LEFT_ARROW")
    assert film.shown == 36
    yield from user.until(lambda: film.is_full, "the full frame")
    in_time = sorted(film.best)
    yield from user.key("LEFT_ARROW", ctrl=True)
    last = film.shown
    assert last == max(at for at in in_time if at < 36)
    yield from user.key("LEFT_ARROW", ctrl=True)
    assert film.shown == in_time[in_time.index(last) - 1]
    assert (placed(user) == pose).all()
    # neither the film's last one nor the case's own, beside which the film is not in view
    film.show(20)
    yield from user.key("LEFT_ARROW", at)
    yield from user.key("RIGHT_ARROW", at)
    yield from user.key("RIGHT_ARROW", user.middle())
    assert film.shown == 21
    assert (placed(user) == pose).all()
    yield from user.key("ESC", user.middle())
    yield from user.key("RIGHT_ARROW", user.middle())
    yield from user.until(lambda: (placed(user) != pose).any(), "a nudge of the surface")
    assert film.shown == 21
    yield from user.undo(lambda: np.allclose(placed(user), pose), "the pose after undo")


def take(user, film):
    """Enter over the strip takes the frame, in one undo step."""
    before = user.window.scene.oneframe.frame_path
    film.show(8)
    yield from user.key("RET", place(user, film, 20))
    yield from user.until(lambda: user.window.scene.oneframe.frame_path != before, "another frame", 30)
    assert user.window.scene.oneframe.frame_path.endswith("surgery_frame_000008.png")
    assert not part("video.shown_frame").is_shown(user.window.scene)
    yield from user.undo(lambda: user.window.scene.oneframe.frame_path == before, "the frame before")
    assert part("video.session").of(user.window.scene) is film
