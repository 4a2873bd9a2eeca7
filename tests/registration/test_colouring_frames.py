"""Which frames colour the surface: none that is blurred or covered, first the one that adds most."""

import cv2
import numpy as np
import pytest

from oneframe.colour.seen_frame import SeenFrame
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.registration.colouring_frames import colouring_frames
from oneframe.registration.further_frames import FurtherFrame
from tests.alignment.test_refinement import hills
from tests.registration.test_registration import CAMERA, SOURCE, photograph, seen_from

EVERYWHERE = np.ones(CAMERA.shape_hw, bool)
SEEN_PX = 200
"""Columns of the case's frame that show the surface; the rest is masked out."""
MESH = hills(1)


@pytest.fixture(scope="module")
def own() -> SeenFrame:
    valid = EVERYWHERE.copy()
    valid[:, SEEN_PX:] = False
    inverse = np.where(valid, rasterise_depth(MESH, CAMERA, SOURCE).inverse_depth, 0).astype(np.float32)
    return SeenFrame(tinted(photograph(MESH, SOURCE)), valid, CAMERA, SOURCE, inverse_depth=inverse)


def tinted(image: np.ndarray) -> np.ndarray:
    return np.clip(image * [1.1, 0.95, 0.8], 0, 1).astype(np.float32)


def candidate(number: int, tilt: float, roll: float, spoil=lambda image: image) -> tuple[FurtherFrame, np.ndarray]:
    pose = seen_from(tilt, roll)
    image = spoil(tinted(photograph(MESH, pose, seed=0)))
    return FurtherFrame("", number, np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8), EVERYWHERE), pose


def under_an_instrument(image: np.ndarray) -> np.ndarray:
    image = image.copy()
    cv2.line(image, (160, 0), (110, 240), (0.95, 0.97, 1.0), 14)
    return image


def bloody(image: np.ndarray) -> np.ndarray:
    image = image.copy()
    cv2.circle(image, (90, 120), 25, (0.3, 0.02, 0.02), -1)
    return image


SPOILT = {
    "blurred": lambda image: cv2.GaussianBlur(image, (0, 0), 3.0),
    "shaken": lambda image: cv2.blur(image, (15, 1)),
    "instrument": under_an_instrument,
    "blood": bloody,
    "glare": lambda image: image + np.where(np.hypot(*(np.mgrid[:240, :320] - 110)) < 25, 0.7, 0)[..., None],
}


def test_spoilt_frames_are_not_taken_and_others_add_what_the_own_did_not_see(own):
    rng = np.random.default_rng(0)
    clear = [candidate(number, *rng.uniform((-15, -40), (15, 40))) for number in range(4)]
    # in another light, which is matched
    clear.append(candidate(4, *rng.uniform((-15, -40), (15, 40)), lambda image: 0.7 * image))
    spoilt = [
        candidate(10 + number, *rng.uniform((-15, -40), (15, 40)), spoil)
        for number, spoil in enumerate(SPOILT.values())
    ]
    chosen, lines = colouring_frames(MESH, own, [*spoilt, *clear], 3)
    assert "of 10 accepted frames, 2 are blurred and 3 covered in part; of the other 5" in lines[-1]
    assert 1 <= len(chosen) == len(lines) - 1
    assert set(chosen) <= {frame.number for frame, _ in clear}
    added = [float(line.split(" colours ")[1].split("%")[0]) for line in lines[:-1]]
    assert added[0] > 15
    assert added == sorted(added, reverse=True)
    # the order of the frames says nothing
    assert colouring_frames(MESH, own, [*clear, *spoilt][::-1], 3)[0] == chosen
    # nor is one taken that adds nothing
    same = [candidate(number, 0, 0) for number in range(3)]
    chosen, lines = colouring_frames(MESH, own, same, 4)
    assert chosen == [0]
    assert "1 colours what" in lines[-1]
    assert colouring_frames(MESH, own, [], 4)[0] == []
