"""Surface colour as emission: both colour modes as shader nodes, each with its observed flag.

Of several frames, the surface shows the colour of the first one whose flag is 1.

Both compute two values, a colour and a flag that is 1 where the frame saw the shaded point. The surface emits the
colour, or that of unseen surface where the flag is 0; the flag goes to the pass :data:`OBSERVED_PASS`. There is no
light, so renders show the code values unchanged. Back sides are never observed.

The flag is the rule of :mod:`oneframe.colour.seen_frame` at the shaded point, in both. Of vertices, all three must
also have a colour from the frame.
"""

from dataclasses import dataclass

import bpy
import numpy as np

from ...colour.lens_shading import LensShading, corner_normals
from ...colour.seen_frame import SeenFrame
from ...colour.shading import ColouredSurface, SurfaceColour
from ...colour.vertex_colours import NEUTRAL, OBSERVED_LEAST, VertexColours
from ...surface.mesh import TriangleMesh
from ...transforms import transform_points
from ..bridge.data_blocks import set_corner_vectors, set_vertex_colors
from ..bridge.image import new_float_image
from ..bridge.node_tree import Nodes
from ..bridge.versions import new_node_material

OBSERVED_PASS, SOURCE_PASS = "observed", "source"
"""The flag of the frame that colours a point, and its number from 1, or 0."""
COLOUR_ATTRIBUTE = "frame_colour"
UNSEEN_ATTRIBUTE = "frame_unseen_colour"
PROJECTION_ATTRIBUTE = "frame_projection"
NORMAL_ATTRIBUTE, LAMP_NODE = "frame_normal", "lamp"
"""Of surfaces in the light at the lens: their normals, and the node that :func:`move_lamp` sets."""
NEUTRAL_RGBA = (NEUTRAL, NEUTRAL, NEUTRAL, 1.0)
_NOWHERE = (-1.0, -1.0, 1.0)  # projects outside the frame


def filter_lookups(frame: int) -> list[tuple[str, str]]:
    """Names of what moves a filter's four lookups, and of their image nodes, see :func:`assign_colour`."""
    return [(f"filter offset {frame} {number}", f"filter image {frame} {number}") for number in range(4)]


def assign_colour(mesh_object: bpy.types.Object, surface: ColouredSurface, *, filtered: bool = False) -> None:
    """Give the object the material of a colour mode.

    Parameters
    ----------
    mesh_object, surface
        The surface as a Blender object, and as it is.
    filtered
        Take colours (not the observed flag) as the mean of four lookups, nodes :func:`filter_lookups`, for which the
        caller sets images and offsets, see :mod:`oneframe.colour.footprint_filter`. The alpha of the first is added to
        the flag of observed points. Ignored for vertex colours, which have no image.
    """
    colours, unseen = surface.colours, surface.unseen
    material = new_node_material("surface")
    nodes = Nodes(material.node_tree)
    backfacing = nodes.add("ShaderNodeNewGeometry").outputs["Backfacing"]
    rgb: bpy.types.NodeSocket | None = None
    flag = passed = nodes.math("GREATER_THAN", 1.0, backfacing)
    for number, colour in enumerate(colours):
        frame = _Frame(nodes, mesh_object, surface.mesh, number, filtered)
        own_rgb, own_flag, addition = frame.colour(colour)
        own_flag = nodes.math("GREATER_THAN", own_flag, backfacing)
        own_passed = own_flag if addition is None else nodes.math("MULTIPLY_ADD", own_flag, addition, own_flag)
        if rgb is None:
            rgb, flag, passed, source = own_rgb, own_flag, own_passed, own_flag
            continue
        new = nodes.math("GREATER_THAN", own_flag, flag)
        rgb = nodes.mixed(new, rgb, own_rgb)
        passed = nodes.chosen(new, passed, own_passed)
        source = nodes.chosen(new, source, number + 1.0)
        flag = nodes.math("MAXIMUM", flag, own_flag)
    if len(colours) > 1:
        output = nodes.add("ShaderNodeOutputAOV", aov_name=SOURCE_PASS)
        nodes.link(source, output.inputs["Value"])
    observed_pass = nodes.add("ShaderNodeOutputAOV", aov_name=OBSERVED_PASS)
    nodes.link(passed, observed_pass.inputs["Value"])
    shown: tuple | bpy.types.NodeSocket = NEUTRAL_RGBA
    if rgb is not None:
        other: tuple | bpy.types.NodeSocket = NEUTRAL_RGBA
        if unseen is not None:
            set_vertex_colors(mesh_object, UNSEEN_ATTRIBUTE, np.pad(unseen, ((0, 0), (0, 1)), constant_values=1))
            other = nodes.add("ShaderNodeAttribute", attribute_name=UNSEEN_ATTRIBUTE).outputs["Color"]
        shown = nodes.mixed(flag, other, rgb)
    lamplight = None
    if surface.light is not None:
        albedo = NEUTRAL_RGBA[:3] if rgb is None else shown
        shown, lamplight = _in_light(nodes, mesh_object, surface.mesh, surface.light, albedo, backfacing)
    emission = nodes.add("ShaderNodeEmission", {"Color": shown}).outputs["Emission"]
    if lamplight is not None:
        emission = nodes.add("ShaderNodeAddShader", {0: emission, 1: lamplight}).outputs["Shader"]
    output = nodes.add("ShaderNodeOutputMaterial")
    nodes.link(emission, output.inputs["Surface"])
    # else Cycles builds a light distribution over all triangles and samples it
    material.cycles.emission_sampling = "NONE"
    mesh_object.data.materials.clear()
    mesh_object.data.materials.append(material)


def _in_light(
    nodes: Nodes,
    mesh_object: bpy.types.Object,
    mesh: TriangleMesh,
    lens: LensShading,
    rgb: tuple | bpy.types.NodeSocket,
    backfacing: bpy.types.NodeSocket,
) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket | None]:
    """Colours in the light at the lens, plus their shift: the law of :meth:`.LensShading.factors`.

    With shadows they are those in its shadow, and the second is a shader with what the lamp adds where it reaches: a
    diffuse BSDF of the flat faces, from which their own cosine and the lamp's distance are taken out.

    A lamp and a diffuse BSDF would not do: the light that Cycles gives a smooth normal ends where the face itself turns
    away, and its energy has units of its own.
    """

    def vector(operation: str, *values: object, result: str = "Vector") -> bpy.types.NodeSocket:
        node = nodes.add("ShaderNodeVectorMath", dict(enumerate(values)), operation=operation)
        return node.outputs[result]

    set_corner_vectors(mesh_object, NORMAL_ATTRIBUTE, corner_normals(mesh))
    normal = nodes.add("ShaderNodeAttribute", attribute_name=NORMAL_ATTRIBUTE).outputs["Vector"]
    position = nodes.add("ShaderNodeNewGeometry").outputs["Position"]
    towards_lamp = nodes.add("ShaderNodeVectorMath", {0: position}, operation="MULTIPLY_ADD", name=LAMP_NODE)
    lamp = towards_lamp.outputs["Vector"]
    side = nodes.math("MULTIPLY_ADD", backfacing, -2.0, 1.0)
    along = nodes.math("MULTIPLY", vector("DOT_PRODUCT", vector("NORMALIZE", normal), lamp, result="Value"), side)
    squared = nodes.math("MAXIMUM", vector("DOT_PRODUCT", lamp, lamp, result="Value"), 1e-6)
    nearness = nodes.math("POWER", squared, -(lens.light.falloff + 1) / 2)
    direct = nodes.math("MAXIMUM", along, 0.0) if lens.light.lamp_cam_mm else 0.0
    linear = nodes.math("MULTIPLY_ADD", direct, nearness, lens.light.ambient)
    ambient: bpy.types.NodeSocket | float = lens.light.ambient
    if lens.light.vignetting:
        view = nodes.add("ShaderNodeCameraData").outputs
        cosine = nodes.math("DIVIDE", view["View Z Depth"], view["View Distance"])
        vignetted = nodes.math("POWER", cosine, lens.light.vignetting)
        linear, ambient = nodes.math("MULTIPLY", linear, vignetted), nodes.math("MULTIPLY", vignetted, ambient)
    factor, shaded = (
        nodes.math("POWER", nodes.math("MAXIMUM", each, lens.least), 1 / lens.curve.gamma) for each in (linear, ambient)
    )
    shifted = vector("ADD", rgb, (lens.curve.shift,) * 3)
    if not lens.shadows:
        return nodes.scaled(shifted, factor), None
    mesh_object.data.shade_flat()
    face = nodes.add("ShaderNodeNewGeometry").outputs["True Normal"]
    cosine = nodes.math("MAXIMUM", vector("DOT_PRODUCT", face, vector("NORMALIZE", lamp), result="Value"), 1e-4)
    added = nodes.math("MULTIPLY", nodes.math("SUBTRACT", factor, shaded), nodes.math("DIVIDE", squared, cosine))
    diffuse = nodes.add("ShaderNodeBsdfDiffuse", {"Color": nodes.scaled(shifted, added)})
    return nodes.scaled(shifted, shaded), diffuse.outputs["BSDF"]


def move_lamp(mesh_object: bpy.types.Object, lens: LensShading, cam_from_model: np.ndarray) -> tuple[np.ndarray, float]:
    """Put the light that :func:`assign_colour` has given a surface at the lens of a pose (4x4, mm).

    Returns its place, model frame, and the pose's working distance, mm.
    """
    light, distance_mm = lens.at(cam_from_model)
    lamp = light.place_model(cam_from_model)
    # the direction of the lamp in working distances
    scale = 1 / distance_mm
    _, factor, offset = mesh_object.data.materials[0].node_tree.nodes[LAMP_NODE].inputs[:3]
    factor.default_value, offset.default_value = (-scale,) * 3, scale * lamp
    return lamp, distance_mm


@dataclass(frozen=True)
class _Frame:
    """The part of a material that knows one frame, with attributes of its own on the mesh."""

    nodes: Nodes
    mesh_object: bpy.types.Object
    mesh: TriangleMesh
    number: int
    filtered: bool

    def colour(self, colour: SurfaceColour) -> tuple:
        """Colour, flag, and addition to the flag or ``None``."""
        if isinstance(colour, SeenFrame):
            return self._projection(colour, filtered=self.filtered)
        return self._vertex_colour(colour)

    def _corner_vectors(self, name: str, vectors: np.ndarray) -> bpy.types.NodeSocket:
        name = f"{name} {self.number}"
        set_corner_vectors(self.mesh_object, name, vectors)
        return self.nodes.add("ShaderNodeAttribute", attribute_name=name).outputs["Vector"]

    def _vertex_colour(self, colour: VertexColours) -> tuple:
        name = f"{COLOUR_ATTRIBUTE} {self.number}"
        set_vertex_colors(self.mesh_object, name, np.concatenate([colour.rgb, colour.least[:, None]], axis=1))
        attribute = self.nodes.add("ShaderNodeAttribute", attribute_name=name)
        flag = self.nodes.math("GREATER_THAN", attribute.outputs["Alpha"], OBSERVED_LEAST)
        if colour.source is not None:
            _, seen, _ = self._projection(colour.source, filtered=False)
            flag = self.nodes.math("MULTIPLY", flag, seen)
        return attribute.outputs["Color"], flag, None

    def _projection(self, source: SeenFrame, *, filtered: bool) -> tuple:
        """The pinhole projection per shaded point, and the rule of :mod:`oneframe.colour.seen_frame`.

        The homogeneous pixel (s z, t z, z), with (s, t) in Blender's texture coordinates, is an affine function of the
        surface point: interpolated over a triangle of any size and divided by z it is the exact projection.
        """
        camera, nodes = source.camera, self.nodes
        points_cam = transform_points(source.cam_from_model, self.mesh.vertices)
        z = points_cam[:, 2]
        s = (camera.fx * points_cam[:, 0] + (camera.cx + 0.5) * z) / camera.width
        t = z - (camera.fy * points_cam[:, 1] + (camera.cy + 0.5) * z) / camera.height
        corners = np.stack([s, t, z], axis=1)[self.mesh.faces]
        corners[~source.facing_faces(self.mesh)] = _NOWHERE
        image, surface = source.continued
        rgba = np.concatenate([image, surface[..., None]], axis=2)

        homogeneous = self._corner_vectors(PROJECTION_ATTRIBUTE, corners)
        separate = nodes.add("ShaderNodeSeparateXYZ", {0: homogeneous})
        depth = separate.outputs["Z"]
        pixel = nodes.scaled(homogeneous, nodes.math("DIVIDE", 1.0, depth))
        rgb, inverse_depth, addition = self._image_lookup(new_float_image("frame", rgba), pixel, filtered)
        ratio = nodes.math("MULTIPLY", depth, inverse_depth)
        return rgb, nodes.math("COMPARE", ratio, 1.0, source.depth_tolerance), addition

    def _image_lookup(self, image: bpy.types.Image, coordinates: bpy.types.NodeSocket, filtered: bool) -> tuple:
        """Colour and alpha of an image (alpha is 0 outside it), and the alpha of the first filtered one or ``None``."""
        nodes = self.nodes
        exact = nodes.add("ShaderNodeTexImage", image=image, interpolation="Linear", extension="CLIP")
        nodes.link(coordinates, exact.inputs["Vector"])
        if not filtered:
            return exact.outputs["Color"], exact.outputs["Alpha"], None
        lookups = []
        for offset_name, image_name in filter_lookups(self.number):
            moved = nodes.add("ShaderNodeVectorMath", name=offset_name, operation="ADD")
            nodes.link(coordinates, moved.inputs[0])
            lookup = nodes.add(
                "ShaderNodeTexImage", name=image_name, image=image, interpolation="Linear", extension="EXTEND"
            )
            nodes.link(moved.outputs["Vector"], lookup.inputs["Vector"])
            lookups.append(lookup)
        mean = nodes.scaled(nodes.added(*(lookup.outputs["Color"] for lookup in lookups)), 0.25)
        return mean, exact.outputs["Alpha"], lookups[0].outputs["Alpha"]
