"""Structures: closed, outward, as large as their labels, and named by the anatomy."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.structure_colour import OTHER, structure_colour
from oneframe.volume.bone.structures import name_of_file, structure_meshes, structure_name
from oneframe.volume.bone.threshold import otsu_threshold
from oneframe.volume.reading.label_map import read_labels
from oneframe.volume.reading.volume_reader import read_volume
from oneframe.volume.volume import LabelMap, VoxelGrid
from tests.volume.solids import enclosed_mm3, is_closed, only, voxel_centres

BONES = Path(__file__).resolve().parents[4] / "shared" / "data" / "temporal_bones"


@pytest.mark.parametrize(("radius", "spacing"), [(2.0, (0.4, 0.4, 0.4)), (5.0, (0.4, 0.4, 0.6))])
def test_a_ball_is_found_within_a_tenth_of_a_voxel(radius, spacing):
    spacing, size = np.array(spacing), int(2 * radius / 0.4) + 12
    grid, centre = VoxelGrid((size,) * 3, np.diag([*spacing, 1.0])), spacing * size / 2 + [0.1, 0.03, -0.07]
    inside = np.linalg.norm(voxel_centres(grid) - centre, axis=-1) < radius
    mesh = structure_meshes(LabelMap(inside.astype(np.uint8) * 4, grid, {4: "Stapes"}))["stapes"]
    assert is_closed(mesh)
    errors = np.abs(np.linalg.norm(mesh.vertices - centre, axis=1) - radius)
    assert errors.mean() < 0.1 * spacing.max()


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, 1), (-1, -1, 1)])
def test_fronts_face_outward_and_small_structures_keep_their_volume(signs):
    """A nerve of one voxel across would vanish at level 0.5; here, beside it, a block at the volume's border."""
    values = np.zeros((20, 18, 16), np.uint8)
    values[np.arange(2, 18), 8, np.arange(2, 18) // 2] = 1
    values[9, 8, 4:9] = 1
    values[:4, :3, 10:] = 2
    grid = VoxelGrid((16, 18, 20), np.diag([*(0.3 * np.array(signs)), 1.0]))
    meshes = structure_meshes(LabelMap(values, grid, {1: "chorda tympani", 2: "dura"}))
    assert list(meshes) == ["chorda_tympani", "dura"]
    for label, mesh in zip((1, 2), meshes.values(), strict=True):
        assert is_closed(mesh)
        assert enclosed_mm3(mesh) == pytest.approx(np.count_nonzero(values == label) * 0.027, rel=0.05)


def test_names_are_those_of_the_anatomy_alone():
    for given, expected in {
        "FacialNerve_L": "facial_nerve_left",
        "CN VII right": "facial_nerve_right",
        "Ossicular chain": "ossicles",
        "bony labyrinth": "bony_labyrinth",
        "Sigmoid Sinus": "sinus",
        "cochlear_nerve": "cochlear_nerve",
        "label 3": "label_3",
    }.items():
        assert structure_name(given) == expected
    for file, expected in {
        "DOE_JOHN_1970.stl": "structure_1",
        "DOE facial nerve R.ply": "facial_nerve_right",
        "chorda.obj": "structure_1",
    }.items():
        assert name_of_file(Path(file), ["chorda_tympani", "structure_2"]) == expected
    # those of the paper
    for colour, names in {
        (1, 0, 1): ("facial_nerve_left", "Facial Nerve (left)", "cn-vii", "nerve"),
        (0, 1, 1): ("malleus", "incus+stapes", "Ossicles"),
        (0, 1, 0): ("chorda_tympani",),
        OTHER: ("cochlear_nerve", "fnord"),
    }.items():
        assert {structure_colour(name) for name in names} == {colour}


def test_names_that_meet_stay_apart():
    values = np.zeros((6, 6, 6), np.uint8)
    values[1:3, 1:3, 1:3], values[4:, 4:, 4:] = 1, 2
    labels = LabelMap(values, VoxelGrid((6, 6, 6), np.eye(4)), {1: "facial nerve", 2: "facial canal"})
    assert list(structure_meshes(labels)) == ["facial_nerve", "facial_nerve_2"]
    assert list(structure_meshes(replace(labels, values=values[:3, :3, :3]))) == ["facial_nerve"]


@pytest.mark.skipif(not BONES.is_dir(), reason="no folder shared/data beside the repository")
@pytest.mark.parametrize("side", ["LT143", "RT143"])
def test_structures_of_a_temporal_bone_lie_where_their_meshes_do(side):
    """On their own grid within a voxel; and as large on the grid of the CT, where the chorda is two voxels wide."""
    names = ["facial_nerve", "chorda_tympani", "incus", "stapes"]
    table = json.loads((BONES / "labels.json").read_text())["labels"].values()
    expected_mm3 = {entry["name"]: entry["volume_mm3"][side] for entry in table if entry["name"] in names}
    ct = read_volume(BONES / f"{side}_pseudoct_semisynthetic.nii.gz")
    assert 600 < otsu_threshold(ct) < 680
    fine, coarse = (
        structure_meshes(only(read_labels(BONES / f"{side}_labels.nii.gz", ct, resampled=resampled), names))
        for resampled in (False, True)
    )
    assert sorted(fine) == sorted(coarse) == sorted(names)
    for name in names:
        theirs, _ = read_mesh(BONES / "ply" / side / f"{name}.ply")
        np.testing.assert_allclose(fine[name].bounds, theirs.bounds, atol=0.19)
        assert enclosed_mm3(fine[name]) == pytest.approx(expected_mm3[name], rel=0.05)
        assert enclosed_mm3(coarse[name]) == pytest.approx(expected_mm3[name], rel=0.15)
