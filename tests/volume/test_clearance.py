"""How near a drill came to structures, against known distances."""

import numpy as np
import pytest
import trimesh

from pipeline.surface.mesh import TriangleMesh
from pipeline.volume.bone_surface import moved_mm
from pipeline.volume.clearance import clearances, violations
from pipeline.volume.drill_plan import DrillPlan, Stroke
from pipeline.volume.drilled_volume import removed_by_plan
from pipeline.volume.isosurface import isosurface
from pipeline.volume.volume import VoxelGrid

GRID = VoxelGrid((60, 60, 60), np.diag([0.5, 0.5, 0.5, 1.0]))
BONE = np.full((60, 60, 60), 1000, np.int16)
MIDDLE = np.full(3, 15.0)


def ball(radius: float, centre: np.ndarray) -> TriangleMesh:
    sphere = trimesh.creation.icosphere(4, radius)
    return TriangleMesh(np.asarray(sphere.vertices) + centre, np.asarray(sphere.faces, np.int32))


def test_distances_are_those_of_the_drilled_surface_the_nearest_first():
    structures = {"far": ball(2, MIDDLE - (-9, 0, 0)), "near": ball(1, MIDDLE - (0, 6, 0)), "gone": ball(1, MIDDLE)}
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
    sentences = violations(found)
    assert len(sentences) == 2
    assert sentences[0].startswith("gone: the drill went ")
    assert sentences[1].startswith("near: expected a margin of 2.5 mm, found 2.0")
    assert violations([far]) == []


def test_margins_that_were_kept_are_no_violation():
    structures = {"nerve": ball(1, MIDDLE - (0, 3, 0))}
    plan = DrillPlan((Stroke(3.0, MIDDLE[None]),), {"nerve": 1.2})
    removed = removed_by_plan(plan, GRID, structures, slack_mm=moved_mm(GRID, 0.0))
    assert removed is not None
    surface = isosurface(BONE, 300, GRID, removed=removed)
    (nerve,) = clearances(surface, removed, GRID, structures, plan.margins_mm)
    assert 1.2 <= nerve.smallest_mm < 1.25 + moved_mm(GRID, 0.0)
    assert violations([nerve]) == []
    assert clearances(isosurface(BONE, 300, GRID), removed, GRID, structures, {}) == ()
