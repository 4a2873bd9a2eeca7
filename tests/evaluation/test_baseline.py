"""PyVista is a fair peer: it renders the same views."""

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.evaluation.baseline import pyvista_renderer
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.transforms import rigid, rotation_from_vector


@pytest.mark.gl
def test_pyvista_renders_the_same_view(bumpy_mesh, frontal_pose):
    """Of a surface that ends within the image: with the same K, but square pixels, it covers the same pixels."""
    pytest.importorskip("pyvista")
    camera = PinholeCamera(640, 480, 3190.0, 3190.0, 322.5, 236.0)
    pose = rigid(translation=np.array([3.0, -2.0, 250.0])) @ frontal_pose
    pose = pose @ rigid(rotation_from_vector(np.array([0.2, -0.3, 0.4])))
    white = np.full((len(bumpy_mesh.vertices), 3), 255, np.uint8)
    render = pyvista_renderer(bumpy_mesh, white, camera, samples=1, lit=False, depth_range_mm=(300.0, 800.0))
    covered = render(pose)[..., 0] > 127
    expected = rasterise_depth(bumpy_mesh, camera, pose).face >= 0
    assert 0.1 < expected.mean() < 0.9
    outline = np.count_nonzero(expected[:, 1:] != expected[:, :-1]) + np.count_nonzero(expected[1:] != expected[:-1])
    # a tenth of a pixel along the outline
    assert np.count_nonzero(covered != expected) < 0.1 * outline
