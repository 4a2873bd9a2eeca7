"""The built-in sample surface: an open sheet with fronts towards the air, and overhangs like those of drilled bone."""

import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from oneframe.sample.temporal_bone import (
    LOWER_MM,
    MESH_FROM_LOCAL,
    MICROSCOPE,
    UPPER_MM,
    SampleSurface,
    frame_pose,
    held_out_poses,
    sample_surface,
)
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import camera_centre, inverse_rigid, transform_points
from tests.volume.solids import enclosed_mm3, is_closed


@pytest.fixture(scope="module")
def sample() -> SampleSurface:
    return sample_surface()


def crossings(mesh: TriangleMesh, pose: np.ndarray, pixels: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of the ray of each pixel: depths along the axis, ascending, and whether each crossing is of a front side."""
    rays = MICROSCOPE.rays_cam(pixels) @ pose[:3, :3]
    shape = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    centres = np.broadcast_to(camera_centre(pose), rays.shape)
    points, ray, face = shape.ray.intersects_location(centres, rays, multiple_hits=True)
    depth, front = transform_points(pose, points)[:, 2], (mesh.face_normals[face] * rays[ray]).sum(axis=1) < 0
    orders = [np.flatnonzero(ray == number)[np.argsort(depth[ray == number])] for number in range(len(pixels))]
    return [(depth[order], front[order]) for order in orders]


def test_bone_is_one_open_sheet_far_from_the_origin(sample):
    assert np.linalg.norm(sample.bone.vertices.mean(axis=0)) > 500
    assert all(((weight >= 0) & (weight <= 1)).all() for weight in sample.tissue.values())
    edges = sample.bone.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    count = len(sample.bone.vertices)
    parts, _ = connected_components(coo_array((np.ones(len(edges)), edges.T), (count, count)))
    assert parts == 1
    forward, backward = edges @ [count, 1], edges @ [1, count]
    assert len(np.unique(forward)) == len(forward), "two faces run along an edge in the same direction"
    rim = edges[~np.isin(forward, backward)].ravel()
    local = transform_points(inverse_rigid(MESH_FROM_LOCAL), sample.bone.vertices)
    to_side = np.minimum(local - LOWER_MM, UPPER_MM - local)[:, :2].min(axis=1)
    assert len(rim) > 0
    assert to_side[rim].max() < 1e-3, "the sheet has a hole within"
    in_side = (to_side[sample.bone.faces] < 1e-3).all(axis=1)
    # a few corners of triangles end there; a closed side would have hundreds of square millimetres
    assert np.linalg.norm(sample.bone.face_cross[in_side], axis=1).sum() < 1, "a side of the box is closed"


def test_rays_cross_fronts_and_backs_alternately_in_layers(sample):
    rng = np.random.default_rng(3)
    met = crossings(sample.bone, frame_pose(), rng.uniform([330, 150], [800, 560], (300, 2)))
    counts = np.array([len(depth) for depth, _ in met])
    assert counts.min() >= 1
    for _, front in met:
        # the first surface that a ray meets faces the camera, the next is its way out of bone
        np.testing.assert_array_equal(front, np.arange(len(front)) % 2 == 0)
    # in and around the cavity: walls that hide others
    assert 0.1 < (counts >= 2).mean() < 0.6


def test_photographs_are_filled_with_bone_from_other_directions(sample):
    u, v = MICROSCOPE.width - 1, MICROSCOPE.height - 1
    border = np.array([[0, 0], [u, 0], [0, v], [u, v], [u / 2, 0], [u / 2, v], [0, v / 2], [u, v / 2]])
    for pose in (frame_pose(), *held_out_poses()):
        assert all(len(depth) for depth, _ in crossings(sample.bone, pose, border.astype(float)))
    tilts = [np.degrees(np.arccos(pose[2, :3] @ frame_pose()[2, :3])) for pose in held_out_poses()]
    assert 12 <= min(tilts) <= max(tilts) <= 20


def test_structures_are_closed_and_partly_beneath_bone(sample):
    assert set(sample.structures) == {"facial_nerve", "chorda_tympani", "ossicles"}
    hidden = {}
    for name, mesh in sample.structures.items():
        assert is_closed(mesh)
        assert enclosed_mm3(mesh) > 1
        points_cam = transform_points(frame_pose(), mesh.vertices[:: len(mesh.vertices) // 80])
        met = crossings(sample.bone, frame_pose(), MICROSCOPE.project(points_cam))
        nearest = np.array([depth[:1].sum() for depth, _ in met])
        hidden[name] = (nearest < points_cam[:, 2] - 0.05).mean()
    assert hidden["facial_nerve"] > 0.9
    assert hidden["chorda_tympani"] > 0.9
    assert 0.3 < hidden["ossicles"] < 0.95


def test_same_rng_same_surface_and_other_rng_another():
    one, same, other = (sample_surface(rng, spacing_mm=2.5) for rng in (None, None, np.random.default_rng(1)))
    for once, again in zip((one.bone, *one.structures.values()), (same.bone, *same.structures.values()), strict=True):
        np.testing.assert_array_equal(once.vertices, again.vertices)
        np.testing.assert_array_equal(once.faces, again.faces)
    assert not np.array_equal(one.bone.vertices, other.bone.vertices)
