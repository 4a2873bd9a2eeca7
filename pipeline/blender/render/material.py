"""Surface colour as emission: the three colour modes as shader nodes, each with its observed flag.

All modes compute two values, a colour and a flag that is 1 where the frame saw the shaded point. The surface emits the
colour, or that of unseen surface where the flag is 0; the flag goes to the pass :data:`OBSERVED_PASS`. There is no
light, so renders show the code values unchanged. Back sides are never observed.

The flag is the rule of :mod:`oneframe.colour.source_view` at the shaded point, in all modes. In the baked ones, the
lookup must also find colour: a texel that the frame saw, or three vertices with a colour from it.
"""

import bpy
import numpy as np

from ...colour.shading import SurfaceColour
from ...colour.source_view import SourceView
from ...colour.texture_atlas import COVERED_LEAST, TextureAtlas
from ...colour.vertex_colours import NEUTRAL, VertexColours
from ...surface.mesh import TriangleMesh
from ...transforms import transform_points
from ..bridge.data_blocks import set_corner_uv, set_corner_vectors, set_vertex_colors
from ..bridge.image import new_float_image
from ..bridge.node_tree import Nodes
from ..bridge.versions import new_node_material

OBSERVED_PASS = "observed"
COLOUR_ATTRIBUTE = "frame_colour"
UNSEEN_ATTRIBUTE = "frame_unseen_colour"
UV_MAP = "frame_uv"
PROJECTION_ATTRIBUTE = "frame_projection"
FILTER_LOOKUPS = tuple((f"filter offset {number}", f"filter image {number}") for number in range(4))
"""Names of the shader's image nodes, and of what moves the filter's lookups, see :func:`assign_colour`."""
OBSERVED_LEAST = 0.9999
"""If an interpolated flag is at least this large, all values that it was interpolated from are observed."""
NEUTRAL_RGBA = (NEUTRAL, NEUTRAL, NEUTRAL, 1.0)
_NOWHERE = (-1.0, -1.0, 1.0)  # projects outside the frame


def assign_colour(
    mesh_object: bpy.types.Object,
    mesh: TriangleMesh,
    colour: SurfaceColour | None,
    *,
    unseen: np.ndarray | None = None,
    filtered: bool = False,
) -> None:
    """Give the object the material of a colour mode.

    Parameters
    ----------
    mesh_object, mesh
        The surface as a Blender object and as a mesh (model frame).
    colour
        ``None`` makes it plain neutral, for geometry alone; the observed flag is then 1 on front sides.
    unseen
        ``(V, 3)`` code values 0..1 of the vertices, shown where the frame saw nothing; ``None``: :data:`NEUTRAL_RGBA`.
    filtered
        Take colours (not the observed flag) as the mean of four lookups, nodes :data:`FILTER_LOOKUPS`, for which the
        caller sets images and offsets, see :mod:`oneframe.colour.footprint_filter`. The alpha of the first is added to
        the flag of observed points. Ignored for vertex colours, which have no image.
    """
    material = new_node_material("surface")
    nodes = Nodes(material.node_tree)
    match colour:
        case None:
            rgb, flag, addition = None, 1.0, None
        case VertexColours():
            rgb, flag, addition = _vertex_colour(nodes, mesh_object, mesh, colour)
        case TextureAtlas():
            rgb, flag, addition = _texture(nodes, mesh_object, mesh, colour, filtered)
        case SourceView():
            rgb, flag, addition = _projection(nodes, mesh_object, mesh, colour, filtered)
    geometry = nodes.add("ShaderNodeNewGeometry")
    flag = nodes.math("GREATER_THAN", flag, geometry.outputs["Backfacing"])
    observed_pass = nodes.add("ShaderNodeOutputAOV", aov_name=OBSERVED_PASS)
    passed = flag if addition is None else nodes.math("MULTIPLY_ADD", flag, addition, flag)
    nodes.link(passed, observed_pass.inputs["Value"])
    emission = nodes.add("ShaderNodeEmission", Color=NEUTRAL_RGBA)
    if rgb is not None:
        other: tuple | bpy.types.NodeSocket = NEUTRAL_RGBA
        if unseen is not None:
            set_vertex_colors(mesh_object, UNSEEN_ATTRIBUTE, np.pad(unseen, ((0, 0), (0, 1)), constant_values=1))
            other = nodes.add("ShaderNodeAttribute", attribute_name=UNSEEN_ATTRIBUTE).outputs["Color"]
        nodes.link(nodes.mixed(flag, other, rgb), emission.inputs["Color"])
    output = nodes.add("ShaderNodeOutputMaterial")
    nodes.link(emission.outputs["Emission"], output.inputs["Surface"])
    # else Cycles builds a light distribution over all triangles and samples it
    material.cycles.emission_sampling = "NONE"
    mesh_object.data.materials.clear()
    mesh_object.data.materials.append(material)


def _vertex_colour(nodes: Nodes, mesh_object: bpy.types.Object, mesh: TriangleMesh, colour: VertexColours) -> tuple:
    set_vertex_colors(mesh_object, COLOUR_ATTRIBUTE, np.concatenate([colour.rgb, colour.least[:, None]], axis=1))
    attribute = nodes.add("ShaderNodeAttribute", attribute_name=COLOUR_ATTRIBUTE)
    rgb, cover = attribute.outputs["Color"], attribute.outputs["Alpha"]
    return rgb, _flag(nodes, cover, mesh_object, mesh, colour), None


def _texture(
    nodes: Nodes, mesh_object: bpy.types.Object, mesh: TriangleMesh, atlas: TextureAtlas, filtered: bool
) -> tuple:
    set_corner_uv(mesh_object, UV_MAP, atlas.uv)
    uv = nodes.add("ShaderNodeUVMap", uv_map=UV_MAP)
    image = new_float_image("frame_atlas", atlas.premultiplied())
    rgb, cover, addition = _image_lookup(nodes, image, uv.outputs["UV"], filtered)
    if not filtered:
        rgb = nodes.scaled(rgb, nodes.math("DIVIDE", 1.0, cover))
    return rgb, _flag(nodes, cover, mesh_object, mesh, atlas), addition


def _flag(
    nodes: Nodes,
    cover: bpy.types.NodeSocket,
    mesh_object: bpy.types.Object,
    mesh: TriangleMesh,
    colour: VertexColours | TextureAtlas,
) -> bpy.types.NodeSocket:
    """1 where the lookup is covered and the reference view saw the shaded point, else 0."""
    is_premultiplied = isinstance(colour, TextureAtlas) and colour.source is not None
    covered = nodes.math("GREATER_THAN", cover, COVERED_LEAST if is_premultiplied else OBSERVED_LEAST)
    if colour.source is None:
        return covered
    _, seen, _ = _projection(nodes, mesh_object, mesh, colour.source, filtered=False)
    return nodes.math("MULTIPLY", covered, seen)


def _projection(
    nodes: Nodes, mesh_object: bpy.types.Object, mesh: TriangleMesh, source: SourceView, filtered: bool
) -> tuple:
    """The pinhole projection per shaded point, and the rule of :mod:`oneframe.colour.source_view`.

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
    image, surface = source.continued
    rgba = np.concatenate([image, surface[..., None]], axis=2)

    homogeneous = nodes.add("ShaderNodeAttribute", attribute_name=PROJECTION_ATTRIBUTE).outputs["Vector"]
    separate = nodes.add("ShaderNodeSeparateXYZ")
    nodes.link(homogeneous, separate.inputs[0])
    depth = separate.outputs["Z"]
    pixel = nodes.scaled(homogeneous, nodes.math("DIVIDE", 1.0, depth))
    rgb, inverse_depth, addition = _image_lookup(nodes, new_float_image("frame", rgba), pixel, filtered)
    ratio = nodes.math("MULTIPLY", depth, inverse_depth)
    return rgb, nodes.math("COMPARE", ratio, 1.0, source.depth_tolerance), addition


def _image_lookup(nodes: Nodes, image: bpy.types.Image, coordinates: bpy.types.NodeSocket, filtered: bool) -> tuple:
    """Colour and alpha of an image (alpha is 0 outside it), and the alpha of the first filtered one or ``None``."""
    exact = nodes.add("ShaderNodeTexImage", image=image, interpolation="Linear", extension="CLIP")
    nodes.link(coordinates, exact.inputs["Vector"])
    if not filtered:
        return exact.outputs["Color"], exact.outputs["Alpha"], None
    lookups = []
    for offset_name, image_name in FILTER_LOOKUPS:
        moved = nodes.add("ShaderNodeVectorMath", name=offset_name, operation="ADD")
        nodes.link(coordinates, moved.inputs[0])
        lookup = nodes.add(
            "ShaderNodeTexImage", name=image_name, image=image, interpolation="Linear", extension="EXTEND"
        )
        nodes.link(moved.outputs["Vector"], lookup.inputs["Vector"])
        lookups.append(lookup)
    mean = nodes.scaled(nodes.added(*(lookup.outputs["Color"] for lookup in lookups)), 0.25)
    return mean, exact.outputs["Alpha"], lookups[0].outputs["Alpha"]
