"""Photographs of the sample case, path traced by Cycles: wet bone under a surgical microscope's light.

They replace the real microscope frame and the held-out frames for judging novel views, so nothing here uses the
project's own colouring: colours come from three-dimensional noise in the material, far finer than the mesh; shading,
shadows, interreflection and wet highlights come from a light next to the lens that moves with the camera.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal

import bpy
import numpy as np
from mathutils import Matrix

from ...camera.pinhole import PinholeCamera
from ...files.outputs import write_output
from ...files.temporary import temporary_folder, unwritable_temporary
from ...images.image_reader import read_image
from ...images.pixel_values import to_uint8
from ...images.png import encode_png
from ...process.own_process import delayed_interrupts
from ...sample.temporal_bone import SampleSurface
from ...transforms import inverse_rigid, rigid
from ..bridge.camera import new_camera, place_camera
from ..bridge.data_blocks import new_mesh_object, set_vertex_colors, temporary_data
from ..bridge.node_tree import Nodes
from ..bridge.versions import IS_5, new_node_material


def set_path_tracing(scene: bpy.types.Scene, samples: int, *, depth: Literal["8", "16"]) -> None:
    """Set a scene up to render sRGB PNGs with one bounce of light, the same ones every time.

    ``samples`` are paths per pixel before denoising, ``depth`` the bits of a channel.
    """
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.use_persistent_data = True
    render.use_compositing = render.use_sequencer = False
    render.dither_intensity = 0.0
    render.image_settings.file_format = "PNG"
    render.image_settings.color_mode, render.image_settings.color_depth = "RGB", depth
    # no dates or names of this computer in the file
    for stamp in filter(lambda name: name.startswith("use_stamp_"), render.bl_rna.properties.keys()):
        setattr(render, stamp, False)
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform, scene.view_settings.look = "Standard", "None"
    cycles.device, cycles.seed, cycles.samples = "CPU", 0, samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.denoising_quality = "FAST"
    cycles.max_bounces = cycles.diffuse_bounces = 1
    cycles.use_light_tree = cycles.use_auto_tile = False


def add_ambient_light(scene: bpy.types.Scene, rgb: Sequence[float], strength: float) -> bpy.types.World:
    """Give a scene a world of one colour (linear), which is returned."""
    world = bpy.data.worlds.new("ambient light")
    scene.world = world
    if not IS_5:
        world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*rgb, 1)
    background.inputs["Strength"].default_value = strength
    return world


LAMP_OFFSET_MM = np.array([-13.0, -16.0, 0.0])
"""Position of the lamp next to the lens, ``cam`` axes: about 20 mm off the optical axis."""
LAMP_RADIUS_MM = 4.0
LAMP_WATT_PER_MM2 = 36.0
"""Lamp power divided by the squared working distance, so that the exposure does not depend on the distance."""
AMBIENT_COLOR = (0.9, 1.0, 1.1)
AMBIENT_STRENGTH = 0.05


def take_photographs(
    surface: SampleSurface,
    camera: PinholeCamera,
    shots: Iterable[tuple[np.ndarray, Path]],
    *,
    samples: int = 3,
    lamp_cam: np.ndarray = LAMP_OFFSET_MM,
) -> Iterator[Path]:
    """Photograph the sample case; one 8-bit sRGB PNG per shot.

    Parameters
    ----------
    surface
        The photographs show its bone, not its structures (these are inside the bone, or parts of its surface).
    camera
        Intrinsics of all photographs; a pinhole, without lens effects.
    shots
        ``cam_from_mesh`` (4x4, mm) and the file to write.
    samples
        Paths per pixel before denoising.
    lamp_cam
        ``(3,)`` where the lamp is, ``cam`` axes, mm.

    Yields
    ------
    The path of each file once it is complete.
    """
    with temporary_data():
        scene = bpy.data.scenes.new("sample photograph")
        _set_render(scene, samples)
        # centred, so that Blender's single precision is most accurate near the surface
        centre = surface.bone.bounds.mean(axis=0)
        _add_bone(scene, surface, -centre)
        camera_object = new_camera(scene, camera, clip_mm=(10.0, 2000.0))
        lamp = _add_lamp(scene)
        for cam_from_mesh, path in shots:
            cam_from_scene = cam_from_mesh @ rigid(translation=centre)
            place_camera(camera_object, cam_from_scene)
            _place_lamp(lamp, cam_from_scene, lamp_cam)
            with delayed_interrupts():
                bpy.ops.render.render(scene=scene.name)
            data = _png_of_render(scene)
            write_output(path, data)
            yield path


def _png_of_render(scene: bpy.types.Scene) -> bytes:
    with temporary_folder() as folder:
        path = folder / "photograph.png"
        try:
            # unlike render.filepath, this path is literal: # and {} have no special meaning
            bpy.data.images["Render Result"].save_render(str(path), scene=scene)
            # encoded anew: Cycles writes its render times into the file
            return encode_png(to_uint8(read_image(path)[0]))
        except (RuntimeError, OSError) as error:
            raise unwritable_temporary(" ".join(str(error).split())) from None


def _set_render(scene: bpy.types.Scene, samples: int) -> None:
    set_path_tracing(scene, samples, depth="8")
    cycles = scene.cycles
    scene.render.image_settings.compression = 0
    cycles.denoising_input_passes, cycles.denoising_prefilter = "RGB_ALBEDO_NORMAL", "NONE"
    cycles.glossy_bounces = 0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = 2.0
    add_ambient_light(scene, AMBIENT_COLOR, AMBIENT_STRENGTH).cycles.sampling_method = "NONE"


def _add_lamp(scene: bpy.types.Scene) -> bpy.types.Object:
    lamp = bpy.data.lights.new("microscope lamp", "SPOT")
    lamp.shadow_soft_size = LAMP_RADIUS_MM
    lamp.spot_size, lamp.spot_blend = np.radians(17.0), 0.9
    lamp.cycles.use_multiple_importance_sampling = False
    lamp.color = (1.0, 0.96, 0.89)
    lamp_object = bpy.data.objects.new("microscope lamp", lamp)
    scene.collection.objects.link(lamp_object)
    return lamp_object


def _place_lamp(lamp_object: bpy.types.Object, cam_from_scene: np.ndarray, lamp_cam: np.ndarray) -> None:
    """Place the lamp and aim it at the point of the optical axis at the scene's distance."""
    distance = cam_from_scene[2, 3]
    forward = np.array([0, 0, distance]) - lamp_cam
    forward /= np.linalg.norm(forward)
    side = np.cross(forward, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    # a Blender lamp shines along its own -z
    cam_from_lamp = rigid(np.stack([side, np.cross(side, forward), -forward], axis=1), lamp_cam)
    lamp_object.matrix_world = Matrix(inverse_rigid(cam_from_scene) @ cam_from_lamp)
    lamp_object.data.energy = LAMP_WATT_PER_MM2 * distance**2


# for each tissue: sRGB at the low and high end of the noise, and its opacity over the tissues before it
PALETTE = {
    "cortex": ((226, 203, 168), (241, 231, 211), 1.0),
    "drilled": ((222, 182, 148), (251, 243, 226), 1.0),
    "nerve": ((230, 146, 118), (242, 182, 156), 0.5),
    "air_cell": ((78, 14, 10), (164, 66, 50), 0.92),
    "mucosa": ((180, 78, 68), (226, 154, 134), 0.65),
    "canal_skin": ((212, 146, 122), (230, 186, 158), 1.0),
}
MUSCLE = ((140, 44, 36), (206, 130, 102))
BLOOD_FILM, BLOOD_POOL = (188, 78, 56), (98, 8, 6)


def _add_bone(scene: bpy.types.Scene, surface: SampleSurface, offset: np.ndarray) -> None:
    bone = new_mesh_object("sample bone", surface.bone.moved(offset))
    bone.data.shade_smooth()
    tissue = surface.tissue
    for row, name in enumerate(("color_low", "color_high")):
        rgba = np.ones((len(surface.bone.vertices), 4))
        for kind, (*colours, cover) in PALETTE.items():
            weight = cover * tissue[kind][:, None] if kind in tissue else 1.0
            rgba[:, :3] += weight * (_linear(colours[row])[:3] - rgba[:, :3])
        set_vertex_colors(bone, name, rgba)
    wet = np.maximum(0.8 * tissue["drilled"], tissue["mucosa"])
    rough = 0.4 + 0.35 * tissue["drilled"] - 0.2 * tissue["canal_skin"] - 0.4 * tissue["mucosa"]
    for name, value in {
        "soft_tissue": tissue["soft_tissue"],
        "pool": tissue["pool"],
        "wet": wet,
        "rough": rough,
    }.items():
        bone.data.attributes.new(name, "FLOAT", "POINT").data.foreach_set("value", value.astype(np.float32))
    bone.data.materials.append(_tissue_material())
    scene.collection.objects.link(bone)


def _linear(srgb: tuple[int, int, int]) -> np.ndarray:
    """sRGB 0..255 -> linear RGBA (IEC 61966-2-1)."""
    encoded = np.array(srgb) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.append(linear, 1.0)


Socket = bpy.types.NodeSocket


class _Nodes(Nodes):
    def noise(
        self, per_mm: float, detail: float, lacunarity: float, position: bpy.types.NodeSocket
    ) -> bpy.types.NodeOutputs:
        inputs = {"Vector": position, "Scale": per_mm, "Detail": detail, "Roughness": 0.65, "Lacunarity": lacunarity}
        return self.add("ShaderNodeTexNoise", inputs).outputs

    def vector(self, operation: str, *operands: object) -> Socket:
        return self.add("ShaderNodeVectorMath", dict(enumerate(operands)), operation=operation).outputs["Vector"]

    def ramp(self, value: Socket, zero: float, one: float, low: float = 0.0, high: float = 1.0) -> Socket:
        inputs = {"Value": value, "From Min": zero, "From Max": one, "To Min": low, "To Max": high}
        return self.add("ShaderNodeMapRange", inputs, clamp=True).outputs["Result"]


def _tissue_material() -> bpy.types.Material:
    material = new_node_material("wet bone")
    make = _Nodes(material.node_tree)

    def stored(name: str) -> bpy.types.NodeOutputs:
        return make.add("ShaderNodeAttribute", attribute_name=name).outputs

    position = make.add("ShaderNodeTexCoord").outputs["Object"]
    normal = make.add("ShaderNodeNewGeometry").outputs["Normal"]
    blotch = make.noise(0.22, 3.0, 2.2, position)["Fac"]
    fine = make.noise(1.7, 2.0, 2.6, position)
    grain = fine["Fac"]

    colour = make.mixed(make.ramp(grain, 0.30, 0.52), stored("color_low")["Color"], stored("color_high")["Color"])
    # the coarse noise places a thin film of blood, and the fine noise breaks up its edge
    edge = make.math("MULTIPLY_ADD", grain, 0.3, blotch)
    colour = make.mixed(make.ramp(edge, 0.70, 0.86, 0.0, 0.55), colour, _linear(BLOOD_FILM))
    muscle = make.mixed(make.ramp(blotch, 0.35, 0.6), *map(_linear, MUSCLE))
    ragged = make.math("MULTIPLY_ADD", edge, 2.0, stored("soft_tissue")["Fac"])
    colour = make.mixed(make.ramp(ragged, 1.75, 1.92), colour, muscle)
    pool = make.ramp(make.math("MULTIPLY_ADD", edge, 1.5, stored("pool")["Fac"]), 1.5, 1.7, 0.0, 0.93)
    colour = make.mixed(pool, colour, _linear(BLOOD_POOL))

    wet = make.ramp(make.math("MULTIPLY_ADD", stored("wet")["Fac"], 0.25, blotch), 0.40, 0.62, 0.2, 1.0)
    # three channels of one noise tilt the normal, at a fraction of the cost of a Bump node; fluid is smooth
    tilt = make.vector("SUBTRACT", fine["Color"], (0.5, 0.5, 0.5))
    rough = make.math("MULTIPLY", stored("rough")["Fac"], make.ramp(pool, 0.0, 1.0, 1.0, 0.3))
    film = make.math("MULTIPLY", rough, 0.4)
    principled = make.add(
        "ShaderNodeBsdfPrincipled",
        {
            "Base Color": colour,
            "Roughness": 0.5,
            "Specular IOR Level": 0.35,
            "Normal": make.vector("NORMALIZE", make.vector("MULTIPLY_ADD", tilt, rough, normal)),
            "Coat Weight": wet,
            "Coat Roughness": 0.13,
            "Coat IOR": 1.33,
            "Coat Normal": make.vector("NORMALIZE", make.vector("MULTIPLY_ADD", tilt, film, normal)),
        },
    )
    make.add("ShaderNodeOutputMaterial", {"Surface": principled.outputs["BSDF"]})
    return material
