"""Seven frames of a film and of files through the queue: each starts at the pose before, keys go on, none is lost."""

from importlib import import_module

import bpy
import numpy as np

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

from bl_ext.user_default.oneframe.case_queue import queued
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.state import from_scene
from bl_ext.user_default.oneframe.ui.keymap import PIN_TOOL, active_tool
from bl_ext.user_default.oneframe.video import session

KINDS = ("clear", "hand", "clear", "blur", "clear", "glare", "clear", "tool", "clear")
FRAMES = 7
SHIFT_PX = 12
"""How far the user drags the pin in each frame."""
MOST_ACTIONS = 6


def scenario(user):
    film = write_film(user)
    yield from user.open_case()
    scene = bpy.context.scene
    yield from user.open_sidebar("OneFrame")
    with user.context():
        bpy.ops.oneframe.open_video("EXEC_DEFAULT", True, filepath=str(film))
    yield from user.until(lambda: session.of(scene) is not None, "the film to be scored")
    with user.context():
        bpy.ops.oneframe.queue_video_frames("EXEC_DEFAULT", True, best=True)
    yield from user.until(lambda: len(queued.queue_of(scene)) > 1, "the frames in the queue")
    images = [user.folder / f"taken_{number}.png" for number in range(FRAMES - len(queued.queue_of(scene)))]
    for image in images:
        image.write_bytes((user.case.parent / "frame.png").read_bytes())
    with user.context():
        files = [{"name": image.name} for image in images]
        bpy.ops.oneframe.queue_frames("EXEC_DEFAULT", True, directory=str(user.folder), files=files)
        bpy.ops.oneframe.video_strip("EXEC_DEFAULT", True)
    entries = queued.queue_of(scene)
    user.facts["frames"] = len(entries)
    assert len(entries) == FRAMES
    yield from user.redraw()
    yield from user.picture("1_queue")

    poses = {}
    zoom, tool = user.view.view_camera_zoom, PIN_TOOL
    for number, entry in enumerate(entries):
        actions = 0
        assert queued.position(scene) == number
        before = pose(scene)
        place = np.array(user.middle())
        yield from user.drag(tuple(place), (place[0] + SHIFT_PX, place[1]))
        actions += 1
        assert not np.array_equal(pose(scene), before)
        poses[entry.path] = pose(scene)
        yield from user.key("PAGE_DOWN", user.middle(), alt=True)
        actions += 1
        yield from user.until(lambda now=number: checked(scene) == now + 1, "the frame to be checked")
        assert actions <= MOST_ACTIONS
        if number + 1 < len(entries):
            yield from user.until(lambda now=number: queued.position(scene) == now + 1, "the next frame")
            assert np.array_equal(pose(scene), poses[entry.path])
            assert len(scene.oneframe.landmarks) == 0
        yield from user.redraw()
        assert user.view.view_camera_zoom == zoom
        with user.context():
            assert active_tool(bpy.context) == tool
        if number == 1:
            yield from user.picture("2_next_frame")
    yield from user.picture("3_checked")

    yield from user.key("PAGE_UP", user.middle())
    yield from user.until(lambda: queued.position(scene) == len(entries) - 2, "the frame before")
    assert np.allclose(pose(scene), poses[entries[-2].path], atol=1e-9)
    cases = [read_case(entry.path) for entry in entries]
    assert all("checked" in case.alignment for case in cases)
    assert len({case.image for case in cases}) == len(entries)
    yield from user.picture("4_back")


def checked(scene):
    return [entry.state for entry in queued.queue_of(scene)].count("checked")


def pose(scene):
    return from_scene.cam_from_model(scene)


def write_film(user):
    """The sample's own frame as a film, with faults put in."""
    cv2, films = import_module("cv2"), import_module("video.surgical_film")
    frame = np.ascontiguousarray(cv2.imread(str(user.case.parent / "frame.png"))[..., ::-1])
    events = [films.Event(kind, 6 * number, 6 * (number + 1)) for number, kind in enumerate(KINDS)]
    path, size = user.folder / "surgery.avi", (frame.shape[1], frame.shape[0])
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"MJPG"), 25.0, size)
    for picture in films.surgical_film([frame], events, np.random.default_rng(1)):
        writer.write(np.ascontiguousarray(picture[..., ::-1]))
    writer.release()
    return path
