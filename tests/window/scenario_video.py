"""The frame from a video by hand: without a case, then over one; scrub in the Timeline, step, take, undo."""

from importlib import import_module

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
    """Before there is a case: the best frame fills the view above the Timeline."""
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


def place(user, film, at):
    """Where a frame is in the Timeline, px of the window."""
    (timeline,) = (area for area in user.window.screen.areas if area.type == "DOPESHEET_EDITOR")
    region = user.region("WINDOW", timeline)
    x, _ = region.view2d.view_to_region(film.scores.frames[at].index, 0.0, clip=False)
    # where the frames are written: there a drag scrubs
    return region.x + x, region.y + region.height - 8


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
    assert not shown_frame.is_shown(scene), "the case's frame is in view until the Timeline is used"
    start, end = place(user, film, 4), place(user, film, 38)
    yield from user.move(start)
    user.event("LEFTMOUSE", "PRESS", start)
    seen = []
    for step in range(1, 7):
        user.event("MOUSEMOVE", "NOTHING", tuple(np.array(start) + (np.array(end) - start) * step / 6))
        yield 0.1
        seen.append(film.shown)
    yield from user.until(lambda: film.shown == 38, "the frame under the pointer")
    assert seen == sorted(seen), seen
    assert len(set(seen)) > 4, seen
    assert before not in seen[:1]
    user.event("LEFTMOUSE", "RELEASE", end)
    yield from user.until(lambda: film.is_full, "the full frame")
    yield from user.redraw()
    check_picture(user, film, *frame_corners(user))
    yield from user.picture("3_scrubbed")
    assert (placed(user) == pose).all(), "the tool did not get the drag"


def keys(user, film):
    """Arrows step through the film, over the Timeline and while its frames are in view; then they move the surface."""
    pose = placed(user)
    yield from user.key("RIGHT_ARROW", place(user, film, 20))
    yield from user.until(lambda: film.shown == 39, "the next frame")
    for _ in range(3):
        yield from user.key("LEFT_ARROW")
    yield from user.until(lambda: film.shown == 36 and film.is_full, "the full frame")
    yield from user.key("RIGHT_ARROW", user.middle())
    yield from user.until(lambda: film.shown == 37, "the next frame, also over the view")
    assert (placed(user) == pose).all()
    yield from user.key("ESC", user.middle())
    yield from user.key("RIGHT_ARROW", user.middle())
    yield from user.until(lambda: (placed(user) != pose).any(), "a nudge of the surface")
    assert film.shown == 37
    yield from user.undo(lambda: np.allclose(placed(user), pose), "the pose after undo")


def take(user, film):
    """Enter over the Timeline takes the frame, in one undo step."""
    before = user.window.scene.oneframe.frame_path
    part("video.shown_frame").show(user.window.scene, 8)
    yield from user.key("RET", place(user, film, 20))
    yield from user.until(lambda: user.window.scene.oneframe.frame_path != before, "another frame", 30)
    assert user.window.scene.oneframe.frame_path.endswith("surgery_frame_000008.png")
    assert not part("video.shown_frame").is_shown(user.window.scene)
    yield from user.undo(lambda: user.window.scene.oneframe.frame_path == before, "the frame before")
    assert part("video.session").of(user.window.scene) is film
