"""The picture of an alignment."""

import numpy as np

from oneframe.alignment.align_case import AlignedCase
from oneframe.camera.pinhole import PinholeCamera
from oneframe.transforms import transform_points

CAMERA = PinholeCamera(128, 96, 500.0, 498.0, 64.5, 47.0)


def test_it_draws_the_edges_inside_the_surface(stepped_mesh, oblique_pose, loaded_case):
    """A plate that hovers over another one: its border is drawn, and the plates are not."""
    grey = np.full((*CAMERA.shape_hw, 3), 0.5, np.float32)
    loaded = loaded_case(stepped_mesh, grey, oblique_pose, CAMERA)
    drawn = np.abs(AlignedCase(loaded, None, None, ()).picture() - grey).max(axis=2)
    corners = stepped_mesh.vertices[61 * 51 :].reshape(51, 61, 3)[[0, 0, -1, -1], [0, -1, -1, 0]]
    along = np.linspace(0, 1, 20, endpoint=False)[:, None, None]
    border = (1 - along) * corners + along * np.roll(corners, -1, axis=0)
    x, y = np.rint(CAMERA.project(transform_points(oblique_pose, border.reshape(-1, 3)))).astype(int).T
    assert (drawn[y, x] > 0.1).mean() > 0.95
    inside = transform_points(oblique_pose, 0.6 * border.reshape(-1, 3) + 0.4 * corners.mean(axis=0))
    x, y = np.rint(CAMERA.project(inside)).astype(int).T
    assert drawn[y, x].max() < 0.05
