"""Edges are found on both sides and nowhere else; the pattern of rays measures areas."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.projection.edge_pixels import edge_pixels, pixel_pattern

CAMERA = PinholeCamera(40, 30, 900.0, 880.0, 18.5, 15.0)
ALL = np.ones(CAMERA.shape_hw, dtype=bool)


def plane_depth(normal: np.ndarray, distance_mm: float) -> np.ndarray:
    """Depth at the pixel centres of the plane through (0, 0, distance)."""
    return (distance_mm * normal[2] / (CAMERA.rays_cam(CAMERA.pixel_grid()) @ normal)).astype(np.float32)


@given(slope=st.floats(0, 89.0), azimuth=st.floats(0, 2 * np.pi), distance=st.floats(5.0, 5000.0))
def test_a_plane_has_no_edges_however_steep(slope, azimuth, distance):
    tilt = np.radians(slope)
    normal = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    rays = CAMERA.rays_cam(CAMERA.pixel_grid())
    depth = np.where(rays @ normal > 0.003, plane_depth(normal, distance), np.float32(0))
    if (depth > 0).all():
        assert not edge_pixels(depth, ALL, CAMERA).any()


@pytest.mark.parametrize("first", [1, 2, 15, 29])
@pytest.mark.parametrize("kind", ["depth", "background", "observed"])
@pytest.mark.parametrize("along_rows", [False, True])
def test_both_sides_of_an_edge_and_no_other_pixel(first, kind, along_rows):
    camera = PinholeCamera(30, 30, 900.0, 880.0, 14.0, 15.0)
    depth, observed = np.full((30, 30), 300, np.float32), np.ones((30, 30), dtype=bool)
    across = (slice(first, None), slice(None)) if along_rows else (slice(None), slice(first, None))
    if kind == "depth":
        depth[across] += 1.5
    else:
        observed[across] = False
        depth[across] = 0 if kind == "background" else 300
    wanted = np.zeros((30, 30), dtype=bool)
    (wanted if along_rows else wanted.T)[first - 1 : first + 1] = True
    found = edge_pixels(depth, observed, camera)
    assert found[wanted].all()
    # of a step beside the rim, the pixels on the rim cannot tell on which side of their neighbours it is
    assert np.count_nonzero(found & ~wanted) == (30 if kind != "observed" and first == 2 else 0)


@pytest.mark.parametrize(("count", "bound"), [(4, 0.11), (8, 0.06), (16, 0.036), (64, 0.013)])
def test_the_pattern_measures_the_area_next_to_an_edge(rng, count, bound):
    angle = rng.uniform(0, 2 * np.pi, 2000)
    normal = np.stack([np.cos(angle), np.sin(angle)])
    offset = rng.uniform(-1, 1, 2000) * np.abs(normal).sum(axis=0) / 2
    fine = (np.arange(64) + 0.5) / 64 - 0.5
    grid = np.stack(np.meshgrid(fine, fine), -1).reshape(-1, 2)
    area, measured = ((points @ normal < offset).mean(axis=0) for points in (grid, pixel_pattern(count)))
    assert np.sqrt(np.mean((measured - area) ** 2)) < bound
