"""Operators that load frame, camera, surface, structures and pose."""

import bpy
import numpy as np
from bpy.props import EnumProperty, StringProperty

from ..class_registration import prop
from ..pipeline.blender.alignment import alignment_scene, surface_object
from ..pipeline.camera.distortion import lens_doubts
from ..pipeline.camera.intrinsics_file import read_camera
from ..pipeline.camera.plausibility import camera_doubts, fit_of
from ..pipeline.case.case_file import MM_PER_UNIT
from ..pipeline.case.surface_doubts import SizeDoubt, extents_of, place_doubt, size_doubt, size_text
from ..pipeline.case.surface_folder import RECORD, SurfaceFolder, read_surface_folder
from ..pipeline.errors import InputError
from ..pipeline.images.image_reader import read_image
from ..pipeline.poses.pose_file import read_pose
from ..pipeline.surface.mesh_reader import read_mesh
from ..pipeline.surface.structure_colour import structure_colour
from ..pipeline.volume.bone.structures import name_of_file
from ..state import frame_in_view, from_scene, to_scene
from ..state.from_scene import surface_bounds, surface_extents
from ..state.pose import set_cam_from_mesh
from ..state.properties import UNITS
from ..ui.operator import ChosenFiles, Messages, NeedsAlignment, OpensFile, Reporting

IMAGES = "*.png;*.jpg;*.jpeg"
CAMERAS = "*.json;*.toml;*.yaml;*.yml;*.txt"
POSES = "*.npy;*.txt;*.json;*.toml"
MESHES = "*.ply;*.obj;*.stl"
SURFACES = f"{MESHES};{RECORD}"


class ONEFRAME_OT_load_frame(OpensFile):
    """Load the frame: one image of the microscope"""

    bl_label = "Load Frame"

    filter_glob: str = prop(StringProperty, default=IMAGES, options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        path = self.chosen_file()
        return to_scene.set_frame(context, path, read_image(path, path.name))


class ONEFRAME_OT_load_camera(OpensFile):
    """Load K: a case file, JSON, YAML of OpenCV, ROS or Kalibr, BOP camera.json, COLMAP cameras.txt"""

    bl_label = "Load K"

    filter_glob: str = prop(StringProperty, default=CAMERAS, options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        found = read_camera(self.chosen_file())
        size = to_scene.frame_size(context.scene) or found.size
        if size is None:
            raise InputError(f"{self.filepath}: expected an image size, found none in this file; load the frame first")
        fit = fit_of(found, size)
        # of another size, the panel offers to rescale it, as it does when the frame is loaded after K
        camera = fit.camera if fit.rescaled is None or found.size is None else found.camera(found.size)
        distortion = found.distortion_for(camera)
        to_scene.set_camera(context, camera, distortion)
        return *fit.messages, *lens_doubts(distortion, camera)


class ONEFRAME_OT_set_camera(Reporting):
    """Use K as typed in the fields"""

    bl_label = "Set Camera"

    def run(self, context: bpy.types.Context) -> Messages:
        camera, distortion = to_scene.typed_camera(context.scene)
        to_scene.set_camera(context, camera, distortion)
        return *to_scene.frame_warnings(context.scene), *camera_doubts(camera), *lens_doubts(distortion, camera)


class ONEFRAME_OT_rescale_camera(Reporting):
    """Rescale K from the same picture at another resolution to the size of the frame"""

    bl_label = "Rescale K to Frame"

    def run(self, context: bpy.types.Context) -> None:
        scene = context.scene
        camera, size = from_scene.camera(scene), to_scene.frame_size(scene)
        if size is None:
            raise InputError("expected a frame, none is loaded; load the image first")
        to_scene.set_camera(context, camera.resized(*size), from_scene.distortion(scene))


class ONEFRAME_OT_load_surface(OpensFile):
    """Load the surface to align: PLY, OBJ, STL, or surface.json of oneframe surface with its structures"""

    bl_label = "Load Surface"

    filter_glob: str = prop(StringProperty, default=SURFACES, options={"HIDDEN"})
    units: str = prop(EnumProperty, "Units", "Unit of the numbers in the file", items=UNITS, default="mm")

    def run(self, context: bpy.types.Context) -> Messages:
        path = self.chosen_file()
        folder = read_surface_folder(path.parent) if path.name == RECORD else SurfaceFolder(path)
        units = "mm" if path.name == RECORD else self.units
        path = folder.mesh
        given, messages = read_mesh(path)
        mesh = given.scaled(MM_PER_UNIT[units])
        for structure in folder.structures:
            # before the scene changes
            read_mesh(structure.mesh)
        to_scene.set_surface(context, path, mesh, units, folder.focus_of(mesh))
        files = {structure.name: (structure.mesh, structure.colour) for structure in folder.structures}
        messages += to_scene.put_structures(from_scene.surface_of(context.scene), files)
        doubt = doubt_of_size(context.scene, extents_of(mesh))
        more = () if doubt is None else (doubt.message,)
        return *messages, f"{path.name}: {len(given.faces)} triangles, {size_text(extents_of(mesh))}", *more


def doubt_of_size(scene: bpy.types.Scene, extents_mm: np.ndarray) -> SizeDoubt | None:
    """Whether the sides of the surface's bounding box, ``(3,)`` mm, are implausible for its unit and K."""
    camera = None if from_scene.present_camera(scene) is None else from_scene.camera(scene)
    name = from_scene.absolute_path(from_scene.surface_of(scene).oneframe.mesh_path).name
    return size_doubt(extents_mm, scene.oneframe.units, camera, name)


class ONEFRAME_OT_change_units(Reporting):
    """Read the numbers of the meshes in another unit; landmarks and pose follow, so the picture stays the same"""

    bl_label = "Change Units"

    units: str = prop(EnumProperty, "Units", "Unit of the numbers in the file", items=UNITS)

    needs = (lambda context: from_scene.present_surface(context.scene), "Load the surface first")

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        if from_scene.surface_of(scene).mode != "OBJECT":
            raise InputError("expected Object mode; press Tab to leave Edit mode, then change the units")
        if self.units != scene.oneframe.units:
            to_scene.rescale(context, self.units)
            # until then, the object has its old bounding box
            context.evaluated_depsgraph_get()
        doubt = doubt_of_size(scene, surface_extents(scene))
        return () if doubt is None else (doubt.message,)


class ONEFRAME_OT_add_structure(ChosenFiles, OpensFile):
    """Load structures (facial nerve, ossicles, ...) given in the frame and units of the surface's file"""

    bl_label = "Add Structures"

    filter_glob: str = prop(StringProperty, default=MESHES, options={"HIDDEN"})

    needs = (
        lambda context: from_scene.present_surface(context.scene),
        "Load the surface first: structures are given in the frame and units of its file",
    )

    def run(self, context: bpy.types.Context) -> Messages:
        surface = from_scene.surface_of(context.scene)
        paths = self.chosen_files() or [self.chosen_file()]
        like = from_scene.absolute_path(surface.oneframe.mesh_path)
        read = [(path, *read_mesh(path, like=like)) for path in paths]
        offset = surface_object.mesh_from_model_of(surface)[:3, 3]
        doubts = []
        for path, given, _ in read:
            mesh = given.scaled(MM_PER_UNIT[context.scene.oneframe.units])
            doubts.append(place_doubt(mesh.bounds, surface_bounds(context.scene), path.stem, "the surface"))
            name = name_of_file(path, [child.name for child in surface.children])
            structure = alignment_scene.put_structure(surface, mesh.moved(-offset), name, structure_colour(path.stem))
            structure.oneframe.role, structure.oneframe.mesh_path = "STRUCTURE", str(path)
        return [message for *_, messages in read for message in messages] + [doubt for doubt in doubts if doubt]


class ONEFRAME_OT_load_pose(OpensFile):
    """Load cam_from_mesh for the frame of the mesh file (NumPy as written by Vision6D, text, JSON, a case file)"""

    bl_label = "Load Pose"

    filter_glob: str = prop(StringProperty, default=POSES, options={"HIDDEN"})

    def run(self, context: bpy.types.Context) -> Messages:
        frame_in_view.check_own(context.scene)
        cam_from_mesh, message = read_pose(self.chosen_file())
        set_cam_from_mesh(context.scene, cam_from_mesh)
        return (message,) if message else ()


class ONEFRAME_OT_remove_scale(NeedsAlignment, Reporting):
    """Remove scale, shear and mirroring from the surface: a pose is a rotation and a translation only"""

    bl_label = "Remove Scale"

    def run(self, context: bpy.types.Context) -> None:
        surface_object.make_rigid(from_scene.camera_object_of(context.scene), from_scene.surface_of(context.scene))
