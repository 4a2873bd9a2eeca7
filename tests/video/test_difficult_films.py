"""Films as recorders, telephones and editors write them: numbers, times, colours and turns as players show them."""

import av
import cv2
import numpy as np
import pytest

from oneframe.errors import InputError
from oneframe.video.film_reader import WIDEST, Film, film_frame, read_video_frame
from tests.video.difficult_films import PATCHES, colours_of, copied, number_of, numbered, write_frames, write_images

pytestmark = pytest.mark.usefixtures("decoded_here")

B_FRAMES = {"bf": "3", "g": "12"}
ALTERNATE = {"auto-alt-ref": "1", "lag-in-frames": "16", "b": "1000000"}
WAYS = {
    "h264.avi": ("libx264", B_FRAMES),
    "xvid.avi": ("mpeg4", {"bf": "2"}),
    "plain.h264": ("libx264", B_FRAMES),
    "a.ts": ("libx264", B_FRAMES),
    "open.mkv": ("libx265", {"x265-params": "log-level=error:keyint=10:open-gop=1"}),
    "refreshed.mp4": ("libx264", {"x264-params": "intra-refresh=1:keyint=30"}),
    "a.mpg": ("mpeg2video", {"bf": "2"}),
    "lossless.mkv": ("ffv1", {}),
    "motion.avi": ("mjpeg", {"strict": "-1"}),
    "vp9.mkv": ("libvpx-vp9", {}),
    "hidden.webm": ("libvpx", ALTERNATE),
    "av1.mp4": ("libsvtav1", {"preset": "12", "svtav1-params": "fast-decode=1"}),
}


def frames_of(path, **options) -> list:
    with Film(path, width=WIDEST, **options) as film:
        return list(film)


@pytest.mark.parametrize("name", WAYS)
def test_numbers_are_those_of_a_player(tmp_path, name):
    codec, options = WAYS[name]
    path = write_frames(tmp_path / name, 40, codec, **options)
    frames = frames_of(path)
    assert [frame.index for frame in frames] == [number_of(frame.image) for frame in frames] == list(range(40))
    assert [frame.time_s for frame in frames] == pytest.approx(np.arange(40) / 25, abs=2e-3)
    for index in (0, 7, 39):
        assert np.array_equal(read_video_frame(path, index), frames[index].image)
    part = frames_of(path, numbers=(30, 34))
    assert [frame.index for frame in part] == [number_of(frame.image) for frame in part] == [30, 31, 32, 33]


@pytest.mark.parametrize("suffix", ["mp4", "mov"])
def test_what_an_edit_list_hides_is_no_frame(tmp_path, suffix):
    whole = write_frames(tmp_path / "whole.mp4", 60, **B_FRAMES)
    path = copied(tmp_path / f"cut.{suffix}", [whole], from_s=0.92, use_editlist="1")
    assert b"elst" in path.read_bytes()
    frames = frames_of(path)
    assert [number_of(frame.image) for frame in frames] == list(range(23, 60))
    assert [frame.index for frame in frames] == list(range(37))
    assert number_of(read_video_frame(path, 7)) == 30
    for index in (-1, 37):
        with pytest.raises(InputError, match=f"expected a frame from 0 to 36, found {index}; the file has 37"):
            read_video_frame(path, index)


@pytest.mark.parametrize(("name", "codec", "least"), [("a.mov", "libx264", 40), ("a.avi", "mpeg4", 1)])
def test_no_picture_is_made_up_after_a_damaged_one(tmp_path, name, codec, least, rng):
    """Those that are left keep their numbers; where frames are counted, as in AVI, none is left."""
    whole = write_frames(tmp_path / name, 80, codec, **B_FRAMES).read_bytes()
    for place in rng.integers(len(whole) // 20, len(whole) * 4 // 5, 8):
        damage = rng.integers(0, 256, 60, np.uint8).tobytes()
        (tmp_path / name).write_bytes(whole[:place] + damage + whole[place + 60 :])
        frames = frames_of(tmp_path / name)
        assert [frame.index for frame in frames] == [number_of(frame.image) for frame in frames]
        assert len(frames) >= least


def test_what_only_the_decoder_s_words_tell_is_heard(tmp_path):
    """FFV1 has checksums, and shows the picture before where one is wrong."""
    path = write_frames(tmp_path / "a.mkv", 40, "ffv1", level="3")
    whole, data = frames_of(path), path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + bytes(60) + data[len(data) // 2 + 60 :])
    frames = frames_of(path)
    assert 25 < len(frames) < 40
    assert all(np.array_equal(frame.image, whole[frame.index].image) for frame in frames)


@pytest.mark.parametrize("suffix", ["mkv", "ts", "flv"])
def test_a_film_that_begins_late_is_not_cut_off(tmp_path, suffix):
    path = copied(tmp_path / f"late.{suffix}", [write_frames(tmp_path / "whole.mp4", 60)], from_s=-40)
    with Film(path) as film:
        assert film.info.cut_off == ""
        assert [number_of(frame.image) for frame in film] == list(range(60))


@pytest.mark.parametrize(
    "stated", [{"color_trc": "arib-std-b67"}, {"color_trc": "smpte2084"}, {"color_primaries": "smpte432"}]
)
def test_a_film_in_hdr_or_of_wide_colours_is_refused(tmp_path, stated):
    with pytest.raises(InputError, match=r"film.mp4: expected a film for screens of usual range, found HDR"):
        Film(write_frames(tmp_path / "film.mp4", 2, **stated))


COLOURS = [
    *[("libx264", "yuv420p", matrix, stated) for matrix in (1, 2, 5, 6, 7, 9) for stated in (1, 2)],
    ("libx264", "yuv444p", 1, 1), ("libx265", "yuv420p10le", 9, 1), ("libx264", "yuvj420p", 2, 2),
    ("mjpeg", "yuvj422p", 2, 2), ("ffv1", "bgr0", 0, 2), ("ffv1", "yuv420p", 2, 1),
]  # fmt: skip


@pytest.mark.parametrize(("codec", "pixels", "matrix", "colour_range"), COLOURS)
def test_colours_are_those_that_the_film_states(tmp_path, codec, pixels, matrix, colour_range):
    quality = {
        "libx264": {"qp": "1"},
        "libx265": {"x265-params": "log-level=error:qp=1"},
        "mjpeg": {"qmin": "1", "qmax": "1"},
    }
    how = {"pixels": pixels, "matrix": matrix, "colour_range": colour_range, **quality.get(codec, {})}
    path = write_frames(tmp_path / "film.mkv", 2, codec, **how)
    assert np.abs(colours_of(frames_of(path)[1].image) - PATCHES).max() <= 2
    with Film(path, width=100) as film:
        assert np.abs(colours_of(next(iter(film)).image) - PATCHES).max() <= 3


def test_a_film_without_a_matrix_is_of_its_size(tmp_path):
    # one of them would be 20 codes off
    for size_wh in ((720, 576), (1280, 720)):
        path = write_frames(tmp_path / f"{size_wh[0]}.mp4", 1, size_wh=size_wh, qp="1")
        assert np.abs(colours_of(read_video_frame(path, 0)) - PATCHES).max() <= 2


def test_a_film_is_turned_and_mirrored_as_it_says(tmp_path):
    plain = write_frames(tmp_path / "plain.mp4", 3)
    image = read_video_frame(plain, 2)
    for degrees in (0, 90, 180, 270):
        for mirrored in (False, True):
            turn = {"degrees": degrees, "hflip": mirrored}
            turned = np.rot90(image, degrees // 90)
            frame, film = film_frame(copied(tmp_path / f"{degrees}{mirrored}.mp4", [plain], turn=turn), 2)
            assert np.array_equal(frame.image, turned[:, ::-1] if mirrored else turned), turn
            words = ("90" * (degrees % 180 > 0), "180" * (degrees == 180 and not mirrored), "mirrored" * mirrored)
            assert all(word in film.turned for word in words)
            assert bool(film.turned) == bool(film.notes) == (degrees > 0 or mirrored)


def textured(seed: int, size_wh: tuple[int, int] = (160, 120)) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, (size_wh[1] // 4, size_wh[0] // 4, 3)).astype(np.uint8)
    return cv2.resize(noise, size_wh, interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize("join", [np.hstack, np.vstack])
def test_a_film_of_two_eyes_is_refused(tmp_path, join):
    left = textured(1)
    eyes = [np.zeros_like(left)] * 2, [left, np.roll(left, 3, axis=1)]
    crop = "iw/2:ih" if join is np.hstack else "iw:ih/2"
    with pytest.raises(InputError, match=rf"film.mkv: expected the film of one eye, found two .* -vf crop={crop}:0:0"):
        frames_of(write_images(tmp_path / "film.mkv", [join(pair) for pair in eyes]))
    # a pattern, and two pictures
    pattern = np.tile(textured(2, (32, 24)), (5, 10, 1))
    assert len(frames_of(write_images(tmp_path / "other.mkv", [pattern]))) == 1
    assert len(frames_of(write_images(tmp_path / "pair.mkv", [join([left, textured(3)])]))) == 1


def test_a_cover_is_no_film(tmp_path):
    cover = write_frames(tmp_path / "cover.mp4", 1, "mjpeg", (640, 480), pixels="yuvj420p")
    film = write_frames(tmp_path / "film.mp4", 30)
    path = copied(tmp_path / "both.mp4", [cover, film], cover=True)
    assert [number_of(each.image) for each in frames_of(path)] == [*range(30)]
    with pytest.raises(InputError, match="without pictures"):
        Film(copied(tmp_path / "sound.mp4", [cover], cover=True))


def test_no_other_file_is_opened(tmp_path):
    write_frames(tmp_path / "film.mp4", 3)
    lists = {
        "concat": "ffconcat version 1.0\nfile film.mp4\n",
        "hls": "#EXTM3U\n#EXTINF:8,\nfilm.mp4\n#EXT-X-ENDLIST\n",
        "sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nm=video 5004 RTP/AVP 96\n",
    }
    for name, text in lists.items():
        (tmp_path / f"{name}.mp4").write_text(text)
        with pytest.raises(InputError, match="cannot open it"):
            Film(tmp_path / f"{name}.mp4")


@pytest.mark.parametrize(("packing", "words"), [(3, " side by side"), (4, ", one over the other")])
def test_a_film_that_states_two_eyes_is_refused_by_any_frame(tmp_path, packing, words):
    """Key frames alone state it."""
    with av.open(str(tmp_path / "film.mkv"), "w") as out:
        stream = out.add_stream("libx264", 25, options={"x264-params": f"frame-packing={packing}"})
        stream.width, stream.height = 128, 96
        for number in range(3):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(numbered(number))))
        out.mux(stream.encode())
    with pytest.raises(InputError, match=f"one eye, found two eyes{words}"):
        read_video_frame(tmp_path / "film.mkv", 2)


def test_frames_of_another_size_are_told(tmp_path):
    parts = [write_frames(tmp_path / f"{at}.h264", 20, size_wh=wh) for at, wh in enumerate([(128, 96), (64, 48)])]
    path = tmp_path / "film.h264"
    path.write_bytes(parts[0].read_bytes() + parts[1].read_bytes() + parts[0].read_bytes())
    with Film(path) as film:
        assert [number_of(frame.image) for frame in film] == [*range(20)] * 2
        assert film.other_sizes == dict.fromkeys(range(20, 40), (64, 48))
        assert film.problem(30) == "it has 64x48 px, the film's first frame 128x96"
    # alone, a frame is as it is
    assert read_video_frame(path, 30).shape == (48, 64, 3)
