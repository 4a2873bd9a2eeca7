"""The coloured surface as a file for other programs: GLB, OBJ or PLY, with a texture or vertex colours.

PLY and OBJ keep the coordinates and units of the user's mesh; GLB is in metres with y up, as glTF requires.
"""

import io
import re
from collections.abc import Mapping
from contextlib import redirect_stderr
from pathlib import Path
from typing import Literal

import bpy
import numpy as np

from ...case.loaded_case import LoadedCase
from ...colour.reference_view import baked_colour_of, reference_view, unseen_colours_of
from ...colour.texture_atlas import TextureAtlas
from ...colour.vertex_colours import VertexColours
from ...errors import InputError
from ...files.outputs import check_outputs, made_folder, write_output, writing
from ...files.temporary import temporary_folder, unwritable_temporary, writing_temporary
from ...images.pixel_values import linear_from_codes, to_uint8
from ...images.png import encode_png
from ...process.own_process import delayed_interrupts
from ...surface.mesh import TriangleMesh
from ...surface.mesh_reader import stated_space
from ...surface.mesh_writer import material_path, texture_path, write_obj, write_ply
from ..bridge.data_blocks import new_mesh_object, set_corner_uv, set_vertex_colors, temporary_data
from ..bridge.versions import new_node_material

FORMATS = (".glb", ".obj", ".ply")


def check_export(path: Path, inputs: Mapping[str, Path], *, colour: str) -> None:
    """Check before any work that the coloured surface can be written, with the files that go with it.

    ``inputs`` are files that must not be replaced, by what they are.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(f"{path}: expected a file name that ends in {', '.join(FORMATS)}, found {path.suffix!r}")
    if colour not in ("texture", "vertex") or (suffix == ".obj" and colour == "vertex"):
        raise InputError(f"{path}: a {suffix} file cannot hold {colour} colours; use texture")
    outputs = [path]
    if colour == "texture" and suffix != ".glb":
        outputs.append(texture_path(path))
    if suffix == ".obj":
        outputs.append(material_path(path))
    check_outputs(outputs, inputs)


def export_coloured_surface(
    loaded: LoadedCase, path: Path, *, colour: Literal["texture", "vertex"], unseen: str = "neutral"
) -> list[str]:
    """Write the surface with the frame's colours; an OBJ or a textured PLY gets its image in the same folder.

    Parameters
    ----------
    loaded
        The case.
    path
        ``.glb``, ``.obj`` or ``.ply``.
    colour
        ``"texture"`` or ``"vertex"`` (not for OBJ, which has no vertex colours).
    unseen
        What the frame did not see: ``"neutral"`` or ``"fill"``.

    Returns
    -------
    Messages for the user: resolution and coverage.
    """
    check_export(path, loaded.case.input_files(), colour=colour)
    suffix = path.suffix.lower()
    reference = reference_view(loaded)
    filled = unseen_colours_of(reference, unseen)
    surface_colour, messages = baked_colour_of(reference, colour, unseen=filled)
    given = reference.mesh.moved(loaded.surface.mesh_from_model[:3, 3])
    made_folder(path)
    if suffix == ".glb":
        data = _glb(given.scaled(1e-3), surface_colour)
        write_output(path, data)
        return [*reference.messages, *messages]
    given = given.scaled(1 / loaded.case.mm_per_unit)
    space = stated_space(loaded.case.mesh) if suffix == ".ply" else None
    if isinstance(surface_colour, TextureAtlas):
        picture = texture_path(path)
        write_output(picture, encode_png(to_uint8(surface_colour.image)))
        uv, texture = surface_colour.uv, picture.name
        with writing(path):
            if suffix == ".obj":
                write_obj(path, given, uv=uv, texture=texture)
            else:
                # for readers that know no textures in a PLY
                vertices, _ = baked_colour_of(reference, "vertex", unseen=filled)
                colours = to_uint8(vertices.rgb)  # type: ignore[union-attr]  # vertex colours
                write_ply(
                    path, given, colours=colours, normals=given.vertex_normals, uv=uv, texture=texture, space=space
                )
    else:
        with writing(path):
            colours = to_uint8(surface_colour.rgb)
            write_ply(path, given, colours=colours, normals=given.vertex_normals, space=space)
    return [*reference.messages, *messages]


def _glb(mesh: TriangleMesh, colour: VertexColours | TextureAtlas) -> bytes:
    """The file of Blender's glTF exporter, from a temporary scene; the material is unlit: colours as recorded."""
    with temporary_data(), temporary_folder() as folder:
        scene = bpy.data.scenes.new("oneframe export")
        surface = new_mesh_object("surface", mesh)
        scene.collection.objects.link(surface)
        surface.data.materials.append(_unlit_material(surface, colour, folder))
        path = folder / "surface.glb"
        try:
            with (
                bpy.context.temp_override(scene=scene, view_layer=scene.view_layers[0]),
                delayed_interrupts(),
                # where Blender prints the exporter's traceback
                redirect_stderr(io.StringIO()),
            ):
                bpy.ops.export_scene.gltf(
                    filepath=str(path),
                    export_format="GLB",
                    use_active_scene=True,
                    export_vertex_color="ACTIVE",
                    export_yup=True,
                )
            return path.read_bytes()
        except (RuntimeError, OSError) as error:
            if not (reason := re.search(r"\[Errno \d+\] ([^\n:]*)", str(error))):
                raise
            raise unwritable_temporary(reason[1]) from None


def _unlit_material(
    surface: bpy.types.Object, colour: VertexColours | TextureAtlas, folder: Path
) -> bpy.types.Material:
    material = new_node_material("frame")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    if isinstance(colour, TextureAtlas):
        set_corner_uv(surface, "UVMap", colour.uv)
        file = folder / "frame.png"
        with writing_temporary():
            file.write_bytes(encode_png(to_uint8(colour.image)))
        node = nodes.new("ShaderNodeTexImage")
        node.image = bpy.data.images.load(str(file))
        node.image.pack()
    else:
        # glTF stores linear vertex colours, the frame's code values are sRGB
        rgba = np.concatenate([linear_from_codes(colour.rgb), np.ones((len(colour.rgb), 1))], axis=1)
        set_vertex_colors(surface, "Color", rgba)
        node = nodes.new("ShaderNodeVertexColor")
        node.layer_name = "Color"
    # the exporter writes a background shader as an unlit material
    unlit, output = nodes.new("ShaderNodeBackground"), nodes.new("ShaderNodeOutputMaterial")
    links.new(node.outputs["Color"], unlit.inputs["Color"])
    links.new(unlit.outputs["Background"], output.inputs["Surface"])
    return material
