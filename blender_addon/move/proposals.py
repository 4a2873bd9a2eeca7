"""Poses proposed from the frame alone: a search in the background, three pictures to choose from, no click needed."""

from dataclasses import dataclass
from typing import Any

import bpy
import bpy.utils.previews
import cv2
import numpy as np
from bpy.props import IntProperty

from ..class_registration import at_end, prop
from ..pipeline.alignment.proposal.propose import Proposal, propose_poses
from ..pipeline.case.alignment_record import PROPOSED
from ..pipeline.case.frame import PosedFrame
from ..pipeline.errors import InputError
from ..pipeline.projection.z_buffer import rasterise_depth
from ..pipeline.surface.mesh import TriangleMesh
from ..state import another_frame, from_scene, pose_evidence
from ..state.pose import set_cam_from_model
from ..ui.background_operator import InBackground, Work
from ..ui.operator import Messages, NeedsAlignment, Reporting

PICTURE_PX = 256
"""The longer side of a picture."""
OPACITY, SURFACE_COLOUR = 0.75, np.array([1.0, 0.8, 0.35], np.float32)
"""Of the surface in it."""


@dataclass(frozen=True)
class Proposals:
    """What a search has found, the best first: poses, icons of their pictures, and what it was found for."""

    poses: tuple[Proposal, ...]
    icons: tuple[int, ...]
    inputs: tuple[object, ...]


_found: Proposals | None = None
_pictures: Any = None
"""A collection of previews, once there are proposals."""


def found(scene: bpy.types.Scene) -> Proposals | None:
    """The latest proposals, if they are for this frame, K and surface.

    Raises
    ------
    InputError
        There is no camera or surface.
    """
    return _found if _found is not None and _found.inputs == _inputs(scene) else None


class ONEFRAME_OT_propose_poses(NeedsAlignment, InBackground):
    """Search all poses for the three that explain the frame best, without a click; for light at the lens"""

    bl_label = "Propose Poses"
    doing = "Searching all poses"

    def work(self, context: bpy.types.Context) -> Work:
        loaded = from_scene.loaded_case(context.scene, aligned=False)
        self._searched = _inputs(context.scene)
        frame, mesh = loaded.frame, loaded.surface.mesh

        def search(progress: Any) -> tuple[tuple[Proposal, ...], list[np.ndarray]]:
            poses = propose_poses(frame.image, frame.valid, frame.camera, mesh, progress=progress)
            return poses, [_picture(frame, mesh, each.cam_from_model) for each in poses]

        return search

    def finish(self, context: bpy.types.Context, result: Any) -> Messages:
        poses, pictures = result
        if self._searched != _inputs(context.scene):
            raise InputError("the frame, K or the surface has changed meanwhile, nothing was done; start again")
        if not poses:
            raise InputError("no pose was found, the frame shows no detail; drag pins instead")
        _keep(poses, pictures, self._searched)
        return (f"{len(poses)} poses proposed: choose one in the panel Move, then refine it",)


class ONEFRAME_OT_take_proposal(NeedsAlignment, Reporting):
    """Move the surface to this proposed pose; nothing has verified it yet"""

    bl_label = "Take Proposed Pose"

    index: int = prop(IntProperty, "Index", "Which of the proposals, the best is 0", min=0)

    def run(self, context: bpy.types.Context) -> Messages:
        scene = context.scene
        another_frame.check_own(scene)
        proposals = found(scene)
        if proposals is None or self.index >= len(proposals.poses):
            raise InputError("expected a proposed pose of this frame, found none; press Propose Poses")
        chosen = proposals.poses[self.index]
        set_cam_from_model(scene, chosen.cam_from_model)
        record: dict[str, object] = {"method": PROPOSED, "explained": chosen.explained}
        pose_evidence.remember(scene, record, chosen.cam_from_model)
        return (f"proposed pose {self.index + 1}: explains {chosen.explained:.0%} of the image; refine it",)


def _inputs(scene: bpy.types.Scene) -> tuple[object, ...]:
    surface, settings = from_scene.surface_of(scene), scene.oneframe
    mesh = surface.oneframe.mesh_path, len(surface.data.vertices), settings.units
    return (*mesh, settings.frame_path, from_scene.camera(scene))


def _picture(frame: PosedFrame, mesh: TriangleMesh, cam_from_model: np.ndarray) -> np.ndarray:
    """``(h, w, 3)`` float32: the frame, small, under the shaded surface at a pose."""
    factor = min(PICTURE_PX / max(frame.camera.size_wh), 1.0)
    camera = frame.camera.resized(*(max(round(side * factor), 1) for side in frame.camera.size_wh))
    picture = cv2.resize(frame.image, camera.size_wh, interpolation=cv2.INTER_AREA)
    face = rasterise_depth(mesh, camera, cam_from_model).face
    normal = mesh.face_cross @ cam_from_model[:3, :3].T
    shade = np.abs(normal[:, 2]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)
    seen = face >= 0
    picture[seen] = (1 - OPACITY) * picture[seen] + OPACITY * shade[face[seen], None] * SURFACE_COLOUR
    return picture


def _keep(poses: tuple[Proposal, ...], pictures: list[np.ndarray], inputs: tuple[object, ...]) -> None:
    global _found, _pictures
    _forget()
    _pictures = bpy.utils.previews.new()
    icons = []
    for number, picture in enumerate(pictures):
        preview = _pictures.new(str(number))
        rgba = np.ones((*picture.shape[:2], 4), np.float32)
        rgba[..., :3] = picture[::-1]
        preview.image_size = picture.shape[1::-1]
        preview.image_pixels_float.foreach_set(rgba.ravel())
        icons.append(preview.icon_id)
    _found = Proposals(poses, tuple(icons), inputs)


def _forget() -> None:
    global _found, _pictures
    if _pictures is not None:
        bpy.utils.previews.remove(_pictures)
    _found = _pictures = None


PARTS = (at_end(_forget),)
