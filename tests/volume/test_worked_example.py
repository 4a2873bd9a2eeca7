"""The drill opens the field: what the plans of the documentation and a small generated bone leave in sight."""

from pathlib import Path

import numpy as np
import pytest

from oneframe.surface.deviation import SurfaceTree
from oneframe.surface.mesh import TriangleMesh
from oneframe.volume.bone.bone import bone_voxels
from oneframe.volume.bone.bone_surface import bone_surface
from oneframe.volume.bone.structures import structure_meshes, structure_names, without_bone
from oneframe.volume.drill.clearance import clearances, violations
from oneframe.volume.drill.drill_plan import DrillPlan, Stroke, read_drill_plan
from oneframe.volume.make_surface import finish_of, removed_of
from oneframe.volume.reading.label_map import read_labels
from oneframe.volume.reading.volume_reader import read_volume
from oneframe.volume.volume import Volume, VoxelGrid
from tests.volume.solids import ball, only

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
BONES = ROOT.parent / "shared" / "data" / "temporal_bones"
RADIUS_MM = 1.0


def drilled_surface(
    volume: Volume, plan: DrillPlan, structures: dict[str, TriangleMesh]
) -> tuple[TriangleMesh, list[str]]:
    """What ``oneframe surface --drill --tolerance 0`` writes, and its sentences about margins."""
    solid = bone_voxels(volume, 300)
    removed = removed_of(plan, volume, structures, tolerance_mm=0.0)
    assert removed is not None
    finish = finish_of(volume, solid, removed, structures, tolerance_mm=0.0)
    made = bone_surface(volume, 300, solid, removed, finish)
    found = clearances(made.surface, removed, volume.grid, structures, plan.margins_mm)
    return made.surface.mesh, violations(found)


def widest_sight_line(surface: TriangleMesh, tip: np.ndarray, start_mm: float, directions: np.ndarray) -> float:
    """Radius of the widest free cylinder from ``start_mm`` above a point outwards, along one of the directions."""
    tree = SurfaceTree(surface)
    lower, upper = surface.bounds
    widest = 0.0
    for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        points = tip + np.arange(start_mm, np.linalg.norm(upper - lower), 0.2)[:, None] * direction
        points = points[((points > lower - 3) & (points < upper + 3)).all(axis=1)]
        widest = max(widest, float(tree.distances(points).min()))
    return widest


@pytest.mark.skipif(not BONES.is_dir(), reason="no folder shared/data beside the repository")
def test_a_mastoidectomy_holds_its_margins_and_shows_the_incus():
    side, lateral = "RT143", -1
    volume = read_volume(BONES / f"{side}_pseudoct_semisynthetic.nii.gz")
    labels = without_bone(read_labels(BONES / f"{side}_labels.nii.gz", volume, resampled=False))
    plan = read_drill_plan(ROOT / "docs" / "examples" / f"drill_{side.lower()}.toml")
    spared = set(plan.margins_mm) & set(structure_names(labels).values())
    assert spared >= {"facial_nerve", "chorda_tympani", "sinus_dura", "eac", "incus"}
    structures = structure_meshes(only(labels, spared))
    surface, sentences = drilled_surface(volume, plan, structures)
    assert sentences == []
    # its tip points backwards
    incus = structures["incus"].vertices
    tip = incus[incus[:, 1].argmax()]
    # a burr of the radius of the line touches the margin from here; the incus is no ball
    start = plan.margins_mm["incus"] + RADIUS_MM + 0.5
    towards = np.array([0.76 * lateral, 0.56, 0.33]) + np.random.default_rng(0).normal(0, 0.03, (20, 3))
    assert widest_sight_line(surface, tip, start, towards) > RADIUS_MM


def test_a_sheet_of_bone_left_over_the_cavity_closes_the_view():
    rng = np.random.default_rng(0)
    grid = VoxelGrid((50, 50, 50), np.diag([0.4, 0.4, 0.4, 1.0]))
    values = np.full((50, 50, 50), -1000.0)
    values[4:46, 4:46, 4:46] = 1300
    # an air cell around the tip
    values[22:30, 22:30, 9:16] = -1000
    volume = Volume((values + rng.normal(0, 35, values.shape)).astype(np.int16), grid)
    structures = {"incus": ball(0.8, np.array([3.6, 10.0, 10.0])), "nerve": ball(1.5, np.array([9.0, 14.0, 10.0]))}
    tip, margins = np.array([4.4, 10.0, 10.0]), {"incus": 1.0, "nerve": 0.8}
    strokes = [
        Stroke(2.0, np.array([[x, 8.0, 8.0], [x, 12.0, 12.0], [x, 8.0, 12.0], [x, 12.0, 8.0]])) for x in (9, 12, 15)
    ]
    strokes.append(Stroke(1.5, np.array([[7.0, 10.0, 10.0], [9.0, 10.0, 10.0]])))
    outwards = np.array([[1.0, 0.0, 0.0], [1.0, 0.05, 0.0], [1.0, 0.0, 0.05]])
    closed, _ = drilled_surface(volume, DrillPlan(tuple(strokes[:2] + strokes[3:]), margins), structures)
    assert widest_sight_line(closed, tip, 2.0, outwards) < 0.2
    strokes.append(Stroke(3.0, np.array([[18.0, 8.0, 8.0], [18.0, 12.0, 12.0]])))
    open_, sentences = drilled_surface(volume, DrillPlan(tuple(strokes), margins), structures)
    assert widest_sight_line(open_, tip, 2.0, outwards) > RADIUS_MM
    assert sentences == []
