"""Overlays: structures and outlines drawn over an image, as in augmented reality.

What lies in front of the surface is solid and shaded. What the surface hides is fainter the deeper it lies below it,
and its outline is dashed. Lines have a dark rim, so that they show on bright and on dark tissue alike.
"""

from collections.abc import Sequence

import numpy as np

from .layer_stack import Colour, Layer, LayerStack, SurfaceLayer
from .strokes import coverage, dashed, line_distance

VISIBLE_OPACITY = 0.8
HIDDEN_OPACITY, DEEPEST_OPACITY = 0.5, 0.1
"""Opacity of what lies just below the surface, and of what lies :data:`DEEPEST_MM` or more below it."""
DEEPEST_MM = 10.0
DARKEST = 0.35
"""Brightness of what is seen edge-on, as a fraction of its colour."""

CONTOUR_COLOUR = (1.0, 0.85, 0.1)
CONTOUR_OPACITY, EDGE_OPACITY = 0.9, 0.55
RIM_OPACITY = 0.45
HIDDEN_LINE_OPACITY = 0.95

REFERENCE_PX = 1920
"""Width or height, whichever is greater, of an image in which the widths below hold."""
OUTLINE_PX, CONTOUR_PX, EDGE_PX, RIM_PX = 3.2, 1.8, 1.2, 1.2
THINNEST_PX = 1.6
DASH_PX, GAP_PX = 14.0, 9.0
SHORTEST_DASH_PX, SHORTEST_GAP_PX = 6.0, 4.0
SMOOTHING_PX = 2.0

LARGEST_SHIFT_PX = 0.7
"""Farthest that smoothing moves a point from the middle of its pixel's side."""

# walking to the right, down, left and up with the mask on the right-hand side: the corner that a side of the pixel
# starts at, relative to the pixel; the step to its end; and the neighbour beyond the side; all as (x, y)
_START = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
_STEP = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
_BEYOND = np.array([(0, -1), (1, 0), (0, 1), (-1, 0)])


def line_scale(shape_hw: tuple[int, int]) -> float:
    """Factor of the widths of lines in an image of this size."""
    return max(shape_hw) / REFERENCE_PX


def hidden_opacity(below_mm: np.ndarray) -> np.ndarray:
    """Opacity of what lies so many mm below the surface: it falls with the depth, down to :data:`DEEPEST_MM`."""
    fraction = np.clip(below_mm / DEEPEST_MM, 0, 1)
    return HIDDEN_OPACITY + (DEEPEST_OPACITY - HIDDEN_OPACITY) * fraction


def draw_overlay(
    image: np.ndarray,
    surface: SurfaceLayer,
    layers: Sequence[Layer],
    stack: LayerStack | None = None,
    *,
    clear: np.ndarray | None = None,
) -> np.ndarray:
    """Draw structures and the surface's contours over an image.

    Parameters
    ----------
    image
        ``(H, W, 3)`` uint8.
    surface, layers
        What to draw; nearer structures cover farther ones.
    stack
        Of these, if the caller has it.
    clear
        ``(H, W)`` bool: where anything may be drawn, or 0..1 how strongly; ``None`` for everywhere.

    Returns
    -------
    A copy, ``(H, W, 3)`` uint8.
    """
    result = np.array(image, order="C")
    canvas = _Canvas(result, clear)
    scale = line_scale((result.shape[0], result.shape[1]))
    rim = max(RIM_PX * scale, 0.8)
    for segments, width, opacity in (
        (surface.edges, EDGE_PX, EDGE_OPACITY), (surface.contour, CONTOUR_PX, CONTOUR_OPACITY),
    ):  # fmt: skip
        canvas.line(segments, max(width * scale, 0.8), rim, CONTOUR_COLOUR, opacity)
    stack = stack or LayerStack.of(surface, layers)
    for number, layer in enumerate(layers):
        canvas.fill(stack, number, layer)
    width = max(OUTLINE_PX * scale, THINNEST_PX)
    dash = max(DASH_PX * scale, SHORTEST_DASH_PX), max(GAP_PX * scale, SHORTEST_GAP_PX)
    # farther ones first
    order = sorted(range(len(layers)), key=lambda number: -_nearest(layers[number].depth_mm))
    for number in order:
        visible, hidden = outline_segments(stack, number, on_px=dash[0], off_px=dash[1], sigma_px=SMOOTHING_PX)
        canvas.line(hidden, width, rim, layers[number].colour, HIDDEN_LINE_OPACITY)
        canvas.line(visible, width, rim, layers[number].colour, 1.0)
    return result


class _Canvas:
    """An image that is drawn on, pixel by pixel where something is drawn."""

    def __init__(self, image: np.ndarray, clear: np.ndarray | None) -> None:
        self._image, self._shape = image, (image.shape[0], image.shape[1])
        self._pixels = image.reshape(-1, 3)
        self._clear = None if clear is None else clear.ravel()

    def line(self, segments: np.ndarray, width_px: float, rim_px: float, colour: Colour, opacity: float) -> None:
        """A line with a rim: one mark, however often its segments overlap."""
        if len(segments) == 0:
            return
        at, distance = line_distance(segments, self._shape, width_px / 2 + rim_px + 0.5)
        self._blend(at, np.zeros(3, np.float32), opacity * RIM_OPACITY * coverage(distance, width_px + 2 * rim_px))
        self._blend(at, np.array(colour, np.float32), opacity * coverage(distance, width_px))

    def fill(self, stack: LayerStack, number: int, layer: Layer) -> None:
        if not layer.depth_mm.size:
            return
        (x0, y0), (h, w) = layer.corner, layer.depth_mm.shape
        left, top = x0 - stack.corner[0], y0 - stack.corner[1]
        y, x = np.nonzero(stack.number[top : top + h, left : left + w] == number)
        below = stack.below_mm[y + top, x + left]
        opacity = np.where(below > 0, hidden_opacity(below), VISIBLE_OPACITY)
        light = DARKEST + (1 - DARKEST) * layer.shade[y, x]
        self._blend((y + y0) * self._shape[1] + x + x0, light[:, None] * np.array(layer.colour, np.float32), opacity)

    def _blend(self, at: np.ndarray, colour: np.ndarray, opacity: np.ndarray) -> None:
        if self._clear is not None:
            opacity = opacity * self._clear[at]
        under = self._pixels[at].astype(np.float32)
        under += opacity[:, None].astype(np.float32) * (255 * colour - under)
        self._pixels[at] = np.rint(under)


def outline_segments(
    stack: LayerStack, number: int, *, on_px: float, off_px: float, sigma_px: float
) -> tuple[np.ndarray, np.ndarray]:
    """The lines of a structure's outline: ``(N, 2, 2)`` visible ones, and the dashes of the hidden ones.

    A point is hidden if the structure is at the pixel inside it. The border of the image is no outline, and neither is
    that of a nearer structure.
    """
    corner = np.array(stack.corner)
    found: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
    for points, inner, outer in outlines(stack.number == number, sigma_px=sigma_px):
        depth, below = stack.at(inner + corner)
        beyond, _ = stack.at(outer + corner)
        end = np.roll(points, -1, axis=0)
        lengths = np.hypot(*(end - points).T)
        position = np.cumsum(lengths) - lengths
        inside = ((outer + corner >= 0) & (outer + corner < stack.shape_hw[::-1])).all(axis=1)
        own, hidden = inside & ~(beyond < depth), below > 0
        on = dashed(position + lengths / 2, float(lengths.sum()), on_px=on_px, off_px=off_px)
        segments = np.stack([points, end], axis=1) + corner
        found[0].append(segments[own & ~hidden])
        found[1].append(segments[own & hidden & on])
    empty = np.zeros((0, 2, 2))
    return np.concatenate([empty, *found[0]]), np.concatenate([empty, *found[1]])


def _nearest(depth_mm: np.ndarray) -> float:
    seen = depth_mm[depth_mm > 0]
    return float(seen.min()) if seen.size else np.inf


def outlines(mask: np.ndarray, *, sigma_px: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """All outlines of an ``(H, W)`` bool mask, of its parts and of their holes.

    Parameters
    ----------
    mask
        Pixels that touch at a corner only are apart.
    sigma_px
        Standard deviation of the smoothing along the curve. It is corrected once for what it takes away from bends
        (Taubin, "A signal processing approach to fair surface design", SIGGRAPH 1995).

    Returns
    -------
    For each a closed curve with the mask on its right, one point for each side of a pixel that it passes, from the
    highest such pixel on, so that dashes move with the mask: ``(N, 2)`` px; and ``(N, 2)`` int64 (x, y) of the pixels
    inside and outside, which may lie just outside the image.
    """
    inner, side = _sides(mask)
    following = _following(inner, side).tolist()
    curves, seen = [], bytearray(len(side))
    # every curve passes tops of pixels, which come first, row by row
    for first in range(int((side == 0).sum())):
        curve, at = [], first
        while not seen[at]:
            seen[at] = 1
            curve.append(at)
            at = following[at]
        if curve:
            pixels, beyond = inner[curve], _BEYOND[side[curve]]
            curves.append((_smoothed(pixels + 0.5 * beyond, sigma_px), pixels, pixels + beyond))
    return curves


def _sides(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sides of pixels of the mask to others: ``(S, 2)`` pixel (x, y), ``(S,)`` 0 top, 1 right, 2 bottom, 3 left."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    found = []
    for x, y in _BEYOND:
        beyond = padded[1 + y : 1 + y + height, 1 + x : 1 + x + width]
        found.append(np.stack(np.nonzero(mask & ~beyond)[::-1], axis=1))
    return np.concatenate(found), np.repeat(np.arange(4), [len(each) for each in found])


def _following(inner: np.ndarray, side: np.ndarray) -> np.ndarray:
    """``(S,)`` the side that follows each on its curve: it turns right where it can, so that corners do not connect."""
    start = inner + _START[side]
    end = start + _STEP[side]
    width, height = start.max(axis=0, initial=0) + 1
    at = np.full((4, int(width * height)), -1)
    at[side, start[:, 1] * width + start[:, 0]] = np.arange(len(side))
    place = end[:, 1] * width + end[:, 0]
    right, straight, left = (at[(side + turn) % 4, place] for turn in (1, 0, 3))
    return np.where(right >= 0, right, np.where(straight >= 0, straight, left))


def _smoothed(points: np.ndarray, sigma_px: float) -> np.ndarray:
    """Smooth a closed curve of ``(N, 2)`` points about 1 px apart."""
    curve = points[:, 0] + 1j * points[:, 1]
    frequency = 2 * np.pi * np.fft.fftfreq(len(curve))
    lost = 1 - np.exp(-0.5 * (sigma_px * frequency) ** 2)
    shift = np.fft.ifft(np.fft.fft(curve) * -(lost**2))
    length = np.abs(shift)
    shift *= np.minimum(1, LARGEST_SHIFT_PX / np.maximum(length, 1e-12))
    return points + np.stack([shift.real, shift.imag], axis=1)
