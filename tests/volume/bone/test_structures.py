"""Structures: closed, outward, as large as their labels, and named by the anatomy."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from oneframe.surface.structure_colour import OTHER, structure_colour
from oneframe.volume.bone.structures import name_of_file, structure_meshes, structure_name
from oneframe.volume.volume import LabelMap, VoxelGrid
from tests.volume.solids import enclosed_mm3, is_closed, voxel_centres


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
