"""Videos that Blender encodes."""

import numpy as np
import pytest

from oneframe.blender.render.video import stream_video
from oneframe.errors import InputError
from oneframe.video.film_reader import Film

pytestmark = pytest.mark.render


def test_a_stream_that_fails_leaves_no_file_and_tells_why(tmp_path):
    def images():
        yield np.zeros((48, 64, 3), np.uint8)
        raise InputError("no more")

    with pytest.raises(InputError, match="no more"):
        stream_video(tmp_path / "v.mp4", images(), 5, fps=25.0)
    assert list(tmp_path.iterdir()) == []
    # one that ends early keeps its last image
    grey = [np.full((48, 64, 3), 40 * k, np.uint8) for k in (1, 2)]
    stream_video(tmp_path / "v.mp4", iter(grey), 5, fps=25.0, pixel_aspect=4 / 3)
    with Film(tmp_path / "v.mp4") as film:
        levels = [frame.image.mean() for frame in film]
        assert (film.info.fps, film.info.pixel_aspect) == (25, pytest.approx(4 / 3))
        assert "1.333 times as wide as high" in film.info.notes[0]
    assert levels == pytest.approx([40, 80, 80, 80, 80], abs=2)
    # H.264 in MP4, as browsers play it
    assert b"avc1" in (tmp_path / "v.mp4").read_bytes()
