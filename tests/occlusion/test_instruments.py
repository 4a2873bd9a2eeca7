"""Instruments are closed solids of plausible sizes, and a view with them shows what rays meet first."""

from dataclasses import replace

import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.lens_shading import LensShading
from oneframe.images.pixel_values import linear_from_codes
from oneframe.images.transfer import TRANSFERS
from oneframe.light.lens_light import LensLight
from oneframe.occlusion.compositing import Front, head_light
from oneframe.occlusion.instruments import KINDS
from oneframe.occlusion.occluders import Occluders
from oneframe.projection.rendered_view import RenderedView
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.surface.mesh import TriangleMesh, distinct_points
from oneframe.transforms import rigid, rotation_from_vector, transform_points
from tests.codes import codes_from_linear
from tests.conftest import joined

CAMERA = PinholeCamera(97, 71, fx=460.0, fy=440.0, cx=51.3, cy=33.8)
WIDEST_MM = {"burr": 11, "suction": 4, "hook": 3.2, "blade": 12, "finger": 19}
SEEDS = range(4)


@pytest.mark.parametrize("make", KINDS, ids=lambda make: make.__name__)
def test_an_instrument_is_closed_and_of_plausible_size(make):
    for seed in SEEDS:
        parts = make(np.random.default_rng(seed)).parts(120.0)
        for mesh, _ in parts:
            _, corner = distinct_points(mesh.vertices)
            edges = corner[mesh.faces[:, [0, 1, 1, 2, 2, 0]]].reshape(-1, 2)
            forward, back = ({tuple(edge) for edge in each.tolist()} for each in (edges, edges[:, ::-1]))
            # every side of a face is that of one other, the other way round
            assert forward == back
            assert len(forward) == len(edges)
            assert mesh.plane_offsets.sum() > 0, "the faces show their backs"
        vertices = np.concatenate([mesh.vertices for mesh, _ in parts])
        assert np.linalg.norm(vertices, axis=1).min() < 2
        assert np.ptp(vertices[:, 1]) <= WIDEST_MM[make.__name__]
        assert vertices[:, 2].max() == pytest.approx(120, abs=3)
        assert vertices[:, 2].min() > -9


def posed(seed: int) -> Occluders:
    """An instrument of each kind, half in the surface."""
    rng, parts = np.random.default_rng(seed), []
    for make in KINDS:
        turn = rotation_from_vector(np.array([0, rng.uniform(0.3, 1.2), 0]))
        pose = rigid(rotation_from_vector(np.array([0, 0, rng.uniform(0, 6)])) @ turn, [*rng.uniform(-15, 15, 2), 0.0])
        parts += [
            (TriangleMesh(transform_points(pose, mesh.vertices), mesh.faces), finish)
            for mesh, finish in make(rng).parts(60.0)
        ]
    return Occluders.of(parts)


@pytest.mark.parametrize("seed", SEEDS[:3])
def test_a_view_shows_what_rays_meet_first(bumpy_mesh, oblique_pose, ray_cast, seed):
    """Of surface and instruments as one mesh."""
    occluders = posed(seed)
    together = joined(bumpy_mesh, occluders.mesh)
    z, face = ray_cast(together, CAMERA, oblique_pose, CAMERA.pixel_grid().reshape(-1, 2))
    z, face = z.reshape(CAMERA.shape_hw), face.reshape(CAMERA.shape_hw)
    whole = rasterise_depth(bumpy_mesh, CAMERA, oblique_pose).depth_mm.astype(np.float32)
    plain = RenderedView(
        np.full((*whole.shape, 3), 0.5, np.float32) * (whole > 0)[..., None],
        whole,
        (whole > 0).astype(np.uint8),
        np.zeros(whole.shape, bool),
    )
    for samples in (1, 4):
        view = Front(CAMERA, head_light(np.zeros(3)), samples).composed(plain, occluders, oblique_pose)
        assert (view.occluder == (face >= len(bumpy_mesh.faces))).all()
        assert view.occluder.sum() > 200
        assert (view.mask == (whole > 0)).all()
        assert (view.visible == ((face >= 0) & (face < len(bumpy_mesh.faces)))).all()
        np.testing.assert_allclose(view.seen_mm, z, atol=1e-3)
        assert (view.observed == view.visible).all()
        assert not view.rgb[face < 0].any()
        assert view.rgb.min() >= 0
        assert view.rgb.max() <= 1
        untouched = (view.rgb == plain.rgb).all(axis=2) & view.visible
        if samples == 1:
            assert untouched.sum() == view.visible.sum()
            hard = view.rgb
        else:
            # edges are mixed, all else is as with one ray
            mixed = (view.rgb != hard).any(axis=2)
            assert 0 < mixed.sum() < 0.5 * view.occluder.sum() + 400
            assert untouched.sum() > 0.7 * view.visible.sum()


def test_light_on_an_instrument_is_the_same_in_all_code_values(oblique_pose):
    """Of the same linear colour, without shine."""
    occluders, nothing = posed(0), np.zeros(CAMERA.shape_hw, np.float32)
    plain = RenderedView(np.zeros((*nothing.shape, 3), np.float32), nothing, nothing.astype(np.uint8), nothing > 0)
    colour, seen = linear_from_codes(occluders.rgb), []
    for transfer, curve in TRANSFERS.items():
        rgb = codes_from_linear(colour, curve).astype(np.float32)
        matt = replace(occluders, rgb=rgb, shine=np.zeros_like(occluders.shine))
        light = LensShading(LensLight((-13.0, 16.0, 2.0), 0.1, transfer=transfer), 0.02)
        view = Front(CAMERA, light).composed(plain, matt, oblique_pose)
        # code values end at 1
        seen.append(linear_from_codes(view.rgb[view.occluder & (view.rgb < 0.99).all(axis=2)], curve))
    assert len(seen[0]) > 200
    np.testing.assert_allclose(seen[1], seen[0], atol=2e-4)
    np.testing.assert_allclose(seen[2], seen[0], atol=2e-4)
