"""Slices of voxels: each pixel is the voxel that lies where the pixel says, whatever the volume's axes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oneframe.transforms import rotation_from_vector, transform_points
from oneframe.volume.slices.slice_planes import slice_planes
from oneframe.volume.volume import VoxelGrid

AXES = {"R": (0, -1), "L": (0, 1), "A": (1, -1), "P": (1, 1), "S": (2, 1), "I": (2, -1)}


@given(
    order=st.permutations(range(3)),
    signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 3),
    tilt=st.tuples(*[st.floats(-0.4, 0.4)] * 3),
    seed=st.integers(0, 99),
)
def test_a_pixel_is_the_voxel_at_its_place_and_the_letters_say_where(order, signs, tilt, seed):
    rng = np.random.default_rng(seed)
    size = tuple(int(n) for n in rng.integers(2, 7, 3))
    matrix = np.eye(4)
    axes = rotation_from_vector(np.array(tilt)) @ np.eye(3)[:, order] * np.array(signs)
    matrix[:3, :3] = axes * rng.uniform(0.2, 1.5, 3)
    matrix[:3, 3] = rng.uniform(-50, 50, 3)
    grid = VoxelGrid(size, matrix)
    values = rng.integers(0, 10_000, size[::-1])
    shown = set()
    for plane in slice_planes(grid):
        width, height = plane.size_wh
        number, u, v = (int(rng.integers(count)) for count in (plane.count, width, height))
        point = plane.point_at(number, u, v)
        np.testing.assert_allclose(plane.place_of(point), (number, u, v), atol=1e-9)
        x, y, z = np.rint(transform_points(grid.index_from_mesh, point[None])[0]).astype(int)
        piece = plane.slice_of(values, number)
        assert piece.shape == (height, width)
        assert piece[v, u] == values[z, y, x]
        shown.add(plane.axes[0])
        left, right, top, bottom = plane.directions
        for first, second, step in ((left, right, (1, 0)), (top, bottom, (0, 1))):
            along = plane.point_at(number, *step) - plane.point_at(number, 0, 0)
            axis, sign = AXES[second]
            assert AXES[first] == (axis, -sign)
            assert sign * along[axis] > 0.5 * np.linalg.norm(along)
    assert shown == {0, 1, 2}
