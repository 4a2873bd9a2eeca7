"""How near a drill came to structures, against known distances."""

import numpy as np
import pytest

from oneframe.volume.bone.bone_surface import bone_surface, widened_mm
from oneframe.volume.bone.isosurface import isosurface
from oneframe.volume.drill.drill_plan import DrillPlan, Stroke
from oneframe.volume.drill.virtual_drill import clearances, removed_by_plan, violations
from oneframe.volume.make_surface import finish_of, removed_of
from oneframe.volume.volume import Volume, VoxelGrid
from tests.volume.solids import ball

GRID = VoxelGrid((60, 60, 60), np.diag([0.5, 0.5, 0.5, 1.0]))
BONE = np.full((60, 60, 60), 1000, np.int16)
MIDDLE = np.full(3, 15.0)


def test_distances_are_those_of_the_drilled_surface_the_nearest_first():
    placed = {"far": (2, (9, 0, 0)), "near": (1, (0, -6, 0)), "gone": (1, (0, 0, 0))}
    structures = {name: ball(radius, MIDDLE + offset, 4) for name, (radius, offset) in placed.items()}
    margins = {"near": 2.5, "gone": 1.0}
    removed = removed_by_plan(DrillPlan((Stroke(3.0, MIDDLE[None]),)), GRID, structures)
    assert removed is not None
    surface = isosurface(BONE, 300, GRID, removed=removed)
    found = clearances(surface, removed, GRID, structures, margins)
    assert [each.structure for each in found] == ["gone", "near", "far"]
    gone, near, far = found
    # the surface of the cavity is 2 mm away, but the structure lies in what was removed
    assert gone.smallest_mm == pytest.approx(-3, abs=1.1)
    assert near.smallest_mm == pytest.approx(2, abs=0.03)
    np.testing.assert_allclose(near.at, MIDDLE - (0, 3, 0), atol=0.4)
    assert (far.margin_mm, far.smallest_mm) == (None, pytest.approx(4, abs=0.03))
    assert [sentence.split(":")[0] for sentence in violations(found)] == ["gone", "near"]
    assert violations([far]) == []


@pytest.mark.parametrize(("seed", "tolerance_mm"), [(3, 0.0), (11, None), (4, 0.0), (5, None)])
def test_margins_hold_on_the_finished_surface_and_little_more_stays(seed, tolerance_mm):
    """Round thin structures on a coarse grid: where linear interpolation and flat faces come nearest."""
    rng = np.random.default_rng(seed)
    grid = VoxelGrid((40, 40, 40), np.diag([*rng.uniform(0.35, 0.7, 3), 1]))
    middle = grid.bounds_mm[1] / 2
    values = 1000 + rng.normal(0, 50, (40, 40, 40))
    values[:, :, 30:] = -1000
    volume, solid = Volume(values.astype(np.int16), grid), values > 300
    margin = float(rng.uniform(0.2, 1.5))
    structures = {f"nerve {n}": ball(rng.uniform(0.2, 1), middle + rng.uniform(-3, 3, 3), 4) for n in range(3)}
    strokes = tuple(Stroke(float(rng.uniform(0.8, 2.5)), middle + rng.uniform(-4, 4, (3, 3))) for _ in range(3))
    plan = DrillPlan(strokes, dict.fromkeys(structures, margin))
    removed = removed_of(plan, volume, structures, tolerance_mm=tolerance_mm)
    assert removed is not None
    finish = finish_of(volume, solid, removed, structures, tolerance_mm=tolerance_mm)
    made = bone_surface(volume, 300, solid, removed, finish)
    found = clearances(made, removed, grid, structures, plan.margins_mm)
    assert violations(found) == []
    assert margin <= found[0].smallest_mm <= widened_mm(margin, grid, finish.tolerance_mm)
    assert clearances(isosurface(volume.values, 300, grid), removed, grid, structures, {}) == ()
