"""Make the picture from CT to surface: a slice with what was drilled, the surface, and the cavity with its structures.

python scripts/dev/make_ct_picture.py CT --drill PLAN.toml [--labels LABELS] --from X Y Z --out PICTURE.jpg
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

import argparse
import tempfile
from collections.abc import Mapping, Sequence

import bpy
import numpy as np
from mathutils import Matrix
from PIL import Image

from oneframe.errors import InputError, RunError
from oneframe.files.outputs import check_outputs
from oneframe.images.pixel_values import to_uint8
from oneframe.images.slice_picture import slice_picture
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.structure_colour import OTHER, structure_colour
from oneframe.volume.bone.bone import bone_voxels
from oneframe.volume.bone.bone_surface import bone_surface, removed_ball
from oneframe.volume.bone.structures import structure_meshes, structure_names, without_bone
from oneframe.volume.bone.threshold import DEFAULT_HU
from oneframe.volume.drill.drill_plan import read_drill_plan
from oneframe.volume.make_surface import finish_of, removed_of
from oneframe.volume.reading.label_map import read_labels
from oneframe.volume.reading.volume_reader import read_volume
from oneframe.volume.slices.slice_views import LabelColours, slice_views

QUALITY = {"quality": 86, "optimize": True, "subsampling": 0}
SIDE_PX, GAP_PX = 480, 6
SAMPLES = 64
BONE = (0.92, 0.87, 0.77)
DISTANCE_MM = 400.0
SHARP = np.radians(35)


def parse_arguments(argv: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make_ct_picture.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("volume", metavar="CT", type=Path)
    parser.add_argument("--drill", metavar="PLAN.toml", type=Path, required=True)
    parser.add_argument("--labels", metavar="LABELS", type=Path)
    parser.add_argument(
        "--from", metavar=("X", "Y", "Z"), nargs=3, type=float, dest="eye", required=True,
        help="direction from the cavity to the eye, LPS",
    )  # fmt: skip
    parser.add_argument("--width", metavar="MM", nargs=2, type=float, default=(70.0, 36.0), help="of the two views")
    parser.add_argument("--out", metavar="PICTURE.jpg", type=Path, required=True)
    return parser.parse_args(argv)


def main(argv: Sequence[str]) -> int:
    """Make the picture; returns the exit code."""
    arguments = parse_arguments(argv)
    try:
        inputs = {"volume": arguments.volume, "drill": arguments.drill}
        check_outputs([arguments.out], inputs)
        panels = made_panels(arguments)
    except (InputError, RunError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    picture = Image.new("RGB", (3 * SIDE_PX + 2 * GAP_PX, SIDE_PX), "white")
    for number, panel in enumerate(panels):
        picture.paste(panel, (number * (SIDE_PX + GAP_PX), 0))
    partial = arguments.out.with_suffix(".part")
    picture.save(partial, "JPEG", **QUALITY)
    partial.replace(arguments.out)
    return 0


def made_panels(arguments: argparse.Namespace) -> list[Image.Image]:
    """The slice and the two views, square."""
    volume = read_volume(arguments.volume)
    labels = None
    if arguments.labels is not None:
        labels = without_bone(read_labels(arguments.labels, volume, resampled=False))
    structures = {} if labels is None else structure_meshes(labels)
    solid = bone_voxels(volume, DEFAULT_HU)
    removed = removed_of(read_drill_plan(arguments.drill), volume, structures)
    ball = None if removed is None else removed_ball(volume.grid, solid, removed)
    if removed is None or ball is None:
        raise InputError(f"{arguments.drill.name}: expected strokes that remove bone, found none")
    finish = finish_of(volume, solid, removed, structures)
    surface = bone_surface(volume, DEFAULT_HU, solid, removed, finish).surface.mesh

    coloured = {name: structure_colour(name) for name in structures if structure_colour(name) != OTHER}
    drawn = []
    if labels is not None:
        numbers = {label: coloured[name] for label, name in structure_names(labels).items() if name in coloured}
        drawn = [LabelColours(labels, numbers)]
    views = slice_views(volume, DEFAULT_HU, ball.centre, solid=solid, removed=removed, structures=drawn)
    axial = Image.fromarray(to_uint8(slice_picture(views[:1])))
    panels = [axial.resize((SIDE_PX, SIDE_PX), Image.Resampling.LANCZOS)]
    shown = {name: structures[name] for name in coloured}
    for width, meshes in zip(arguments.width, ({}, shown), strict=True):
        panels.append(rendered(surface, meshes, ball.centre, np.array(arguments.eye), width))
    return panels


def rendered(
    bone: TriangleMesh, structures: Mapping[str, TriangleMesh], target: np.ndarray, eye: np.ndarray, width_mm: float
) -> Image.Image:
    """A view from the direction ``eye`` (3,), head up, ``width_mm`` wide at ``target`` (3,), by Cycles."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bone_object = add_mesh(bone, target, BONE, 0.6)
    for name, mesh in structures.items():
        add_mesh(mesh, target, structure_colour(name), 0.4)
    scene = bpy.context.scene
    backward = eye / np.linalg.norm(eye)
    right = np.cross([0.0, 0.0, 1.0], backward)
    right /= np.linalg.norm(right)
    up = np.cross(backward, right)

    def placed(data: bpy.types.Camera | bpy.types.Light, at: np.ndarray) -> bpy.types.Object:
        thing = bpy.data.objects.new("", data)
        scene.collection.objects.link(thing)
        z = at / np.linalg.norm(at)
        x = np.cross(up, z)
        x /= np.linalg.norm(x)
        matrix = np.eye(4)
        matrix[:3] = np.stack([x, np.cross(z, x), z, at], axis=1)
        thing.matrix_world = Matrix(matrix.tolist())
        return thing

    camera = bpy.data.cameras.new("")
    camera.angle = 2 * np.arctan(width_mm / 2 / DISTANCE_MM)
    camera.clip_end = 10 * DISTANCE_MM
    scene.camera = placed(camera, backward * DISTANCE_MM)
    for aside, power in ((up - right, 1.5e6), (0 * up, 0.7e6)):
        lamp = bpy.data.lights.new("", "AREA")
        lamp.energy, lamp.size = power, 40
        placed(lamp, backward * DISTANCE_MM + aside * DISTANCE_MM / 2)
    scene.world = bpy.data.worlds.new("")
    scene.world.color = (0.12, 0.13, 0.15)
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = SAMPLES, True, 3
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x = scene.render.resolution_y = SIDE_PX
    picture = render()
    if structures:
        # what the bone hides shines through
        bone_object.hide_render = scene.render.film_transparent = True
        alone = render()
        picture.paste(alone, mask=alone.getchannel("A").point(lambda alpha: alpha // 2))
    return picture.convert("RGB")


def render() -> Image.Image:
    """The scene, RGBA."""
    scene = bpy.context.scene
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "view.png")
        bpy.ops.render.render(write_still=True)
        with Image.open(scene.render.filepath) as image:
            return image.convert("RGBA")


def add_mesh(
    mesh: TriangleMesh, origin: np.ndarray, colour: tuple[float, float, float], roughness: float
) -> bpy.types.Object:
    """Add a mesh of one colour, sRGB 0..1, to the scene, with ``origin`` in its middle."""
    data = bpy.data.meshes.new("")
    data.from_pydata(mesh.vertices - origin, [], mesh.faces)
    data.shade_smooth()
    data.set_sharp_from_angle(angle=SHARP)
    material = bpy.data.materials.new("")
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*(value**2.2 for value in colour), 1.0)
    shader.inputs["Roughness"].default_value = roughness
    data.materials.append(material)
    thing = bpy.data.objects.new("", data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
