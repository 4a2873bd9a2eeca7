"""The drill opens the field: what a plan of the documentation leaves in sight."""

from pathlib import Path

import numpy as np
import pytest

from oneframe.surface.mesh import TriangleMesh
from oneframe.volume.bone.bone import bone_voxels
from oneframe.volume.bone.bone_surface import bone_surface
from oneframe.volume.bone.structures import structure_meshes, structure_names, without_bone
from oneframe.volume.drill.drill_plan import read_drill_plan
from oneframe.volume.drill.virtual_drill import clearances, surface_distances, violations
from oneframe.volume.make_surface import finish_of, removed_of
from oneframe.volume.reading.label_map import read_labels
from oneframe.volume.reading.volume_reader import read_volume
from tests.volume.solids import only

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
BONES = ROOT.parent / "shared" / "data" / "temporal_bones"
RADIUS_MM = 1.0


def widest_sight_line(surface: TriangleMesh, tip: np.ndarray, start_mm: float, directions: np.ndarray) -> float:
    """Radius of the widest free cylinder from ``start_mm`` above a point outwards, along one of the directions."""
    lower, upper = surface.bounds
    along = np.arange(start_mm, np.linalg.norm(upper - lower), 0.2)
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    points = (tip + along[:, None] * units[:, None]).reshape(-1, 3)
    within = ((points > lower - 3) & (points < upper + 3)).all(axis=1)
    distance = np.full(len(points), np.inf)
    distance[within] = surface_distances(points[within], surface)
    return float(distance.reshape(len(units), -1).min(axis=1).max())


@pytest.mark.skipif(not BONES.is_dir(), reason="no folder shared/data beside the repository")
def test_a_mastoidectomy_holds_its_margins_and_shows_the_incus():
    """On what ``oneframe surface --drill --tolerance 0`` writes."""
    volume = read_volume(BONES / "RT143_pseudoct_semisynthetic.nii.gz")
    labels = without_bone(read_labels(BONES / "RT143_labels.nii.gz", volume))
    plan = read_drill_plan(ROOT / "docs" / "examples" / "drill_rt143.toml")
    spared = set(plan.margins_mm) & set(structure_names(labels).values())
    assert spared >= {"facial_nerve", "chorda_tympani", "sinus_dura", "eac", "incus"}
    structures = structure_meshes(only(labels, spared))
    solid = bone_voxels(volume, 300)
    removed = removed_of(plan, volume, structures, tolerance_mm=0.0)
    assert removed is not None
    finish = finish_of(volume, solid, removed, structures, tolerance_mm=0.0)
    surface = bone_surface(volume, 300, solid, removed, finish)
    assert violations(clearances(surface, removed, volume.grid, structures, plan.margins_mm)) == []
    # its tip points backwards
    incus = structures["incus"].vertices
    tip = incus[incus[:, 1].argmax()]
    # a burr of the radius of the line touches the margin from here; the incus is no ball
    start = plan.margins_mm["incus"] + RADIUS_MM + 0.5
    towards = np.array([-0.76, 0.56, 0.33]) + np.random.default_rng(0).normal(0, 0.03, (20, 3))
    assert widest_sight_line(surface.mesh, tip, start, towards) > RADIUS_MM
