"""Surface colour as emission: the three colour modes as shader nodes, each with its observed flag.

All modes end in the same two values, a colour and a flag that is 1 where the frame saw the shaded point; the surface
shines with the colour, or with :data:`pipeline.colouring.NEUTRAL` where the flag is 0, and the flag goes to the pass
:data:`OBSERVED_PASS`. Nothing is lit, so colours pass through as code values. Back sides are never observed.
"""

import bpy
import numpy as np

from pipeline.blender.image import new_float_image
from pipeline.blender.mesh import set_corner_uv, set_corner_vectors, set_vertex_colors
from pipeline.blender.versions import new_node_material
from pipeline.colouring import NEUTRAL, VertexColours
from pipeline.frames import transform_points
from pipeline.mesh import TriangleMesh
from pipeline.texture_atlas import TextureAtlas
from pipeline.visibility import SourceView

OBSERVED_PASS = "observed"
COLOUR_ATTRIBUTE = "frame_colour"
OBSERVED_ATTRIBUTE = "frame_observed"
UV_MAP = "frame_uv"
PROJECTION_ATTRIBUTE = "frame_projection"
_NOWHERE = (-1.0, -1.0, 1.0)  # projects outside the frame

SurfaceColour = VertexColours | TextureAtlas | SourceView


def assign_colour(mesh_object: bpy.types.Object, mesh: TriangleMesh, colour: SurfaceColour | None) -> None:
    """Give the object the material of a colour mode.

    ``None`` makes it plain neutral, for geometry alone; the observed flag then tells front sides from back sides.
    """
    material = new_node_material("surface")
    nodes = _Nodes(material)
    match colour:
        case None:
            rgb, flag = None, 1.0
        case VertexColours():
            rgb, flag = _vertex_colour(nodes, mesh_object, colour)
        case TextureAtlas():
            rgb, flag = _texture(nodes, mesh_object, colour)
        case SourceView():
            rgb, flag = _projection(nodes, mesh_object, mesh, colour)
    geometry = nodes.add("ShaderNodeNewGeometry")
    flag = nodes.math("GREATER_THAN", flag, geometry.outputs["Backfacing"])
    observed_pass = nodes.add("ShaderNodeOutputAOV", aov_name=OBSERVED_PASS)
    nodes.link(flag, observed_pass.inputs["Value"])
    emission = nodes.add("ShaderNodeEmission", Color=(NEUTRAL, NEUTRAL, NEUTRAL, 1.0))
    if rgb is not None:
        mix = nodes.add("ShaderNodeMix", data_type="RGBA")
        nodes.link(flag, mix.inputs[0])
        mix.inputs[6].default_value = (NEUTRAL, NEUTRAL, NEUTRAL, 1.0)
        nodes.link(rgb, mix.inputs[7])
        nodes.link(mix.outputs[2], emission.inputs["Color"])
    output = nodes.add("ShaderNodeOutputMaterial")
    nodes.link(emission.outputs["Emission"], output.inputs["Surface"])
    # else Cycles builds a light distribution over all triangles and samples it
    material.cycles.emission_sampling = "NONE"
    mesh_object.data.materials.clear()
    mesh_object.data.materials.append(material)


def _vertex_colour(nodes: "_Nodes", mesh_object: bpy.types.Object, colour: VertexColours) -> tuple:
    rgba = np.concatenate([colour.rgb, colour.observed[:, None]], axis=1)
    # Workbench draws attributes, not materials, and of these their colour only
    set_vertex_colors(mesh_object, OBSERVED_ATTRIBUTE, np.repeat(rgba[:, 3:], 4, axis=1))
    set_vertex_colors(mesh_object, COLOUR_ATTRIBUTE, rgba)
    mesh_object.data.color_attributes.active_color_name = COLOUR_ATTRIBUTE
    attribute = nodes.add("ShaderNodeAttribute", attribute_name=COLOUR_ATTRIBUTE)
    # a point is observed if all three vertices of its triangle are
    return attribute.outputs["Color"], nodes.math("GREATER_THAN", attribute.outputs["Alpha"], 0.9999)


def _texture(nodes: "_Nodes", mesh_object: bpy.types.Object, atlas: TextureAtlas) -> tuple:
    set_corner_uv(mesh_object, UV_MAP, atlas.uv)
    rgba = np.concatenate([atlas.image, atlas.observed[..., None]], axis=2)
    uv = nodes.add("ShaderNodeUVMap", uv_map=UV_MAP)
    image = nodes.image(new_float_image("frame_atlas", rgba), uv.outputs["UV"])
    # a point is observed if all texels of non-zero weight are
    return image.outputs["Color"], nodes.math("GREATER_THAN", image.outputs["Alpha"], 0.9999)


def _projection(nodes: "_Nodes", mesh_object: bpy.types.Object, mesh: TriangleMesh, source: SourceView) -> tuple:
    """The pinhole projection per shaded point, and the rule of :mod:`pipeline.visibility`.

    The homogeneous pixel (s z, t z, z), with (s, t) in Blender's texture coordinates, is an affine function of the
    surface point: interpolated over a triangle of any size and divided by z it is the exact projection.
    """
    camera = source.camera
    points_cam = transform_points(source.cam_from_model, mesh.vertices)
    z = points_cam[:, 2]
    s = (camera.fx * points_cam[:, 0] + (camera.cx + 0.5) * z) / camera.width
    t = z - (camera.fy * points_cam[:, 1] + (camera.cy + 0.5) * z) / camera.height
    corners = np.stack([s, t, z], axis=1)[mesh.faces]
    corners[~source.facing_faces(mesh)] = _NOWHERE
    set_corner_vectors(mesh_object, PROJECTION_ATTRIBUTE, corners)
    rgba = np.concatenate([source.image, source.inverse_depth[..., None]], axis=2)

    homogeneous = nodes.add("ShaderNodeAttribute", attribute_name=PROJECTION_ATTRIBUTE).outputs["Vector"]
    separate = nodes.add("ShaderNodeSeparateXYZ")
    nodes.link(homogeneous, separate.inputs[0])
    depth = separate.outputs["Z"]
    pixel = nodes.add("ShaderNodeVectorMath", operation="SCALE")
    nodes.link(homogeneous, pixel.inputs[0])
    nodes.link(nodes.math("DIVIDE", 1.0, depth), pixel.inputs["Scale"])
    image = nodes.image(new_float_image("frame", rgba), pixel.outputs[0])
    ratio = nodes.math("MULTIPLY", depth, image.outputs["Alpha"])
    return image.outputs["Color"], nodes.math("COMPARE", ratio, 1.0, source.depth_tolerance)


class _Nodes:
    """A node tree written down tersely."""

    def __init__(self, material: bpy.types.Material) -> None:
        self._tree = material.node_tree

    def add(self, kind: str, **settings: object) -> bpy.types.Node:
        node = self._tree.nodes.new(kind)
        for name, value in settings.items():
            if name in node.inputs:
                node.inputs[name].default_value = value
            else:
                setattr(node, name, value)
        return node

    def link(self, output: bpy.types.NodeSocket, to: bpy.types.NodeSocket) -> None:
        self._tree.links.new(output, to)

    def math(self, operation: str, *values: object) -> bpy.types.NodeSocket:
        node = self.add("ShaderNodeMath", operation=operation)
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, int | float):
                socket.default_value = value
            else:
                self.link(value, socket)
        return node.outputs[0]

    def image(self, image: bpy.types.Image, coordinates: bpy.types.NodeSocket) -> bpy.types.Node:
        node = self.add("ShaderNodeTexImage", image=image, interpolation="Linear", extension="CLIP")
        self.link(coordinates, node.inputs["Vector"])
        return node
