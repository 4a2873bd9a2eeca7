"""Whole films: every frame once, with the container's own time, from whole, damaged, turned and interlaced files."""

import wave

import cv2
import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.video.film_reader import Film, read_video_frame
from oneframe.video.frame_scores import COMBED, score_frames
from oneframe.video.picture import comb_ratio
from tests.video.difficult_films import number_of, numbered, write_frames, write_images
from tests.video.surgical_film import write_film

pytestmark = pytest.mark.usefixtures("decoded_here")

FRAMES = 60
CUT = {"lossless.mkv": "ffv1", "a.avi": "mjpeg", "a.mp4": "mpeg4"}


def known(path):
    """What is known of a film before its frames."""
    with Film(path) as film:
        return film.info


def frames_of(path, **options) -> list:
    with Film(path, **options) as film:
        return list(film)


@pytest.mark.parametrize("name", CUT)
def test_of_a_film_that_is_cut_off_the_rest_is_used(tmp_path, name):
    path = write_frames(tmp_path / name, FRAMES, CUT[name], strict="-1")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    if name == "a.mp4":  # its index is at the end
        with pytest.raises(InputError, match="expected a video, cannot open it; it is cut off"):
            known(path)
        return
    left = known(path).frames
    assert 0 < left < FRAMES
    assert number_of(read_video_frame(path, left // 2)) == left // 2
    with pytest.raises(InputError, match=f"expected a frame from 0 to {left - 1}"):
        read_video_frame(path, FRAMES - 1)
    scores = score_frames(path)
    assert scores.broken
    assert [each.index for each in scores.frames] == list(range(len(scores.frames)))
    assert FRAMES / 3 < len(scores.frames) < FRAMES


def test_a_part_of_the_film_has_the_numbers_and_pictures_of_the_whole(tmp_path):
    path = write_frames(tmp_path / "film.mp4", 450, "mpeg4")  # 18 s: the reader seeks
    whole = frames_of(path)
    part = frames_of(path, every=4, from_s=11.0, to_s=11.8)
    assert [frame.index for frame in part] == list(range(275, 295, 4))
    for frame in part:
        assert frame.time_s == whole[frame.index].time_s
        assert np.array_equal(frame.image, whole[frame.index].image)
    with pytest.raises(InputError, match=r"the film is 17\.96 s long"):
        Film(path, from_s=30.0)


@pytest.mark.parametrize("suffix", [".mkv", ".mp4"])
def test_frames_and_times_of_a_variable_rate_are_the_containers(tmp_path, suffix):
    path = write_images(tmp_path / f"film{suffix}", [numbered(number) for number in range(FRAMES)], uneven=True)
    frames = frames_of(path)
    assert [number_of(frame.image) for frame in frames] == [frame.index for frame in frames] == list(range(FRAMES))
    gaps = np.diff([frame.time_s for frame in frames])
    assert gaps[-1] > 3 * gaps[0] > 0
    assert [number_of(read_video_frame(path, index)) for index in (0, 34, 59)] == [0, 34, 59]
    assert known(path).frames == FRAMES


def interlaced(images: list[np.ndarray]) -> list[np.ndarray]:
    woven = []
    for upper, lower in zip(images[0::2], images[1::2], strict=True):
        frame = upper.copy()
        frame[1::2] = lower[1::2]
        woven.append(frame)
    return woven


def moving(step_px: int) -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    texture = cv2.GaussianBlur(rng.normal(0, 1, (240, 600, 3)).astype(np.float32), (0, 0), 2.5)
    texture = np.clip(128 + 160 * texture, 0, 255).astype(np.uint8)
    return [np.ascontiguousarray(texture[:, number * step_px : number * step_px + 320]) for number in range(20)]


def test_interlacing_is_found_where_something_moves(tmp_path):
    assert max(frame.comb for frame in frames_of(write_film(tmp_path / "a.mkv", moving(6)))) < 0.9
    assert max(frame.comb for frame in frames_of(write_film(tmp_path / "b.mkv", interlaced(moving(0))))) < 0.9
    found = frames_of(write_film(tmp_path / "c.mkv", interlaced(moving(6))))
    assert min(frame.comb for frame in found) > COMBED
    noise = np.random.default_rng(2).integers(0, 255, (200, 300)).astype(np.uint8)
    assert comb_ratio(noise) < 1.05


def test_what_is_no_film_is_refused(tmp_path):
    (tmp_path / "text.mp4").write_text("not a video")
    (tmp_path / "empty.mp4").touch()
    for suffix in ("png", "jp2"):
        cv2.imwrite(str(tmp_path / f"image.{suffix}"), np.zeros((9, 9, 3), np.uint8))
    with wave.open(str(tmp_path / "sound.wav"), "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(8000))
    write_film(tmp_path / "large.mkv", [np.zeros((5008, 5008, 3), np.uint8)], "MJPG")
    for name, message in {
        "text.mp4": "cannot open it; it is cut off, without pictures, or in an unknown format",
        "empty.mp4": "it is empty",
        **{f"image.{suffix}": "found an image" for suffix in ("png", "jp2")},
        "sound.wav": "without pictures",
        "large.mkv": "at most 25.0 million pixels",
        "none.mp4": "does not exist; correct the path",
    }.items():
        with pytest.raises(InputError, match=message):
            score_frames(tmp_path / name)
        with pytest.raises(InputError, match=r"expected|does not exist"):
            read_video_frame(tmp_path / name, 1 if name == "large.mkv" else 0)
