"""The virtual drill: exact, free of any order, and with the voxels of a mesh; its margins are in test_clearance.py."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.errors import InputError
from oneframe.surface.mesh import TriangleMesh
from oneframe.volume.bone.isosurface import isosurface
from oneframe.volume.drill.drill_plan import DrillPlan, Stroke
from oneframe.volume.drill.virtual_drill import filled, removed_by_plan
from oneframe.volume.volume import VoxelGrid
from tests.volume.solids import ball, oblique_grid, voxel_centres, whole

SIZE = 40


def strokes_in(rng: np.random.Generator, count: int) -> list[Stroke]:
    return [Stroke(float(rng.uniform(0.5, 2)), rng.uniform(-9, 9, (int(rng.integers(1, 4)), 3))) for _ in range(count)]


def test_the_field_does_not_depend_on_the_order_of_the_strokes(rng):
    grid = oblique_grid(rng, rng.uniform(0.3, 0.6, 3), SIZE)
    structures = {"nerve": ball(1.5, rng.uniform(-5, 5, 3)), "sinus": ball(3, rng.uniform(-5, 5, 3))}
    strokes = strokes_in(rng, 4)
    one, other = (
        whole(removed_by_plan(DrillPlan(each, {"nerve": 0.0, "sinus": 1.0}), grid, structures), grid)
        for each in (tuple(strokes), (*strokes[::-1], strokes[2]))
    )
    assert (one <= 0).any()
    np.testing.assert_array_equal(one, other)


def capsule(points: np.ndarray, stroke: Stroke) -> np.ndarray:
    """``(N,)`` signed distances from the first segment of a stroke, by an independent formula."""
    a, b = stroke.points
    along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(points - (a + along[:, None] * (b - a)), axis=1) - stroke.radius_mm


@pytest.mark.parametrize("seed", [0, 2])
def test_a_burr_leaves_its_capsule_and_the_rest_to_the_last_bit(seed):
    rng = np.random.default_rng(seed)
    grid = oblique_grid(rng, np.array([0.4, 0.4, 0.4 * (1 + seed / 2)]), SIZE)
    depth = 7 - np.linalg.norm(voxel_centres(grid), axis=-1)
    values = np.clip(300 + depth * 1500 + rng.normal(0, 40, depth.shape), -1000, 2000).astype(np.int16)
    stroke = Stroke(2.5, np.array([[2.0, -1.0, 3.0], [6.0, 1.0, 5.5]]))
    removed = removed_by_plan(DrillPlan((stroke,)), grid, {})
    intact = isosurface(values, 300, grid)
    surface = isosurface(values, 300, grid, removed=removed)
    made = surface.mesh.vertices[surface.drilled]
    assert len(made) > 500
    error = np.abs(capsule(made, stroke)) / grid.spacing_mm.min()
    # of linear interpolation of the distance to a burr of this radius
    bound = (grid.spacing_mm**2).max() / (8 * stroke.radius_mm) / grid.spacing_mm.min()
    assert error.mean() < bound / 2
    assert error.max() < bound + 0.005
    before = set(map(tuple, intact.mesh.vertices.tolist()))
    assert all(tuple(vertex) in before for vertex in surface.mesh.vertices[~surface.drilled].tolist())


def test_only_margins_spare_and_each_needs_its_structure():
    grid = VoxelGrid((20, 20, 20), np.eye(4))
    plan = DrillPlan((Stroke(4.0, np.full((1, 3), 10.0)),))
    free, beside = (removed_by_plan(plan, grid, each) for each in ({}, {"nerve": ball(2, np.full(3, 10.0))}))
    np.testing.assert_array_equal(whole(free, grid), whole(beside, grid))
    with pytest.raises(InputError, match=r"expected structures of the label map \(nerve\), found sinus"):
        removed_by_plan(DrillPlan(plan.strokes, {"sinus": 1.0}), grid, {"nerve": ball(2, np.full(3, 10.0))})
    assert removed_by_plan(DrillPlan(()), grid, {}) is None


@given(st.integers(0, 2**32 - 1))
def test_surface_of_noise_is_filled_with_its_material(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=rng.integers(1, 9, 3))
    grid = replace(oblique_grid(rng, rng.uniform(0.2, 1, 3), 100), size=values.shape[::-1])
    mesh = isosurface(values, 0, grid).mesh
    if len(mesh.faces) == 0:
        return
    # seen from a smaller volume too
    cut = rng.integers(0, values.shape)
    for at, material in (((0, 0, 0), values > 0), (cut, (values > 0)[cut[0] :, cut[1] :, cut[2] :])):
        part = grid.shifted(np.array(at[::-1]), material.shape[::-1])
        first, inside = filled(mesh, part)
        found = np.zeros(material.shape, np.bool_)
        found[tuple(slice(a, a + n) for a, n in zip(first[::-1], inside.shape, strict=True))] = inside
        np.testing.assert_array_equal(found, material)


def test_mesh_with_a_hole_is_refused():
    grid = VoxelGrid((6, 6, 6), np.eye(4))
    mesh = isosurface(np.pad(np.ones((4, 4, 4)), 1), 0.5, grid).mesh
    side = mesh.face_centres[:, 0] < mesh.vertices[:, 0].max() - 1e-6
    with pytest.raises(InputError, match="expected a closed mesh"):
        filled(TriangleMesh(mesh.vertices, mesh.faces[side]), grid)
