"""PNG files: others read what is written; damaged ones are refused."""

from pathlib import Path
from threading import Barrier, Thread

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from oneframe.errors import InputError
from oneframe.images.image_check import check_image_file
from oneframe.images.png import encode_png

sides = st.integers(1, 40)


def noise(seed: int, shape: tuple[int, ...], dtype: type) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


images = st.one_of(
    hnp.arrays(np.uint8, st.tuples(sides, sides)),
    hnp.arrays(np.uint16, st.tuples(sides, sides)),
    hnp.arrays(np.uint8, st.tuples(sides, sides, st.sampled_from([3, 4]))),
    st.builds(noise, st.integers(0, 2**32 - 1), st.tuples(sides, sides), st.sampled_from([np.uint8, np.uint16])),
    st.builds(noise, st.integers(0, 2**32 - 1), st.tuples(sides, sides, st.just(3)), st.just(np.uint8)),
)


@given(images, st.booleans(), st.booleans())
def test_png_files_hold_what_another_decoder_reads(image, mirrored, transposed):
    if mirrored:
        image = image[:, ::-1]
    if transposed:
        image = image.swapaxes(0, 1)
    decoded = cv2.imdecode(np.frombuffer(encode_png(image), np.uint8), cv2.IMREAD_UNCHANGED)
    assert decoded.dtype == image.dtype
    rgb_from_file = [2, 1, 0, 3][: image.shape[-1]]
    np.testing.assert_array_equal(decoded[..., rgb_from_file] if image.ndim == 3 else decoded, image)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scratch") / "image.png"


@given(images, st.data())
def test_a_png_file_with_any_byte_changed_or_lost_is_refused(scratch, image, data):
    whole = encode_png(image)
    scratch.write_bytes(whole)
    check_image_file(scratch, "image")
    place = data.draw(st.integers(0, len(whole) - 1))
    changed = bytearray(whole)
    changed[place] ^= data.draw(st.integers(1, 255))
    for damaged in (changed, whole[:place]):
        scratch.write_bytes(damaged)
        with pytest.raises(InputError, match=r"^image: expected"):
            check_image_file(scratch, "image")


def test_the_bytes_of_a_png_file_depend_on_no_address():
    image, found, together = np.zeros((4, 9), np.uint8), set(), Barrier(256)

    def encode() -> None:
        # all at once, so that each has a stack of its own
        together.wait()
        found.add(encode_png(image))
        together.wait()

    threads = [Thread(target=encode) for _ in range(together.parties)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 1
