"""Laws of the comparison of poses with pixels: cast rays agree with it, and a shift is measured as what it is."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.pinhole import PinholeCamera
from oneframe.dataset.check.depth import agreement, surface_depth
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid, rotation_from_vector
from tests.dataset.synthetic_dataset import CAMERA, DEPTH_SCALE, cast_rays

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)


def random_view(rng: np.random.Generator, nearest: float) -> tuple[TriangleMesh, PinholeCamera, np.ndarray]:
    camera = PinholeCamera(24, 18, *rng.uniform(15, 60, 2), *rng.uniform(-2, 26, 2))
    mesh = TriangleMesh(rng.normal(size=(12, 3)), rng.permuted(np.tile(np.arange(12), (14, 1)), axis=1)[:, :3])
    pose = rigid(
        rotation_from_vector(2 * rng.normal(size=3)), [*rng.normal(scale=0.5, size=2), rng.uniform(nearest, 6)]
    )
    return mesh, camera, pose


@given(seeds, st.sampled_from([3.5, -1.0]))
def test_projected_triangles_have_the_depths_of_cast_rays(rng, nearest):
    """Also from inside the surface: triangles that reach behind the camera are not lost."""
    mesh, camera, pose = random_view(rng, nearest)
    found, expected = surface_depth(mesh, camera, pose), cast_rays(mesh, camera, pose)
    # a centre on an edge may fall to either side
    same = np.isclose(found.z, expected, rtol=1e-7, atol=1e-9)
    assert (~same).sum() <= 1, (found.z[~same], expected[~same])


@given(seeds, st.floats(0, 1.2))
def test_a_plane_that_fills_the_image_raises_no_false_alarm(rng, tilt):
    plane = plate(400)
    pose = rigid(rotation_from_vector(np.array([tilt, 0, rng.uniform(0, 6)])), [0, 0, 300])
    depth = np.rint(cast_rays(plane, CAMERA, pose) / DEPTH_SCALE).astype(np.uint16)
    found = agreement(depth, DEPTH_SCALE, surface_depth(plane, CAMERA, pose))
    assert (found.agreeing, found.only_one, found.outline) == (CAMERA.width * CAMERA.height, 0, 0)
    assert not found.misfit


def plate(half_width_mm: float) -> TriangleMesh:
    corners = half_width_mm * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
