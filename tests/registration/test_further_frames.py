"""A photograph by another camera becomes what the case's camera sees from the same place."""

import json
from dataclasses import replace

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import read_case
from oneframe.images.png import encode_png
from oneframe.registration.further_frames import FrameReader, listed_images

OWN = PinholeCamera(320, 240, 500.0, 505.0, 150.0, 130.0)


def seen(camera: PinholeCamera) -> np.ndarray:
    """A smooth world at infinity."""
    x, y = np.moveaxis(camera.rays_cam(camera.pixel_grid())[..., :2], -1, 0)
    return 0.5 + np.stack([np.sin(20 * x), np.cos(25 * y), np.sin(15 * (x + y))], axis=-1) / 2.5


@pytest.mark.parametrize(("width", "focal_px"), [(320, 1000.0), (400, 400.0)])
def test_every_camera_shows_the_same_world(write_tiny_case, tmp_path, width, focal_px):
    camera = PinholeCamera(width, 240, focal_px, 1.01 * focal_px, 170.0, 110.0)
    (tmp_path / "1.png").write_bytes(encode_png(np.rint(255 * seen(camera)).astype(np.uint8)))
    (tmp_path / "scene_camera.json").write_text(
        json.dumps({"1": {"cam_K": camera.k.tolist()}, "2": {"K": OWN.k.tolist()}})
    )
    (tmp_path / "list.json").write_text(json.dumps([{"image": "1.png", "camera": "scene_camera.json#1"}]))
    (listed,) = listed_images(tmp_path / "list.json")
    frame = FrameReader(replace(read_case(write_tiny_case(tmp_path)), camera=OWN)).image(0, listed)
    assert frame.valid.mean() > 0.15
    assert np.quantile(np.abs(frame.image / 255 - seen(OWN))[frame.valid], 0.99) < 0.02
