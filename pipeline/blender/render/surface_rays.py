"""Colours of a surface along arbitrary rays, by the same rule as its material, without a render.

A Geometry Nodes modifier casts the rays: its input are the vertices of a point mesh as ray directions, its output the
same vertices as colours. The point mesh is in a separate scene, so renders of the surface neither show it nor are
updated because of it. A ray costs about as much as two of Cycles' samples.
"""

from typing import Any

import bpy
import numpy as np

from ...colour.source_view import SourceView
from ...colour.texture_atlas import TextureAtlas
from ...colour.vertex_colours import VertexColours
from ..bridge.node_tree import Nodes
from .material import (
    ATLAS_IMAGE,
    COLOUR_ATTRIBUTE,
    FRAME_IMAGE,
    NEUTRAL_RGBA,
    PROJECTION_ATTRIBUTE,
    UNSEEN_ATTRIBUTE,
    UV_MAP,
    SurfaceColour,
    least_cover,
)
from .surface_scene import SurfaceScene

_FARTHEST_MM = 1e9


class SurfaceRays:
    """Casts rays at the surface of a scene; its data-blocks are removed with the scene."""

    def __init__(self, surface_scene: SurfaceScene, colour: SurfaceColour) -> None:
        with surface_scene.owning():
            self._scene = bpy.data.scenes.new("oneframe rays")
            self._points = bpy.data.meshes.new("rays")
            self._object = bpy.data.objects.new("rays", self._points)
            self._scene.collection.objects.link(self._object)
            modifier = self._object.modifiers.new("rays", "NODES")
            modifier.node_group, self._origin = _ray_nodes(surface_scene.surface_object, colour)

    def colours(self, origin_model: np.ndarray, directions_model: np.ndarray) -> np.ndarray:
        """``(3,)`` origin in mm, ``(N, 3)`` directions of any length -> ``(N, 3)`` float32; black without a hit."""
        points, count = self._points, len(directions_model)
        if count == 0:
            return np.zeros((0, 3), np.float32)
        if len(points.vertices) != count:
            points.clear_geometry()
            points.vertices.add(count)
        points.vertices.foreach_set("co", np.ascontiguousarray(directions_model, np.float32).ravel())
        points.update()
        self._origin.vector = origin_model
        layer = self._scene.view_layers[0]
        layer.update()
        colours = np.empty(3 * count, np.float32)
        self._object.evaluated_get(layer.depsgraph).data.vertices.foreach_get("co", colours)
        return colours.reshape(-1, 3)


def _ray_nodes(surface: bpy.types.Object, colour: SurfaceColour) -> tuple[bpy.types.NodeTree, bpy.types.Node]:
    """The modifier's node group, and the node that holds the rays' origin."""
    group = bpy.data.node_groups.new("rays", "GeometryNodeTree")
    kind: Any = "NodeSocketGeometry"  # an enumeration that is made at runtime
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=direction, socket_type=kind)
    nodes = Nodes(group)
    rays, target = nodes.add("NodeGroupInput"), nodes.add("GeometryNodeObjectInfo", Object=surface)
    origin, direction = nodes.add("FunctionNodeInputVector"), nodes.add("GeometryNodeInputPosition")

    def cast(kind: Any, name: str) -> bpy.types.Node:
        attribute = nodes.add("GeometryNodeInputNamedAttribute", data_type=kind, Name=name)
        hit = nodes.add("GeometryNodeRaycast", data_type=kind)
        hit.inputs["Ray Length"].default_value = _FARTHEST_MM
        nodes.link(target.outputs["Geometry"], hit.inputs["Target Geometry"])
        nodes.link(attribute.outputs["Attribute"], hit.inputs["Attribute"])
        # an unlinked socket would use the position of the point itself
        nodes.link(origin.outputs["Vector"], hit.inputs["Source Position"])
        nodes.link(direction.outputs["Position"], hit.inputs["Ray Direction"])
        return hit

    hit = cast(*_attribute_of(colour))
    rgb, observed = _shade(nodes, hit.outputs["Attribute"], colour, surface)
    if isinstance(colour, VertexColours | TextureAtlas) and colour.source is not None:
        place = cast(*_attribute_of(colour.source)).outputs["Attribute"]
        _, seen = _shade(nodes, place, colour.source, surface)
        observed = nodes.math("MULTIPLY", observed, seen)
    front = nodes.math("LESS_THAN", nodes.dot(hit.outputs["Hit Normal"], direction.outputs["Position"]), 0.0)
    filled = UNSEEN_ATTRIBUTE in surface.data.attributes
    other = cast("FLOAT_COLOR", UNSEEN_ATTRIBUTE).outputs["Attribute"] if filled else NEUTRAL_RGBA
    rgb = nodes.mixed(nodes.math("MULTIPLY", observed, front), other, rgb)
    moved, end = nodes.add("GeometryNodeSetPosition"), nodes.add("NodeGroupOutput")
    nodes.link(rays.outputs[0], moved.inputs["Geometry"])
    nodes.link(nodes.scaled(rgb, hit.outputs["Is Hit"]), moved.inputs["Position"])
    nodes.link(moved.outputs["Geometry"], end.inputs[0])
    return group, origin


def _attribute_of(colour: SurfaceColour) -> tuple[str, str]:
    match colour:
        case VertexColours():
            return "FLOAT_COLOR", COLOUR_ATTRIBUTE
        case TextureAtlas():
            return "FLOAT_VECTOR", UV_MAP
        case SourceView():
            return "FLOAT_VECTOR", PROJECTION_ATTRIBUTE


def _shade(
    nodes: Nodes, attribute: bpy.types.NodeSocket, colour: SurfaceColour, surface: bpy.types.Object
) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Colour and observed flag of a hit, as in :mod:`pipeline.blender.render.material`."""

    def image_lookup(name: str, coordinates: bpy.types.NodeSocket) -> bpy.types.Node:
        image = surface.data.materials[0].node_tree.nodes[name].image
        node = nodes.add("GeometryNodeImageTexture", Image=image, interpolation="Linear", extension="CLIP")
        nodes.link(coordinates, node.inputs["Vector"])
        return node

    match colour:
        case VertexColours():
            channels = nodes.add("FunctionNodeSeparateColor")
            nodes.link(attribute, channels.inputs["Color"])
            return attribute, nodes.math("GREATER_THAN", channels.outputs["Alpha"], least_cover(colour))
        case TextureAtlas():
            texel = image_lookup(ATLAS_IMAGE, attribute)
            cover = texel.outputs["Alpha"]
            rgb = nodes.scaled(texel.outputs["Color"], nodes.math("DIVIDE", 1.0, cover))
            return rgb, nodes.math("GREATER_THAN", cover, least_cover(colour))
        case SourceView():
            separate = nodes.add("ShaderNodeSeparateXYZ")
            nodes.link(attribute, separate.inputs[0])
            depth = separate.outputs["Z"]
            texel = image_lookup(FRAME_IMAGE, nodes.scaled(attribute, nodes.math("DIVIDE", 1.0, depth)))
            ratio = nodes.math("MULTIPLY", depth, texel.outputs["Alpha"])
            return texel.outputs["Color"], nodes.math("COMPARE", ratio, 1.0, colour.depth_tolerance)
