"""Lines of text as masks, in the font that comes with Blender: of any size, with the letters of most languages."""

from dataclasses import dataclass
from functools import lru_cache

import bpy
import numpy as np

from ...kernels.nearest_face import nearest_at_centres

SAMPLES = 4
"""Samples of a pixel along each side."""

ASCENT, DESCENT = 0.92, 0.25
"""Above and below the base line, of the size."""

_BEARING = "H"
"""A letter that others are measured against: blanks have no outline of their own."""


@dataclass(frozen=True)
class _Glyph:
    """Triangles ``(T, 3, 2)`` with the base line at 0 and y upwards, and the way to the next letter, of size 1."""

    triangles: np.ndarray
    advance: float


@lru_cache(maxsize=512)
def text_mask(text: str, size_px: float) -> np.ndarray:
    """How much of each pixel the letters of a line cover.

    Letters that Blender's font does not have become boxes; ``size_px`` is about 1.4 times the height of capitals.

    Returns
    -------
    ``(h, w)`` float32 0..1 with the base line :data:`ASCENT` ``* size_px`` below the top; not to be written to.
    """
    x, parts = 0.0, []
    for letter in text:
        glyph = _glyph(letter)
        parts.append(glyph.triangles + np.array([x, 0.0]))
        x += glyph.advance
    height, width = int(np.ceil((ASCENT + DESCENT) * size_px)), max(int(np.ceil(x * size_px)), 1) + 1
    triangles = np.concatenate([np.zeros((0, 3, 2)), *parts])
    # the centre of the first sample is at 0
    u = triangles[..., 0] * size_px * SAMPLES - 0.5
    v = (ASCENT - triangles[..., 1]) * size_px * SAMPLES - 0.5
    points = np.stack([u, v, np.ones_like(u), u, v], axis=-1).reshape(-1, 5)
    covered = np.zeros((height * SAMPLES, width * SAMPLES))
    nearest_at_centres(points, np.arange(len(points)).reshape(-1, 3), covered, np.zeros(covered.shape, np.int64))
    mask = (covered > 0).astype(np.float32).reshape(height, SAMPLES, width, SAMPLES).mean(axis=(1, 3))
    mask.setflags(write=False)
    return mask


@lru_cache(maxsize=4096)
def _glyph(letter: str) -> _Glyph:
    measured = _outline(_BEARING + letter + _BEARING)[..., 0].max() - _outline(_BEARING * 2)[..., 0].max()
    return _Glyph(_outline(letter), max(float(measured), 0.0))


def _outline(text: str) -> np.ndarray:
    """``(T, 3, 2)`` triangles of a text of size 1."""
    curve = bpy.data.curves.new("oneframe text", "FONT")
    holder = bpy.data.objects.new("oneframe text", curve)
    try:
        # printable letters only: a line break would move the rest
        curve.body = text if text.isprintable() else "?"  # type: ignore[attr-defined]
        curve.resolution_u = 4
        mesh = holder.to_mesh()
        mesh.calc_loop_triangles()
        vertices = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", vertices)
        faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", faces)
        holder.to_mesh_clear()
    finally:
        bpy.data.objects.remove(holder)
        bpy.data.curves.remove(curve)
    return vertices.reshape(-1, 3)[faces.reshape(-1, 3), :2].astype(np.float64)
