"""A video in the add-on: scored as by the command, looked through; a frame is taken to the last bit, and saved."""

import bpy
import cv2
import numpy as np
import pytest

from blender_addon.video import session, shown_frame
from oneframe.case.case_file import read_case
from oneframe.video.film_reader import read_video_frame
from oneframe.video.frame_folder import write_frames
from oneframe.video.frame_scores import best_frames, score_frames
from tests.addon.conftest import pixels_of
from tests.video.surgical_film import Event, surgical_film, write_film

SIZE_WH = (64, 48)
"""That of the small case."""

KINDS = ("clear", "glove", "clear", "blur", "clear")


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    rng = np.random.default_rng(2)
    picture = sum(
        scale * cv2.resize(rng.normal(0, 1, (48 // step, 64 // step)), SIZE_WH, interpolation=cv2.INTER_CUBIC)
        for scale, step in ((14, 1), (20, 3), (30, 8))
    )
    picture = np.clip(picture[..., None] + np.array([150, 110, 90]), 0, 255).astype(np.uint8)
    events = [Event(kind, 8 * number, 8 * number + 8) for number, kind in enumerate(KINDS)]
    film = surgical_film([picture], events, rng, drift_px=0.0)
    return write_film(tmp_path_factory.mktemp("film") / "surgery.mkv", film)


@pytest.fixture(scope="module")
def scored():
    """Scores a film as the window does; a part of it only once."""
    known = {}

    def score(path, *, progress, thumbnails, **part):
        key = path, *part.items()
        if key not in known:
            known[key] = score_frames(path, progress=progress, thumbnails=thumbnails, **part), vars(thumbnails)
        scores, shown = known[key]
        vars(thumbnails).update(shown)
        return scores

    return score


@pytest.fixture
def film(addon, case_path, video, scored, monkeypatch):
    """The small case, and the film opened over it."""
    monkeypatch.setattr(session, "score_frames", scored)
    bpy.ops.oneframe.open_case(filepath=str(case_path))
    bpy.ops.oneframe.open_video(filepath=str(video))
    return session.of(bpy.context.scene)


def background(scene):
    return scene.oneframe.camera_object.data.background_images[0].image


def test_the_window_scores_as_the_command_does_and_shows_the_best_frame(film, video):
    scene = bpy.context.scene
    expected = score_frames(video)
    assert film.scores.frames == expected.frames
    assert [film.scores.frames[at] for at in film.best] == list(best_frames(expected.frames, session.BEST))
    assert film.shown == film.best[0]
    assert film.is_full
    assert np.array_equal(np.rint(pixels_of(background(scene))), read_video_frame(video, film.score.index))
    assert scene.oneframe.frame_path.endswith("frame.png"), "the case's frame stays until another one is taken"
    # the Timeline has the film's own numbers, and markers at the best frames
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (0, 39, film.score.index)
    assert [marker.frame for marker in scene.timeline_markers] == [film.scores.frames[at].index for at in film.best]
    for number in (38, 3, 20):
        scene.frame_set(number)
        assert film.score.index == number
        assert np.array_equal(np.rint(pixels_of(background(scene))), read_video_frame(video, number))
    scene.frame_set(1_000)
    assert film.score.index == 39
    bpy.ops.oneframe.show_video()
    assert background(scene).filepath.endswith("frame.png")
    bpy.ops.oneframe.show_video()
    assert shown_frame.is_shown(scene)


def test_a_frame_that_is_taken_is_the_commands_and_goes_with_the_case(film, video, case_path, tmp_path):
    scene = bpy.context.scene
    covered = int(np.argmax([score.obstructed for score in film.scores.frames]))
    assert KINDS[covered // 8] == "glove"
    shown_frame.show(scene, covered)
    expected, by_command = film.score, tmp_path / "frames"
    (written,) = write_frames(video, by_command, film.scores, [expected])
    for masked, file in ((False, written.image), (True, written.masked)):
        bpy.ops.oneframe.take_frame(masked=masked)
        assert scene.oneframe.frame_path == str(video.parent / file.name)
        assert (video.parent / file.name).read_bytes() == file.read_bytes()
        assert not shown_frame.is_shown(scene)
    assert written.tissue < 1
    # Save Case puts it beside the case, where everything else finds it
    taken = case_path.with_name("taken.toml")
    bpy.ops.oneframe.save_case(filepath=str(taken))
    kept = case_path.parent / written.masked.name
    assert read_case(taken).image == kept
    assert kept.read_bytes() == written.masked.read_bytes()


def test_a_saved_file_holds_the_path_and_the_cases_own_frame(film, video, tmp_path):
    scene = bpy.context.scene
    assert shown_frame.is_shown(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    assert shown_frame.is_shown(scene), "the view is as it was"
    session._forget()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    scene = bpy.context.scene
    assert background(scene).filepath.endswith("frame.png")
    assert session.of(scene) is None
    assert not bpy.ops.oneframe.take_frame.poll()
    assert bpy.ops.oneframe.open_video(filepath=scene.oneframe_video.path) == {"FINISHED"}
    assert session.of(scene).path == video
    assert shown_frame.is_shown(scene)


def test_without_k_a_video_opens_and_its_frame_can_be_taken(addon, video):
    bpy.ops.oneframe.open_video(filepath=str(video), every=2, from_s=0.4)
    scene = bpy.context.scene
    film = session.of(scene)
    assert [score.index for score in film.scores.frames] == list(range(10, 40, 2))
    # from frame to scored frame, in either direction
    for before, wanted, shown in ((20, 21, 22), (22, 21, 20), (20, 0, 10), (10, 99, 38)):
        scene.frame_set(before)
        scene.frame_set(wanted)
        assert (film.score.index, scene.frame_current) == (shown, shown)
    bpy.ops.oneframe.take_frame()
    assert tuple(scene.oneframe.frame_size) == SIZE_WH
    assert np.array_equal(film.picture, cv2.imread(scene.oneframe.frame_path)[..., ::-1])
