"""Where a surface was wrong, as colours and as a picture to judge it by."""

import cv2
import numpy as np

from ..case.loaded_case import LoadedCase
from ..images.contact_sheet import contact_sheet
from ..images.legend import Write, put_border
from ..images.pixel_values import to_uint8
from ..projection.z_buffer import rasterise_depth
from .correct_surface import SurfaceCorrection
from .surface_check import FARTHER, NEARER

TILE_PX = 800
NOTHING, UNCONFIRMED = (0.93, 0.93, 0.93), (0.45, 0.45, 0.45)
AMBIENT = 0.4
"""Share of the light that does not depend on the slope."""


def most_of(found: SurfaceCorrection) -> float:
    """The deviation, mm, from which on the colour is full: few vertices are farther off."""
    moved_mm = np.abs(found.deviation_mm[found.moved])
    return max(2 * found.floor_mm, float(np.quantile(moved_mm, 0.98)) if len(moved_mm) else 0.0)


def deviation_colours(found: SurfaceCorrection) -> np.ndarray:
    """``(V, 3)`` 0..1: the colours of the vertices; what means nothing has none."""
    off_mm, floor_mm = found.deviation_mm, found.floor_mm
    share = np.clip((np.abs(off_mm) - floor_mm) / (most_of(found) - floor_mm), 0, 1)[:, None]
    colours = NOTHING + share * (np.where(off_mm[:, None] > 0, NEARER, FARTHER) - np.array(NOTHING))
    colours[~found.confirmed] = UNCONFIRMED
    return colours


def deviation_map(loaded: LoadedCase, found: SurfaceCorrection, write: Write) -> np.ndarray:
    """``(H, W, 3)`` uint8: the case's frame, and its surface in the colours of the deviation, side by side."""
    frame, mesh = loaded.frame, found.mesh
    camera = frame.camera.resized(TILE_PX, round(TILE_PX * frame.camera.height / frame.camera.width))
    colours = deviation_colours(found)
    face = rasterise_depth(mesh, camera, frame.cam_from_model).face
    shown = face[face >= 0]
    shade = AMBIENT + (1 - AMBIENT) * np.abs(mesh.face_normals[shown] @ frame.cam_from_model[2, :3])
    tile = np.zeros((*camera.shape_hw, 3))
    tile[face >= 0] = colours[mesh.faces[shown]].mean(axis=1) * shade[:, None]
    picture = to_uint8(tile)
    words = (
        f"red: moved towards the lens, {most_of(found):.1f} mm and more; blue: away; white: less than "
        f"{found.floor_mm:.2f} mm; grey: not confirmed. Not for surgery"
    )
    put_border(picture, (255, 255, 255), words, write)
    own = cv2.resize(frame.image, camera.size_wh, interpolation=cv2.INTER_AREA)
    return to_uint8(contact_sheet([own, picture.astype(np.float32) / 255], columns=2, tile_width=TILE_PX))
