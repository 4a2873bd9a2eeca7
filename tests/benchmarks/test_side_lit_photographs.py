"""Photographs of the relief under a low sun: Cycles casts the shadows where the shadow map has them."""

from dataclasses import replace

import numpy as np

from oneframe.alignment.refinement.cast_shadows import directional_light
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.transforms import transform_points
from scripts.benchmarks.alignment.side_lit_photographs import side_lit_photographs, side_lit_scenes
from scripts.benchmarks.alignment.side_lit_relief import CAMERA, relief, side_lit_shots

SMALL = CAMERA.resized(96, 72)


def test_shadows_are_dark_and_lie_where_the_sun_does_not_reach():
    surface, shots = relief(np.random.default_rng(0)), side_lit_shots(np.random.default_rng(1), 2)
    mesh = surface.mesh
    for shot, image in zip(shots, side_lit_photographs(surface, SMALL, shots, samples=8), strict=True):
        assert image.shape == (72, 96, 3)
        raster = rasterise_depth(mesh, SMALL, shot.cam_from_model)
        assert (raster.face >= 0).all()
        lit = directional_light(mesh, shot.towards_light).lit[raster.face]
        facing = (mesh.face_normals @ shot.towards_light)[raster.face]
        luminance = image.mean(axis=2)
        dark, bright = luminance[(lit == 0) & (facing > 0.3)], luminance[(lit == 1) & (facing > 0.3)]
        assert min(len(dark), len(bright)) > 300
        threshold = 0.5 * (np.median(dark) + np.median(bright))
        assert np.median(bright) > 1.5 * np.median(dark)
        assert (dark < threshold).mean() > 0.9
        assert (bright > threshold).mean() > 0.9


def test_a_scene_is_of_the_scan_in_the_frame_of_the_photographed_surface():
    (scene,) = side_lit_scenes(np.random.default_rng(0), 1, camera=SMALL, samples=1)
    fine = relief(np.random.default_rng(0)).mesh
    assert len(scene.mesh.vertices) < len(fine.vertices) / 3
    rasters = [rasterise_depth(mesh, SMALL, scene.cam_from_model) for mesh in (scene.mesh, fine)]
    depths = [1 / raster.inverse_depth for raster in rasters]
    assert np.median(np.abs(depths[0] - depths[1])) < 0.5
    assert np.abs(np.mean(depths[0] - depths[1])) < 0.2
    assert (transform_points(scene.cam_from_model, scene.points)[:, 2] > 0).all()
    assert scene.camera == replace(SMALL)
