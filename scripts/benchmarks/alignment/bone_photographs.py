"""Temporal bones from CT as cases, with path-traced photographs: their shape is real, paint and light are not."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from oneframe.blender.bridge.camera import new_camera, place_camera
from oneframe.blender.bridge.data_blocks import new_mesh_object, set_vertex_colors, temporary_data
from oneframe.blender.bridge.versions import new_node_material
from oneframe.blender.sample.photograph import add_ambient_light, set_path_tracing
from oneframe.case.case_file import Case
from oneframe.files.content import write_bytes_atomically
from oneframe.files.temporary import temporary_folder
from oneframe.images.image_reader import read_image
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.poses.distributions import ReferencePose
from oneframe.sample.temporal_bone import MICROSCOPE
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.transforms import camera_centre, rigid

from ..published import CaseFiles, written_case

BONES = {"LT143": 1.0, "RT143": -1.0}
"""A specimen, and the sign of its lateral side along x, which points to the patient's left."""
CAMERA, DISTANCE_MM = MICROSCOPE.resized(640, 480), 300.0
TILTS_DEG, ROLLS_DEG = (0.0, 12.0, 16.0, 20.0, 25.0), (0.0, 8.0, -10.0, 15.0, -6.0)
WAVES_MM, WAVES = (0.8, 12.0), 200
"""Shortest and longest waves of the paint, and their number."""
SUN_STRENGTH, SKY_STRENGTH, SKY_COLOR = 5.0, 0.35, (0.8, 0.9, 1.0)
SUN_ANGLE_DEG = 2.0
"""Width of the sun, which shines from the lens: its shadows have a soft edge."""
SAMPLES = 4
"""Paths per pixel before denoising."""


def bone_cases(folder: Path, out: Path, *, most: int | None = None) -> list[CaseFiles]:
    """Write a case for each bone, seen from lateral; the others of its photographs tilt to all sides.

    ``folder`` holds ``ply/SPECIMEN/bone.ply``; ``most`` is the largest number of photographs besides the frame.

    Raises
    ------
    InputError
        A file is missing or holds something else.
    """
    written = []
    for name, side in BONES.items():
        path, rng = folder / "ply" / name / "bone.ply", np.random.default_rng(0)
        mesh = read_mesh(path)[0]
        centre = mesh.bounds.mean(axis=0)
        bone = mesh.moved(-centre)
        forward, down = np.array([-side, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
        lateral = rigid(np.stack([np.cross(down, forward), down, forward]), np.array([0.0, 0.0, DISTANCE_MM]))
        lengths = np.geomspace(*WAVES_MM, WAVES)
        waves = rng.normal(size=(WAVES, 3)) * (2 * np.pi / np.sqrt(3) / lengths)[:, None]
        paint = np.tanh(np.cos(bone.vertices @ waves.T + rng.uniform(0, 2 * np.pi, WAVES)).sum(axis=1) / np.sqrt(WAVES))
        albedo = np.array([0.5, 0.4, 0.3]) * (0.65 + 0.3 * paint[:, None])
        turns = 2 * np.pi * np.arange(len(TILTS_DEG)) / len(TILTS_DEG)
        reference = ReferencePose(lateral, np.zeros(3))
        poses = [
            reference.orbit((tilt * np.cos(turn), tilt * np.sin(turn)), roll, DISTANCE_MM)
            for tilt, roll, turn in zip(np.radians(TILTS_DEG), np.radians(ROLLS_DEG), turns, strict=True)
        ][: None if most is None else most + 1]
        photographs = []
        out.mkdir(parents=True, exist_ok=True)
        for number, image in enumerate(sunlit_photographs(bone, albedo, poses)):
            file = out / f"{name}_{number}.png"
            write_bytes_atomically(file, encode_png(to_uint8(image)))
            photographs.append((file, poses[number] @ rigid(translation=-centre)))
        case = Case(out / f"{name}.toml", 1.0, photographs[0][0], CAMERA, None, path, photographs[0][1])
        written.append(written_case(case, photographs[1:]))
    return written


def sunlit_photographs(mesh: TriangleMesh, albedo: np.ndarray, poses: Sequence[np.ndarray]) -> Iterator[np.ndarray]:
    """``(H, W, 3)`` float32 sRGB 0..1 at each pose: sun from the lens, sky, cast shadows and one bounce of light.

    ``albedo`` is ``(V, 3)`` linear RGB.
    """
    with temporary_data(), temporary_folder() as folder:
        scene = bpy.data.scenes.new("bone")
        set_path_tracing(scene, SAMPLES, depth="16")
        add_ambient_light(scene, SKY_COLOR, SKY_STRENGTH)
        scene.collection.objects.link(_painted(mesh, albedo))
        sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        sun.data.energy, sun.data.angle = SUN_STRENGTH, np.radians(SUN_ANGLE_DEG)
        scene.collection.objects.link(sun)
        camera_object = new_camera(scene, CAMERA, clip_mm=(10.0, 2000.0))
        for number, pose in enumerate(poses):
            place_camera(camera_object, pose)
            sun.matrix_world = Matrix(_towards(camera_centre(pose) / DISTANCE_MM))
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


def _painted(mesh: TriangleMesh, albedo: np.ndarray) -> bpy.types.Object:
    surface = new_mesh_object("bone", mesh)
    surface.data.shade_smooth()
    set_vertex_colors(surface, "albedo", np.column_stack([albedo, np.ones(len(albedo))]))
    material = new_node_material("paint")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    colour, shader = nodes.new("ShaderNodeAttribute"), nodes.new("ShaderNodeBsdfDiffuse")
    output = nodes.new("ShaderNodeOutputMaterial")
    colour.attribute_name = "albedo"
    links.new(colour.outputs["Color"], shader.inputs["Color"])
    links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    surface.data.materials.append(material)
    return surface
