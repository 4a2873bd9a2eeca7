"""Photographs of a relief under a low sun, path traced by Cycles: what they show owes nothing to the refinement."""

from collections.abc import Iterator, Sequence

import bpy
import numpy as np
from mathutils import Matrix

from oneframe.blender.bridge.camera import new_camera, place_camera
from oneframe.blender.bridge.data_blocks import new_mesh_object, set_vertex_colors, temporary_data
from oneframe.blender.bridge.versions import new_node_material
from oneframe.blender.sample.photograph import add_ambient_light, set_path_tracing
from oneframe.camera.pinhole import PinholeCamera
from oneframe.files.temporary import temporary_folder
from oneframe.images.image_reader import read_image

from .refinement_scenes import RefinementScene, visible_points
from .side_lit_relief import CAMERA, Relief, SideLitShot, relief, side_lit_shots

SUN_STRENGTH, SKY_STRENGTH = 5.0, 0.35
SKY_COLOR = (0.8, 0.9, 1.0)
SUN_ANGLE_DEG = 2.0
"""Width of the sun: its shadows have a soft edge."""
SAMPLES = 4
LARGEST_PX = 5.0
"""Error of a refined pose that counts as right, as for LM-O and bloster: the scan lacks what is finer than 1 mm."""


def side_lit_scenes(
    rng: np.random.Generator, count: int, *, camera: PinholeCamera = CAMERA, samples: int = SAMPLES
) -> Iterator[RefinementScene]:
    """Scenes of one relief, each from another side and under another sun, with their true poses."""
    surface, shots = relief(rng), side_lit_shots(rng, count)
    valid, known = np.ones(camera.shape_hw, bool), surface.known_mesh
    for shot, image in zip(shots, side_lit_photographs(surface, camera, shots, samples=samples), strict=True):
        pose = shot.cam_from_model
        points = visible_points(known, camera, pose)
        yield RefinementScene(shot.name, image, valid, camera, known, None, pose, points, LARGEST_PX, None)


def side_lit_photographs(
    relief: Relief, camera: PinholeCamera, shots: Sequence[SideLitShot], *, samples: int = SAMPLES
) -> Iterator[np.ndarray]:
    """Photograph a relief; sun, sky, cast shadows and one bounce of light.

    Parameters
    ----------
    relief
        The photographs show its fine mesh.
    camera
        Intrinsics of all photographs.
    shots
        Poses and suns.
    samples
        Paths per pixel before denoising.

    Yields
    ------
    ``(H, W, 3)`` float32 sRGB 0..1, one per shot.
    """
    with temporary_data(), temporary_folder() as folder:
        scene = bpy.data.scenes.new("side light")
        set_path_tracing(scene, samples, depth="16")
        add_ambient_light(scene, SKY_COLOR, SKY_STRENGTH)
        scene.collection.objects.link(_surface(relief))
        sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        sun.data.energy, sun.data.angle = SUN_STRENGTH, np.radians(SUN_ANGLE_DEG)
        scene.collection.objects.link(sun)
        camera_object = new_camera(scene, camera, clip_mm=(10.0, 2000.0))
        for number, shot in enumerate(shots):
            place_camera(camera_object, shot.cam_from_model)
            sun.matrix_world = Matrix(_towards(shot.towards_light))
            bpy.ops.render.render(scene=scene.name)
            path = folder / f"{number}.png"
            bpy.data.images["Render Result"].save_render(str(path), scene=scene)
            yield read_image(path)[0]


def _towards(direction: np.ndarray) -> np.ndarray:
    """``(4, 4)`` of an object whose +z axis has this direction: a sun shines along its own -z."""
    x = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(direction, x), direction], axis=1)
    return matrix


def _surface(relief: Relief) -> bpy.types.Object:
    surface = new_mesh_object("relief", relief.mesh)
    surface.data.shade_smooth()
    set_vertex_colors(surface, "albedo", np.column_stack([relief.albedo, np.ones(len(relief.albedo))]))
    material = new_node_material("stone")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    colour, shader = nodes.new("ShaderNodeAttribute"), nodes.new("ShaderNodeBsdfDiffuse")
    output = nodes.new("ShaderNodeOutputMaterial")
    colour.attribute_name = "albedo"
    links.new(colour.outputs["Color"], shader.inputs["Color"])
    links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    surface.data.materials.append(material)
    return surface
