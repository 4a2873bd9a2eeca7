"""Contours and structures of a scene, against analytic outlines, the exact silhouette and the z-buffer."""

import numpy as np
import trimesh

from oneframe.camera.pinhole import PinholeCamera, whereabouts
from oneframe.images.layer_stack import LayerStack
from oneframe.images.overlay import SMOOTHING_PX, outline_segments
from oneframe.projection.overlay_scene import OverlayScene, structure_layer, visible_contours
from oneframe.projection.silhouette import SilhouetteEdges
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.sample.distance_field import tube
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import rigid
from tests.conftest import joined

CAMERA = PinholeCamera(401, 301, fx=1210.0, fy=1190.0, cx=195.3, cy=148.8)


def sphere(centre: tuple[float, float, float], radius: float) -> TriangleMesh:
    """20,000 faces, fronts outside."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return TriangleMesh(np.array(centre) + ball.vertices, ball.faces.astype(np.int32))


def depth_of(mesh: TriangleMesh, pose: np.ndarray) -> np.ndarray:
    inverse = rasterise_depth(mesh, CAMERA, pose).inverse_depth
    return np.divide(1, inverse, out=np.zeros_like(inverse), where=inverse > 0)


def test_the_contour_of_a_sphere_is_its_outline():
    """Of two spheres, the nearer one's outline is a step before the farther one, which hides nothing of it."""
    near, far = sphere((0, 0, 250), 10), sphere((12, 3, 400), 30)
    mesh, pose = joined(near, far), np.eye(4)
    ending, steps = visible_contours(SilhouetteEdges.of(mesh), CAMERA, pose, depth_of(mesh, pose))
    for segments, centre, radius in ((steps, (0, 0, 250), 10.0), (ending, (12, 3, 400), 30.0)):
        # rays that touch a sphere make this angle with the ray to its centre
        expected = np.arcsin(radius / np.linalg.norm(centre))
        rays = CAMERA.rays_cam(segments.mean(axis=1))
        cosine = rays @ np.array(centre, float) / np.linalg.norm(rays, axis=1) / np.linalg.norm(centre)
        off_px = (np.arccos(cosine) - expected) * CAMERA.fx
        on_it = np.abs(off_px) < 1
        if radius == 10:
            assert on_it.all()
        else:
            # what is left is the nearer sphere's where it stands out
            assert on_it.mean() > 0.9
        length = np.hypot(*(segments[on_it, 1] - segments[on_it, 0]).T).sum()
        assert length > 0.9 * 2 * np.pi * np.tan(expected) * CAMERA.fx * (1 if radius == 30 else 0.8)


def test_hidden_edges_are_no_contour():
    near, far = sphere((0, 0, 250), 30), sphere((0, 0, 400), 10)
    mesh = joined(near, far)
    ending, steps = visible_contours(SilhouetteEdges.of(mesh), CAMERA, np.eye(4), depth_of(mesh, np.eye(4)))
    assert len(ending) > 0
    assert len(steps) == 0


def test_the_outline_of_a_visible_structure_is_its_silhouette(frontal_pose):
    """Within a pixel, both ways, of the pixels that it covers alone."""
    nerve = tube(np.array([[-20.0, -6, 4], [-5, 8, 6], [8, -4, 5], [22, 6, 4]]), 1.5)
    scene = OverlayScene.of(sphere((0, 0, -60), 40), [(nerve, (1.0, 0.0, 1.0))])
    surface, layers = scene.surface_layer(CAMERA, frontal_pose), scene.layers(CAMERA, frontal_pose)
    visible, dashes = outline_segments(LayerStack.of(surface, layers), 0, on_px=9, off_px=6, sigma_px=SMOOTHING_PX)
    assert len(dashes) == 0
    mask = depth_of(nerve, frontal_pose) > 0
    padded = np.pad(mask, 1)
    sides = [
        np.argwhere(mask & ~padded[1 + down : 302 + down, 1 + right : 402 + right])[:, ::-1]
        + 0.5 * np.array([right, down])
        for right, down in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    border, points = np.concatenate(sides), visible.mean(axis=1)
    distance = np.sqrt(((points[:, None] - border[None]) ** 2).sum(axis=2))
    assert distance.min(axis=1).max() < 1
    assert distance.min(axis=0).max() < 1.5


def test_structures_outside_have_no_layer_but_a_place(frontal_pose):
    mesh = sphere((0, 0, 0), 5)
    for offset, place in (
        ((-200, 0, 0), "left of the frame"), ((200, 0, 0), "right of the frame"), ((0, -200, 0), "above the frame"),
        ((190, 190, 0), "right of the frame and below it"), ((0, 0, -900), "behind the camera"), ((0, 0, 0), None),
    ):  # fmt: skip
        pose = rigid(translation=np.array(offset, float)) @ frontal_pose
        layer = structure_layer(mesh, (1.0, 1.0, 1.0), CAMERA, pose)
        assert (layer.depth_mm.size == 0) == (place is not None)
        assert whereabouts(mesh.vertices, CAMERA, pose) == place
