"""The built-in sample surface: an open sheet with fronts towards the air, and overhangs like those of drilled bone."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from oneframe.camera.pinhole import PinholeCamera
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
from oneframe.transforms import inverse_rigid, transform_points
from tests.volume.solids import enclosed_mm3, is_closed


@pytest.fixture(scope="module")
def sample() -> SampleSurface:
    return sample_surface()


class Layers:
    """All crossings of viewing rays with a mesh, by brute force in the image plane."""

    def __init__(self, mesh: TriangleMesh, camera: PinholeCamera, cam_from_mesh: np.ndarray):
        points_cam = transform_points(cam_from_mesh, mesh.vertices)
        corners = camera.project(points_cam)[mesh.faces]
        self.corners, self.inverse_z = corners, 1 / points_cam[:, 2][mesh.faces]
        self.low, self.high = corners.min(axis=1), corners.max(axis=1)
        (ux, uy), (vx, vy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        self.area = ux * vy - uy * vx

    def at(self, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depths along the axis, ascending, and whether each crossing is of a front side."""
        column = np.flatnonzero((self.low[:, 0] <= pixel[0]) & (pixel[0] <= self.high[:, 0]))
        maybe = column[(self.low[column, 1] <= pixel[1]) & (pixel[1] <= self.high[column, 1])]
        a, b, c = (self.corners[maybe, k] - pixel for k in range(3))
        weights = np.stack([p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))], axis=1)
        weights /= self.area[maybe, None]
        hit = (weights >= 0).all(axis=1)
        depth = 1 / (weights[hit] * self.inverse_z[maybe[hit]]).sum(axis=1)
        order = np.argsort(depth)
        # the image's y runs down, so what is counter-clockwise from the front has negative area
        return depth[order], self.area[maybe[hit]][order] < 0


@pytest.fixture(scope="module")
def layers(sample) -> Layers:
    return Layers(sample.bone, MICROSCOPE, frame_pose())


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


def test_rays_cross_fronts_and_backs_alternately_in_layers(layers):
    rng = np.random.default_rng(3)
    crossings = [layers.at(pixel) for pixel in rng.uniform([330, 150], [800, 560], (300, 2))]
    counts = np.array([len(depth) for depth, _ in crossings])
    assert counts.min() >= 1
    for _, front in crossings:
        # the first surface that a ray meets faces the camera, the next is its way out of bone
        np.testing.assert_array_equal(front, np.arange(len(front)) % 2 == 0)
    # in and around the cavity: walls that hide others
    assert 0.1 < (counts >= 2).mean() < 0.6


def test_photographs_are_filled_with_bone_from_other_directions(sample):
    u, v = MICROSCOPE.width - 1, MICROSCOPE.height - 1
    border = np.array([[0, 0], [u, 0], [0, v], [u, v], [u / 2, 0], [u / 2, v], [0, v / 2], [u, v / 2]])
    for pose in (frame_pose(), *held_out_poses()):
        seen = Layers(sample.bone, MICROSCOPE, pose)
        assert all(len(seen.at(pixel)[0]) for pixel in border)
    tilts = [np.degrees(np.arccos(pose[2, :3] @ frame_pose()[2, :3])) for pose in held_out_poses()]
    assert 12 <= min(tilts) <= max(tilts) <= 20


def test_structures_are_closed_and_partly_beneath_bone(sample, layers):
    assert set(sample.structures) == {"facial_nerve", "chorda_tympani", "ossicles"}
    hidden = {}
    for name, mesh in sample.structures.items():
        assert is_closed(mesh)
        assert enclosed_mm3(mesh) > 1
        points_cam = transform_points(frame_pose(), mesh.vertices[:: len(mesh.vertices) // 80])
        nearest = np.array([layers.at(pixel)[0][:1].sum() for pixel in MICROSCOPE.project(points_cam)])
        hidden[name] = (nearest < points_cam[:, 2] - 0.05).mean()
    assert hidden["facial_nerve"] > 0.9
    assert hidden["chorda_tympani"] > 0.9
    assert 0.3 < hidden["ossicles"] < 0.95


def test_ossicles_of_the_sheet_lie_inside_their_structure(sample):
    """So that the two never coincide and rounding never decides which one is in front."""
    ossicles = sample.structures["ossicles"]
    body = ossicles.bounds.mean(axis=0)
    near = sample.bone.vertices[np.linalg.norm(sample.bone.vertices - body, axis=1) < 6]
    distance, nearest = cKDTree(ossicles.vertices).query(near)
    offset = ((near - ossicles.vertices[nearest]) * ossicles.vertex_normals[nearest]).sum(axis=1)
    on_ossicles = (distance < 0.4) & (offset < 0)
    assert on_ossicles.sum() > 300
    assert -0.2 < np.median(offset[on_ossicles]) < -0.05


def test_same_rng_same_surface_and_other_rng_another():
    one, same, other = (sample_surface(rng, spacing_mm=2.5) for rng in (None, None, np.random.default_rng(1)))
    for once, again in zip((one.bone, *one.structures.values()), (same.bone, *same.structures.values()), strict=True):
        np.testing.assert_array_equal(once.vertices, again.vertices)
        np.testing.assert_array_equal(once.faces, again.faces)
    assert not np.array_equal(one.bone.vertices, other.bone.vertices)
