"""Slices through volumes that lie anywhere show the patient the same way."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from oneframe.transforms import transform_points
from oneframe.volume.bone.isosurface import RemovedField
from oneframe.volume.slices.slice_views import DrawnBone, LabelColours, slice_views
from oneframe.volume.volume import LabelMap, Sampler, Volume, VoxelGrid
from tests.volume.solids import voxel_centres


def random_grid(seed: int, size: tuple[int, int, int]) -> VoxelGrid:
    """Oblique, anisotropic, right- or left-handed."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.3, 2, 3)
    matrix[:3, 3] = rng.uniform(-100, 100, 3)
    return VoxelGrid(size, matrix)


@given(st.integers(0, 2**32 - 1))
def test_linear_field_is_sampled_exactly_and_what_lies_outside_is_told(seed):
    rng = np.random.default_rng(seed)
    grid = random_grid(seed, (7, 5, 4))
    slope = rng.normal(size=3)
    index = rng.uniform(-2, 8, (50, 3))
    points = transform_points(grid.mesh_from_index, index)
    found = Sampler(grid, points).values(voxel_centres(grid) @ slope, outside=1e6)
    inside = ((index >= 0) & (index <= (6, 4, 3))).all(axis=1)
    beyond = ((index < -0.501) | (index > (6.501, 4.501, 3.501))).any(axis=1)
    np.testing.assert_allclose(found[inside], points[inside] @ slope, rtol=1e-4, atol=1e-3)
    assert (found[beyond] == 1e6).all()


def test_patients_right_is_on_the_left_and_the_head_at_the_top():
    grid = random_grid(0, (20, 24, 28))
    points = voxel_centres(grid)
    middle = grid.bounds_mm.mean(axis=0)
    for axis, sides in enumerate(("RL", "AP", "IS")):
        # brighter to the left, to the back and to the head
        values = (300 + 10 * (points[..., axis] - middle[axis])).astype(np.int16)
        for view in slice_views(Volume(values, grid), middle, DrawnBone(300)):
            rows, columns = np.nonzero(view.image > 0)
            value = view.image[rows, columns]
            left, right, top, bottom = view.directions
            if {left, right} == set(sides):
                assert (np.cov(columns, value)[0, 1] > 0) == (right == sides[1])
            if {top, bottom} == set(sides):
                assert (np.cov(rows, value)[0, 1] > 0) == (bottom == sides[1])


def test_contours_and_the_drilled_part_lie_where_they_are_in_the_patient():
    grid = random_grid(3, (40, 44, 48))
    points, middle = voxel_centres(grid), grid.bounds_mm.mean(axis=0)
    distance = np.linalg.norm(points - middle, axis=-1)
    ball = Volume(np.clip(300 - 200 * (distance - 9), -1000, 1500).astype(np.int16), grid)
    first, part = (5, 6, 7), np.s_[7:40, 6:40, 5:38]
    burr = middle + np.array([4.0, 0.0, 0.0])
    distances = np.linalg.norm(points[part] - burr, axis=-1) - 3
    # as of a drill: far from its surface it tells the side alone
    distances[distances > 2 * grid.spacing_mm.max()] = 1e3
    removed = RemovedField(np.array(first), distances.astype(np.float32))
    labels = LabelMap((distance < 5).astype(np.uint8) * 3, grid, {3: "nerve"})
    drawn = [LabelColours(labels, {3: (1, 0, 1), 4: (0, 1, 0)})]
    axial, _, _ = slice_views(ball, middle, DrawnBone(300, distance < 12, removed, drawn))
    height, width = axial.image.shape
    lower, _ = grid.bounds_mm
    x = lower[0] + (np.arange(width) + 0.5) * axial.mm_per_px - middle[0]
    y = lower[1] + (np.arange(height) + 0.5) * axial.mm_per_px - middle[1]
    radius = np.hypot(x, y[:, None])
    bone, drill, nerve = axial.contours
    assert not ((bone.field > 0) != (radius < 9))[np.abs(radius - 9) > 0.1].any()
    reached = np.hypot(x - 4, y[:, None])
    assert not (axial.tinted != ((reached < 3) & (radius < 9)))[np.abs(reached - 3) > 0.1].any()
    assert drill.shown is not None
    away = reached - 3 > 1.5 * grid.spacing_mm.max()
    rows, columns = np.gradient(drill.field)
    # no line where the distances end
    assert not (np.abs(drill.field) < 3 * np.hypot(rows, columns))[away].any()
    assert not ((nerve.field > 0) != (radius < 5))[np.abs(radius - 5) > grid.spacing_mm.max()].any()
    assert axial.title == f"AXIAL Z {middle[2]:.1f}"
