"""Colours of a surface along arbitrary rays, by the same rule as its material, without a render.

A Geometry Nodes modifier casts the rays: its input are the vertices of a point mesh as ray directions, its output the
same vertices as colours. The point mesh is in a separate scene, so renders of the surface neither show it nor are
updated because of it. A ray costs about as much as two of Cycles' samples.
"""

from typing import Any

import bpy
import numpy as np

from ...colour.shading import SurfaceColour
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
    least_cover,
)
from .surface_scene import SurfaceScene

_FARTHEST_MM = 1e9
_KIND_ATTRIBUTE = "ray_kind"


class SurfaceRays:
    """Casts rays at the surface of a scene; its data-blocks are removed with the scene."""

    def __init__(self, surface_scene: SurfaceScene, colour: SurfaceColour) -> None:
        with surface_scene.owning():
            self._scene = bpy.data.scenes.new("oneframe rays")
            self._points = bpy.data.meshes.new("rays")
            self._object = bpy.data.objects.new("rays", self._points)
            self._scene.collection.objects.link(self._object)
            modifier = self._object.modifiers.new("rays", "NODES")
            modifier.node_group, self._origin, self._texel_share = _ray_nodes(surface_scene.surface_object, colour)

    def cast(
        self, origin_model: np.ndarray, directions_model: np.ndarray, *, texel_share: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Cast rays from one point.

        Parameters
        ----------
        origin_model, directions_model
            ``(3,)`` mm, and ``(N, 3)`` of any length.
        texel_share
            0: colours of the frame are interpolated, 1: those of the nearest texel; in between, a mixture.

        Returns
        -------
        ``(N, 3)`` float32 colours, black without a hit, and ``(N,)`` int8: what they meet, see
        :mod:`oneframe.colour.anti_aliasing`.
        """
        points, count = self._points, len(directions_model)
        if count == 0:
            return np.zeros((0, 3), np.float32), np.zeros(0, np.int8)
        if len(points.vertices) != count:
            points.clear_geometry()
            points.vertices.add(count)
        points.vertices.foreach_set("co", np.ascontiguousarray(directions_model, np.float32).ravel())
        points.update()
        self._origin.vector = origin_model
        if self._texel_share is not None:
            self._texel_share.outputs[0].default_value = texel_share
        layer = self._scene.view_layers[0]
        layer.update()
        coloured = self._object.evaluated_get(layer.depsgraph).data
        colours, kinds = np.empty(3 * count, np.float32), np.empty(count, np.float32)
        coloured.vertices.foreach_get("co", colours)
        coloured.attributes[_KIND_ATTRIBUTE].data.foreach_get("value", kinds)
        return colours.reshape(-1, 3), kinds.astype(np.int8)


def _ray_nodes(
    surface: bpy.types.Object, colour: SurfaceColour
) -> tuple[bpy.types.NodeTree, bpy.types.Node, bpy.types.Node | None]:
    """The modifier's node group, and the nodes that hold the rays' origin and the share of the nearest texel."""
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
    share = None if isinstance(colour, VertexColours) else nodes.add("ShaderNodeValue")
    rgb, observed = _shade(nodes, hit.outputs["Attribute"], colour, surface, share)
    if isinstance(colour, VertexColours | TextureAtlas) and colour.source is not None:
        place = cast(*_attribute_of(colour.source)).outputs["Attribute"]
        _, in_view = _shade(nodes, place, colour.source, surface, None)
        observed = nodes.math("MULTIPLY", observed, in_view)
    front = nodes.math("LESS_THAN", nodes.dot(hit.outputs["Hit Normal"], direction.outputs["Position"]), 0.0)
    seen = nodes.math("MULTIPLY", observed, front)
    filled = UNSEEN_ATTRIBUTE in surface.data.attributes
    other = cast("FLOAT_COLOR", UNSEEN_ATTRIBUTE).outputs["Attribute"] if filled else NEUTRAL_RGBA
    rgb = nodes.mixed(seen, other, rgb)
    kept = nodes.add("GeometryNodeStoreNamedAttribute", data_type="FLOAT", domain="POINT", Name=_KIND_ATTRIBUTE)
    moved, end = nodes.add("GeometryNodeSetPosition"), nodes.add("NodeGroupOutput")
    nodes.link(rays.outputs[0], kept.inputs["Geometry"])
    is_hit = hit.outputs["Is Hit"]
    nodes.link(nodes.math("MULTIPLY_ADD", seen, is_hit, is_hit), kept.inputs["Value"])
    nodes.link(kept.outputs["Geometry"], moved.inputs["Geometry"])
    nodes.link(nodes.scaled(rgb, is_hit), moved.inputs["Position"])
    nodes.link(moved.outputs["Geometry"], end.inputs[0])
    return group, origin, share


def _attribute_of(colour: SurfaceColour) -> tuple[str, str]:
    match colour:
        case VertexColours():
            return "FLOAT_COLOR", COLOUR_ATTRIBUTE
        case TextureAtlas():
            return "FLOAT_VECTOR", UV_MAP
        case SourceView():
            return "FLOAT_VECTOR", PROJECTION_ATTRIBUTE


def _shade(
    nodes: Nodes,
    attribute: bpy.types.NodeSocket,
    colour: SurfaceColour,
    surface: bpy.types.Object,
    texel_share: bpy.types.Node | None,
) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
    """Colour and observed flag of a hit, as in :mod:`oneframe.blender.render.material`."""
    if isinstance(colour, VertexColours):
        channels = nodes.add("FunctionNodeSeparateColor")
        nodes.link(attribute, channels.inputs["Color"])
        return attribute, nodes.math("GREATER_THAN", channels.outputs["Alpha"], least_cover(colour))
    coordinates, depth = attribute, attribute
    if isinstance(colour, SourceView):
        separate = nodes.add("ShaderNodeSeparateXYZ")
        nodes.link(attribute, separate.inputs[0])
        depth = separate.outputs["Z"]
        coordinates = nodes.scaled(attribute, nodes.math("DIVIDE", 1.0, depth))

    name = ATLAS_IMAGE if isinstance(colour, TextureAtlas) else FRAME_IMAGE
    image = surface.data.materials[0].node_tree.nodes[name].image

    def lookup(interpolation: str) -> tuple[bpy.types.NodeSocket, bpy.types.NodeSocket]:
        node = nodes.add("GeometryNodeImageTexture", Image=image, interpolation=interpolation, extension="CLIP")
        nodes.link(coordinates, node.inputs["Vector"])
        alpha = node.outputs["Alpha"]
        if isinstance(colour, TextureAtlas):
            rgb = nodes.scaled(node.outputs["Color"], nodes.math("DIVIDE", 1.0, alpha))
            return rgb, nodes.math("GREATER_THAN", alpha, least_cover(colour))
        ratio = nodes.math("MULTIPLY", depth, alpha)
        return node.outputs["Color"], nodes.math("COMPARE", ratio, 1.0, colour.depth_tolerance)

    rgb, observed = lookup("Linear")
    if texel_share is not None:
        texel, is_same_surface = lookup("Closest")
        rgb = nodes.mixed(nodes.math("MULTIPLY", texel_share.outputs[0], is_same_surface), rgb, texel)
    return rgb, observed
