"""Decoding apart: what comes back, and what is said if the decoder dies."""

import shutil
import sys

import pytest

from oneframe.errors import InputError
from oneframe.video import decoding_process
from oneframe.video.decoding_process import DecodingError, decoded_apart
from oneframe.video.film_reader import Film, read_video_frame
from tests.video.difficult_films import write_frames


def test_a_decoder_that_dies_at_once_gets_a_sentence(tmp_path, monkeypatch):
    path = write_frames(tmp_path / "film.mkv", 20)
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    with pytest.raises(InputError, match=r"film.mkv: expected a video, cannot decode it \(its decoder crashes"):
        read_video_frame(path, 3)
    with pytest.raises(InputError, match="cannot decode it"):
        Film(path)


def test_of_a_decoder_that_dies_on_its_way_the_frames_are_used(tmp_path, monkeypatch):
    path = write_frames(tmp_path / "film.mkv", 20)

    def dying(*arguments):
        parts = decoded_apart(*arguments)
        yield from (next(parts) for _ in range(6))
        raise DecodingError("it died")

    monkeypatch.setattr("oneframe.video.film_reader.decoded_apart", dying)
    with Film(path) as film:
        assert [frame.index for frame in film] == [0, 1, 2, 3, 4]
        assert film.broken


def test_a_decoder_that_hangs_ends_itself(tmp_path, monkeypatch):
    path = write_frames(tmp_path / "film.mkv", 20)
    copied = tmp_path / "pipeline"
    shutil.copytree(
        decoding_process._PACKAGE, copied, ignore=lambda folder, names: {"blender", "__pycache__"} & {*names}
    )
    decoder = copied / "video" / "decoder.py"
    decoder.write_text(
        decoder.read_text() + "\n\ndef film(path):\n    import time\n    time.sleep(600)\n    yield b''\n"
    )
    child = copied / "video" / "decoding_process.py"
    child.write_text(child.read_text().replace("PART_SECONDS = 120.0", "PART_SECONDS = 1.0"))
    monkeypatch.setattr(decoding_process, "_PACKAGE", copied)
    monkeypatch.setattr(sys, "path", [place for place in sys.path if not (place and (copied / place).exists())])
    with pytest.raises(DecodingError):
        next(decoded_apart(path))
