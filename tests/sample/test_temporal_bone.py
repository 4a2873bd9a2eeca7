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
from oneframe.transforms import camera_centre, inverse_rigid, transform_points


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


def test_size_and_frame(sample):
    assert 150_000 <= len(sample.bone.faces) <= 250_000
    assert 0.2 < sample.bone.median_edge < 0.4
    # far from the origin, like CT coordinates
    assert np.linalg.norm(sample.bone.vertices.mean(axis=0)) > 500
    for mesh in (sample.bone, *sample.structures.values()):
        assert mesh.vertices.dtype == np.float64
        assert mesh.faces.dtype == np.int32


def test_bone_is_one_component(sample):
    faces, count = sample.bone.faces, len(sample.bone.vertices)
    rows, columns = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    parts, _ = connected_components(coo_array((np.ones(len(rows)), (rows, columns)), (count, count)))
    assert parts == 1


def test_bone_is_an_open_sheet_wound_one_way(sample):
    edges = sample.bone.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    count = len(sample.bone.vertices)
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


def test_rays_cross_fronts_and_backs_alternately_and_often_more_than_one_layer(layers):
    rng = np.random.default_rng(3)
    crossings = [layers.at(pixel) for pixel in rng.uniform([330, 150], [800, 560], (300, 2))]
    counts = np.array([len(depth) for depth, _ in crossings])
    assert counts.min() >= 1
    for _, front in crossings:
        # the first surface that a ray meets faces the camera, the next is its way out of bone
        np.testing.assert_array_equal(front, np.arange(len(front)) % 2 == 0)
    # in and around the cavity: walls that hide others
    assert 0.1 < (counts >= 2).mean() < 0.6


def test_photographs_are_filled_with_bone(sample):
    u, v = MICROSCOPE.width - 1, MICROSCOPE.height - 1
    border = np.array([[0, 0], [u, 0], [0, v], [u, v], [u / 2, 0], [u / 2, v], [0, v / 2], [u, v / 2]])
    for pose in (frame_pose(), *held_out_poses()):
        seen = Layers(sample.bone, MICROSCOPE, pose)
        assert all(len(seen.at(pixel)[0]) for pixel in border)


def test_held_out_poses_lie_around_the_frame():
    frame = frame_pose()
    for pose in held_out_poses():
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
        tilt_deg = np.degrees(np.arccos(pose[2, :3] @ frame[2, :3]))
        assert 12 <= tilt_deg <= 20
        assert 40 < np.linalg.norm(camera_centre(pose) - camera_centre(frame)) < 120


def test_structures_are_closed_and_partly_beneath_bone(sample, layers):
    assert set(sample.structures) == {"facial_nerve", "chorda_tympani", "ossicles"}
    hidden = {}
    for name, mesh in sample.structures.items():
        edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        assert set(map(tuple, edges.tolist())) == set(map(tuple, edges[:, ::-1].tolist()))
        volume = np.einsum("ij,ij->", mesh.vertices[mesh.faces[:, 0]], mesh.face_cross) / 6
        assert volume > 1
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


def test_tissue_weights(sample):
    for weight in sample.tissue.values():
        assert weight.shape == (len(sample.bone.vertices),)
        assert weight.min() >= 0
        assert weight.max() <= 1
        assert 0.002 < (weight > 0.5).mean() < 0.6


def test_same_rng_same_surface_and_other_rng_another():
    coarse = [sample_surface(rng, spacing_mm=0.9) for rng in (None, None, np.random.default_rng(1))]
    for once, again in zip(
        (coarse[0].bone, *coarse[0].structures.values()), (coarse[1].bone, *coarse[1].structures.values()), strict=True
    ):
        np.testing.assert_array_equal(once.vertices, again.vertices)
        np.testing.assert_array_equal(once.faces, again.faces)
    assert not np.array_equal(coarse[0].bone.vertices, coarse[2].bone.vertices)
