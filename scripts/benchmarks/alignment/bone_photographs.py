"""Temporal bones from CT as cases, with path-traced photographs: their shape is real, paint and light are not.

Intact in the light of a sun at the lens, or drilled in that of a lamp beside it, which a case knows or finds.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from oneframe.blender.bridge.camera import new_camera, place_camera
from oneframe.blender.bridge.data_blocks import new_mesh_object, set_vertex_colors, temporary_data
from oneframe.blender.bridge.versions import new_node_material
from oneframe.blender.render.surface_scene import LAMP_WATT_PER_MM2
from oneframe.blender.sample.photograph import add_ambient_light, set_path_tracing
from oneframe.case.case_file import Case
from oneframe.case.frame import UnreadFrame
from oneframe.case.loaded_case import load_case
from oneframe.files.temporary import temporary_folder
from oneframe.files.writing import write_bytes_atomically
from oneframe.images.image_reader import read_image
from oneframe.images.pixel_values import to_uint8
from oneframe.images.png import encode_png
from oneframe.light.find_lamp import find_lamp
from oneframe.light.lens_light import LensLight
from oneframe.poses.distributions import ReferencePose
from oneframe.sample.temporal_bone import MICROSCOPE
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_reader import read_mesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import camera_centre, rigid
from oneframe.volume.bone.bone import DEFAULT_HU, bone_voxels
from oneframe.volume.bone.structures import without_bone
from oneframe.volume.drill.drill_plan import DrillPlan, read_drill_plan
from oneframe.volume.make_surface import SurfaceSettings, make_surface
from oneframe.volume.reading.label_map import read_labels
from oneframe.volume.reading.volume_reader import read_volume
from oneframe.volume.volume import LabelMap, Volume

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
LAMPS = {
    "LT143": LensLight((18.0, -22.0, 0.0), 0.12),
    "RT143": LensLight((-25.0, 8.0, 0.0), 0.04),
}
"""Of the drilled bones, elsewhere than the sample's lamp."""
LAMP_STRENGTH, LAMP_RADIUS_MM = 1.2, 5.0
"""Radiance of a white surface that faces the lamp, and the lamp's size."""
NOISE_HU = 60.0
PLANS = Path(__file__).resolve().parents[3] / "docs" / "examples"
SAMPLES = 4
"""Paths per pixel before denoising."""


def bone_cases(folder: Path, out: Path, *, most: int | None = None) -> list[CaseFiles]:
    """Write a case for each bone, seen from lateral; the others of its photographs tilt to all sides.

    ``folder`` holds ``ply/SPECIMEN/bone.ply``; ``most`` is the largest number of photographs besides the frame.
    """
    written = []
    for name in BONES:
        path = folder / "ply" / name / "bone.ply"
        mesh = read_mesh(path)[0]
        photographs = _photographed(name, mesh, mesh.bounds.mean(axis=0), out, None, most)
        case = Case(out / f"{name}.toml", 1.0, photographs[0][0], CAMERA, None, path, photographs[0][1])
        written.append(written_case(case, photographs[1:]))
    return written


def lit_bone_cases(folder: Path, out: Path, *, most: int | None = None) -> list[CaseFiles]:
    """Write cases of the drilled bones in the light of a lamp beside the lens, which they know or find.

    The surface is the one that the photographs show, or that of a CT with voxels of twice the size, and with noise.
    The lamp is found from all photographs at their poses. Parameters and errors as for :func:`bone_cases`; ``folder``
    holds the CTs and their label maps.
    """
    written = []
    for name, lamp in LAMPS.items():
        volume, labels, plan = _planned(folder, name)
        shown, cavity = _drilled(volume, labels, plan), _cavity(plan)
        photographs = _photographed(name, shown, cavity, out, lamp, most)
        for kind, mesh in (("true", shown), ("ct", _drilled(_coarser(volume), labels, plan))):
            path = out / f"{name}_{kind}.ply"
            write_ply(path, mesh)
            case = Case(out / f"{name}_{kind}.toml", 1.0, photographs[0][0], CAMERA, None, path, photographs[0][1])
            listed = [UnreadFrame(image, CAMERA, None, pose) for image, pose in photographs]
            loaded = load_case(replace(case, frames=tuple(listed[1:])))
            found = find_lamp(loaded.surface.mesh, loaded.frames)
            print(f"{case.path.stem}: {found.figures}", file=sys.stderr)
            for origin, light in (("given", lamp), ("found", found.light)):
                lit = replace(case, path=case.path.with_stem(f"{name}_{kind}_{origin}"), light=light)
                written.append(written_case(lit, photographs[1:]))
    return written


def _planned(folder: Path, name: str) -> tuple[Volume, LabelMap, DrillPlan]:
    volume = read_volume(folder / f"{name}_pseudoct_semisynthetic.nii.gz")
    labels = without_bone(read_labels(folder / f"{name}_labels.nii.gz", volume))
    return volume, labels, read_drill_plan(PLANS / f"drill_{name.lower()}.toml")


def _cavity(plan: DrillPlan) -> np.ndarray:
    middle: np.ndarray = np.concatenate([stroke.points for stroke in plan.strokes]).mean(axis=0)
    return middle


def _drilled(volume: Volume, labels: LabelMap, plan: DrillPlan) -> TriangleMesh:
    solid = bone_voxels(volume, DEFAULT_HU)
    return make_surface(volume, DEFAULT_HU, solid, labels, SurfaceSettings(plan=plan)).bone.mesh


def _coarser(volume: Volume) -> Volume:
    """Every two voxels along each axis as one, with noise."""
    size = np.array(volume.grid.size) // 2
    x, y, z = 2 * size
    means = volume.values[:z, :y, :x].reshape(size[2], 2, size[1], 2, size[0], 2).mean(axis=(1, 3, 5))
    means += np.random.default_rng(0).normal(0, NOISE_HU, means.shape)
    mesh_from_index = volume.grid.mesh_from_index @ rigid(translation=np.full(3, 0.5)) @ np.diag([2.0, 2.0, 2.0, 1.0])
    grid = replace(volume.grid, size=tuple(size.tolist()), mesh_from_index=mesh_from_index)
    return replace(volume, values=np.rint(means).astype(np.int16), grid=grid)


def _photographed(
    name: str,
    mesh: TriangleMesh,
    centre: np.ndarray,
    out: Path,
    lamp: LensLight | None,
    most: int | None,
) -> list[tuple[Path, np.ndarray]]:
    """Photographs of a painted bone around a point, and their poses; the first is from lateral."""
    side, bone = BONES[name], mesh.moved(-centre)
    forward, down = np.array([-side, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
    lateral = rigid(np.stack([np.cross(down, forward), down, forward]), np.array([0.0, 0.0, DISTANCE_MM]))
    turns = 2 * np.pi * np.arange(len(TILTS_DEG)) / len(TILTS_DEG)
    reference = ReferencePose(lateral, np.zeros(3))
    poses = [
        reference.orbit((tilt * np.cos(turn), tilt * np.sin(turn)), roll, DISTANCE_MM)
        for tilt, roll, turn in zip(np.radians(TILTS_DEG), np.radians(ROLLS_DEG), turns, strict=True)
    ][: None if most is None else most + 1]
    files = [out / f"{name}_{number}.png" for number in range(len(poses))]
    out.mkdir(parents=True, exist_ok=True)
    missing = [number for number, file in enumerate(files) if not file.is_file()]
    images = traced_photographs(bone, _paint(bone), [poses[number] for number in missing], lamp)
    for number, image in zip(missing, images, strict=True):
        write_bytes_atomically(files[number], encode_png(to_uint8(image)))
    return [(file, pose @ rigid(translation=-centre)) for file, pose in zip(files, poses, strict=True)]


def _paint(bone: TriangleMesh) -> np.ndarray:
    """``(V, 3)`` linear RGB of waves in all directions."""
    rng, lengths = np.random.default_rng(0), np.geomspace(*WAVES_MM, WAVES)
    waves = rng.normal(size=(WAVES, 3)) * (2 * np.pi / np.sqrt(3) / lengths)[:, None]
    paint = np.tanh(np.cos(bone.vertices @ waves.T + rng.uniform(0, 2 * np.pi, WAVES)).sum(axis=1) / np.sqrt(WAVES))
    albedo: np.ndarray = np.array([0.5, 0.4, 0.3]) * (0.65 + 0.3 * paint[:, None])
    return albedo


def traced_photographs(
    mesh: TriangleMesh,
    albedo: np.ndarray,
    poses: Sequence[np.ndarray],
    lamp: LensLight | None,
) -> Iterator[np.ndarray]:
    """``(H, W, 3)`` float32 sRGB 0..1 at each pose: sun or lamp, sky, cast shadows and one bounce of light.

    ``albedo`` is ``(V, 3)`` linear RGB; without a lamp the sun shines from the lens.
    """
    with temporary_data(), temporary_folder() as folder:
        scene = bpy.data.scenes.new("bone")
        set_path_tracing(scene, SAMPLES, depth="16")
        if lamp is None:
            add_ambient_light(scene, SKY_COLOR, SKY_STRENGTH)
        else:
            add_ambient_light(scene, (1.0, 1.0, 1.0), LAMP_STRENGTH * lamp.ambient)
        scene.collection.objects.link(_painted(mesh, albedo))
        source = bpy.data.objects.new("light", bpy.data.lights.new("light", "SUN" if lamp is None else "POINT"))
        if lamp is None:
            source.data.energy, source.data.angle = SUN_STRENGTH, np.radians(SUN_ANGLE_DEG)
        else:
            source.data.energy = LAMP_STRENGTH * LAMP_WATT_PER_MM2 * DISTANCE_MM**2
            source.data.shadow_soft_size = LAMP_RADIUS_MM
        scene.collection.objects.link(source)
        camera_object = new_camera(scene, CAMERA, clip_mm=(10.0, 2000.0))
        for number, pose in enumerate(poses):
            place_camera(camera_object, pose)
            if lamp is None:
                source.matrix_world = Matrix(_towards(camera_centre(pose) / DISTANCE_MM))
            else:
                source.location = lamp.place_model(pose).tolist()
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
