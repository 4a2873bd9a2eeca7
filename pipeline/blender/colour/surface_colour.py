"""The frame's colours on the user's surface object, for the viewport, the editors and other add-ons.

Vertex colours become a point colour attribute; a texture becomes a UV map and an image packed into the .blend file. A
material shows either without light. Blender stores colours as linear values except in 8-bit images, so code values are
converted: under the view transform Standard the screen shows the frame's own values.

The object itself stores a record of its colours, including their pose, and the material that it had before.
"""

import json
from collections.abc import Mapping

import bpy
import numpy as np

from ...colour.reference_view import ReferenceView
from ...colour.texture_atlas import TextureAtlas
from ...colour.vertex_colours import OBSERVED_LEAST, VertexColours, colour_vertices
from ...images.masked_frame import UNSEEN
from ...images.pixel_values import linear_from_codes, to_uint8
from ...images.png import encode_png
from ...surface.mesh import TriangleMesh
from ..bridge.data_blocks import set_corner_uv, set_vertex_colors
from ..bridge.image import new_packed_image
from ..bridge.node_tree import Nodes
from ..bridge.versions import new_node_material
from ..render.material import COLOUR_ATTRIBUTE

OBSERVED_ATTRIBUTE = "frame_observed"
"""Boolean attribute of the vertices: whether the frame saw them."""
MATERIAL, TEXTURE = "OneFrame colour", "OneFrame texture"
RECORD, PLAIN_MATERIAL = "oneframe_colour", "oneframe_plain_material"
"""Custom properties of the object: the record of its colours (JSON), and its material before."""
COLOUR_NODE, UV_MAP = "frame", "frame_uv"


def put_colour(
    surface: bpy.types.Object,
    mesh: TriangleMesh,
    reference: ReferenceView,
    colour: VertexColours | TextureAtlas,
    *,
    record: Mapping[str, object],
    vertices: VertexColours | None = None,
) -> None:
    """Colour an object; replaces colours that this function gave it before.

    Parameters
    ----------
    surface
        The object, in Object mode; its mesh has the vertices and faces of ``mesh``, in that order.
    mesh
        The surface as loaded; the faces of ``reference.mesh`` may be flipped relative to it.
    reference, colour
        The reference view, and the colours made from it.
    record
        What to store with the colours, JSON types; ``mode`` is added.
    vertices
        The colours of the vertices if they are known already; a textured surface has them too.
    """
    remove_colour(surface)
    flipped = reference.mesh.faces is not mesh.faces and not np.array_equal(reference.mesh.faces, mesh.faces)
    textured = isinstance(colour, TextureAtlas)
    # in addition to a texture: for attribute colours in Solid mode and for lookups of a vertex's colour
    if isinstance(colour, VertexColours):
        vertices = colour
    elif vertices is None:
        vertices = colour_vertices(reference.mesh, reference.views)
    _set_colour_attribute(surface, vertices)
    material = _textured(surface, colour, flipped) if isinstance(colour, TextureAtlas) else _vertex_coloured(flipped)
    flags = surface.data.attributes.new(OBSERVED_ATTRIBUTE, "BOOLEAN", "POINT")
    flags.data.foreach_set("value", np.ascontiguousarray(vertices.observed))
    material.cycles.emission_sampling = "NONE"
    if not surface.data.materials:
        surface.data.materials.append(None)
    plain = surface.data.materials[0]
    if plain is not None:
        surface[PLAIN_MATERIAL] = plain
    surface.data.materials[0] = material
    surface[RECORD] = json.dumps({**record, "mode": "texture" if textured else "vertex"})
    surface.data.update()


def remove_colour(surface: bpy.types.Object) -> None:
    """Remove everything that :func:`put_colour` added; restores the object's material."""
    data = surface.data
    for name in (COLOUR_ATTRIBUTE, OBSERVED_ATTRIBUTE, UV_MAP):
        attribute = data.attributes.get(name)
        if attribute is not None:
            data.attributes.remove(attribute)
    plain = surface.get(PLAIN_MATERIAL)
    own = _own_materials(surface)
    for number, material in enumerate(data.materials):
        if material in own:
            data.materials[number] = plain
    # also materials left over from deleted surfaces
    _remove_unused([material for material in bpy.data.materials if material.get(RECORD)])
    for name in (RECORD, PLAIN_MATERIAL):
        if name in surface:
            del surface[name]
    data.update()


def colour_record(surface: bpy.types.Object) -> dict | None:
    """The record stored with an object's colours; ``None`` for a plain object."""
    text = surface.get(RECORD)
    if not isinstance(text, str):
        return None
    try:
        record = json.loads(text)
    except ValueError:
        return None
    return record if isinstance(record, dict) else None


def _set_colour_attribute(surface: bpy.types.Object, colour: VertexColours) -> None:
    codes = np.where(colour.observed[:, None], colour.rgb, UNSEEN)
    rgba = np.concatenate([linear_from_codes(codes), colour.observed[:, None]], axis=1)
    set_vertex_colors(surface, COLOUR_ATTRIBUTE, rgba)
    attributes = surface.data.color_attributes
    attributes.active_color_name = COLOUR_ATTRIBUTE
    attributes.render_color_index = attributes.active_color_index


def _vertex_coloured(flipped: bool) -> bpy.types.Material:
    material, nodes = _new_material()
    attribute = nodes.add("ShaderNodeAttribute", name=COLOUR_NODE, attribute_name=COLOUR_ATTRIBUTE)
    # a point is observed if all three vertices of its triangle are
    observed = nodes.math("GREATER_THAN", attribute.outputs["Alpha"], OBSERVED_LEAST)
    _emit(material, nodes, attribute.outputs["Color"], observed, flipped)
    return material


def _textured(surface: bpy.types.Object, atlas: TextureAtlas, flipped: bool) -> bpy.types.Material:
    # flipped faces have their corners in the opposite order
    set_corner_uv(surface, UV_MAP, atlas.uv[:, ::-1] if flipped else atlas.uv)
    layer = surface.data.uv_layers[UV_MAP]
    layer.active = layer.active_render = True
    codes = np.where(atlas.observed[..., None], atlas.image, np.array(UNSEEN, np.float32))
    image = new_packed_image(TEXTURE, encode_png(to_uint8(codes)), width=codes.shape[1], height=codes.shape[0])
    material, nodes = _new_material()
    uv = nodes.add("ShaderNodeUVMap", uv_map=UV_MAP)
    shown = nodes.add("ShaderNodeTexImage", name=COLOUR_NODE, image=image, extension="EXTEND")
    nodes.link(uv.outputs["UV"], shown.inputs["Vector"])
    # the node that Solid mode shows with texture colours
    material.node_tree.nodes.active = shown
    _emit(material, nodes, shown.outputs["Color"], 1.0, flipped)
    return material


def _new_material() -> tuple[bpy.types.Material, Nodes]:
    material = new_node_material(MATERIAL)
    material[RECORD] = True
    return material, Nodes(material.node_tree)


def _emit(
    material: bpy.types.Material,
    nodes: Nodes,
    colour: bpy.types.NodeSocket,
    observed: bpy.types.NodeSocket | float,
    flipped: bool,
) -> None:
    """Make the material emit the colour; back sides, which the frame never saw, emit that of unseen surface."""
    backfacing = nodes.add("ShaderNodeNewGeometry").outputs["Backfacing"]
    front = nodes.math("MULTIPLY", backfacing, 1.0) if flipped else nodes.math("SUBTRACT", 1.0, backfacing)
    flag = nodes.math("MULTIPLY", front, observed)
    mixed = nodes.mixed(flag, (*linear_from_codes(np.array(UNSEEN)), 1.0), colour)
    emission, output = nodes.add("ShaderNodeEmission"), nodes.add("ShaderNodeOutputMaterial")
    nodes.link(mixed, emission.inputs["Color"])
    nodes.link(emission.outputs["Emission"], output.inputs["Surface"])


def _own_materials(surface: bpy.types.Object) -> list[bpy.types.Material]:
    return [material for material in surface.data.materials if material is not None and material.get(RECORD)]


def _remove_unused(materials: list[bpy.types.Material]) -> None:
    """Remove materials that nothing uses, and their images."""
    for material in {m for m in materials if m.users == 0}:
        images = [node.image for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeTexImage"]
        bpy.data.materials.remove(material)
        bpy.data.batch_remove([image for image in images if image is not None and image.users == 0])
