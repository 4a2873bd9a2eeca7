import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.decimation import cluster_vertices
from oneframe.transforms import rigid

CAMERA = PinholeCamera(97, 71, fx=460.0, fy=440.0, cx=51.3, cy=33.8)


@pytest.mark.parametrize("surface", ["bumpy_mesh", "stepped_mesh"])
def test_agrees_with_a_ray_cast(surface, oblique_pose, ray_cast, request):
    mesh = request.getfixturevalue(surface)
    raster = rasterise_depth(mesh, CAMERA, oblique_pose)
    depth, face = ray_cast(mesh, CAMERA, oblique_pose, CAMERA.pixel_grid().reshape(-1, 2))
    same = raster.face.ravel() == face
    # centres on an edge belong to either neighbour: then the depth is the same
    found = np.divide(1, raster.inverse_depth.ravel(), out=np.zeros(len(depth)), where=raster.inverse_depth.ravel() > 0)
    np.testing.assert_allclose(found, depth, atol=1e-6)
    assert same.mean() > 0.995
    assert (face == -1).any() == (raster.face == -1).any()


def test_what_is_not_in_front_is_left_out(bumpy_mesh, frontal_pose):
    for pose in (rigid(translation=[0, 0, -400.0]), rigid(translation=[4000.0, 0, 0]) @ frontal_pose):
        raster = rasterise_depth(bumpy_mesh, CAMERA, pose)
        assert (raster.face == -1).all()
        assert (raster.inverse_depth == 0).all()


def test_clusters_keep_the_surface(bumpy_mesh, oblique_pose):
    reduced = cluster_vertices(bumpy_mesh, 1.5)
    assert len(reduced.faces) < len(bumpy_mesh.faces) / 3
    full, coarse = (rasterise_depth(mesh, CAMERA, oblique_pose) for mesh in (bumpy_mesh, reduced))
    both = (full.face >= 0) & (coarse.face >= 0)
    assert both.sum() > 0.97 * (full.face >= 0).sum()
    apart = 1 / full.inverse_depth[both] - 1 / coarse.inverse_depth[both]
    assert np.median(np.abs(apart)) < 0.3
