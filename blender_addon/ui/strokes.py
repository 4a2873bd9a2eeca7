"""Lines and texts over a 3D view, readable on any picture: each has a dark background."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix

Colour = tuple[float, float, float, float]

HALO: Colour = (0.0, 0.0, 0.0, 0.65)
HALO_PX = 1.6
"""Colour of the dark line under each line, and how far it extends on either side."""

FONT = 0
TEXT_SIZE = 12
TEXT_BACKGROUND: Colour = (0.04, 0.04, 0.04, 0.72)


@dataclass
class Strokes:
    """Collects lines and texts in region pixels; :meth:`draw` draws them from a POST_PIXEL handler.

    Lengths and widths on the screen do not depend on the zoom; :attr:`unit` is one pixel at interface scale 1.
    """

    unit: float = field(default_factory=lambda: bpy.context.preferences.system.ui_scale)
    _lines: dict[float, list[tuple[np.ndarray, Colour]]] = field(default_factory=dict)
    _texts: list[tuple[np.ndarray, str, Colour]] = field(default_factory=list)

    def line(self, points: np.ndarray, colour: Colour, *, width: float = 2.0, closed: bool = False) -> None:
        """Add a polyline ``(N, 2)``; nothing if any point is not finite."""
        if len(points) < 2 or not np.isfinite(points).all():
            return
        ends = np.roll(points, -1, axis=0) if closed else points[1:]
        starts = points if closed else points[:-1]
        segments = np.stack([starts, ends], axis=1).reshape(-1, 2)
        self._lines.setdefault(width, []).append((segments, colour))

    def arrow(
        self, start: np.ndarray, end: np.ndarray, colour: Colour, *, width: float = 2.0, head: float = 8.0
    ) -> None:
        """Add a line with a head at its end; the head is at most half as long as the line."""
        self.line(np.stack([start, end]), colour, width=width)
        length = float(np.linalg.norm(end - start))
        if length < 1e-6 or not np.isfinite(length):
            return
        along = (end - start) / length
        across = np.array([-along[1], along[0]])
        size = min(head * self.unit, length / 2)
        wings = [end - size * along + side * 0.5 * size * across for side in (1, -1)]
        self.line(np.stack([wings[0], end, wings[1]]), colour, width=width)

    def circle(self, centre: np.ndarray, radius: float, colour: Colour, *, width: float = 2.0) -> None:
        """Add a circle; the radius is in pixels at interface scale 1."""
        angle = np.linspace(0, 2 * np.pi, 32, endpoint=False)
        outline = centre + radius * self.unit * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self.line(outline, colour, width=width, closed=True)

    def cross(self, centre: np.ndarray, inner: float, outer: float, colour: Colour, *, width: float = 2.0) -> None:
        """Add a cross whose arms run from ``inner`` to ``outer`` pixels (at interface scale 1) from the centre."""
        for direction in np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]):
            arm = centre + self.unit * np.outer([inner, outer], direction)
            self.line(arm, colour, width=width)

    def text(self, at: np.ndarray, text: str, colour: Colour) -> None:
        """Add a line of text with its lower left corner at a point."""
        if np.isfinite(at).all():
            self._texts.append((np.asarray(at, float), text, colour))

    def width_of(self, text: str) -> float:
        """Width of a line of text, px."""
        blf.size(FONT, TEXT_SIZE * self.unit)
        return float(blf.dimensions(FONT, text)[0])

    def wrapped(self, text: str, room: float) -> list[str]:
        """The lines of a text, none wider than ``room`` px but a word that is."""
        lines = [""]
        for number, word in enumerate(text.split(" ")):
            longer = f"{lines[-1]} {word}" if number else word
            if lines[-1].strip() and self.width_of(longer) > room:
                lines.append(word)
            else:
                lines[-1] = longer
        return lines

    def draw(self) -> None:
        """Draw everything: all dark lines first, so that none covers a coloured one."""
        if not self._lines and not self._texts:
            return
        gpu.state.blend_set("ALPHA")
        for width, lines in self._lines.items():
            # a faint line needs a faint halo
            self._draw_lines([(line, (*HALO[:3], HALO[3] * c[3])) for line, c in lines], width + 2 * HALO_PX)
        for width, lines in self._lines.items():
            self._draw_lines(lines, width)
        self._draw_texts()
        gpu.state.blend_set("NONE")

    def _draw_lines(self, lines: list[tuple[np.ndarray, Colour]], width: float) -> None:
        points = np.concatenate([segments for segments, _ in lines])
        positions = np.zeros((len(points), 3), np.float32)
        positions[:, :2] = points
        colours = np.concatenate(
            [np.tile(np.array(colour, np.float32), (len(segments), 1)) for segments, colour in lines]
        )
        shader = gpu.shader.from_builtin("POLYLINE_FLAT_COLOR")
        batch = batch_for_shader(shader, "LINES", {"pos": positions, "color": colours})
        shader.bind()
        shader.uniform_float("viewportSize", gpu.state.viewport_get()[2:])
        shader.uniform_float("lineWidth", width * self.unit)
        batch.draw(shader)

    def _draw_texts(self) -> None:
        if not self._texts:
            return
        blf.size(FONT, TEXT_SIZE * self.unit)
        margin = 3 * self.unit
        corners = []
        for at, text, _ in self._texts:
            width, _ = blf.dimensions(FONT, text)
            low = at - margin
            high = at + np.array([width + margin, TEXT_SIZE * self.unit * 0.8 + margin])
            corners += [low, [high[0], low[1]], high, low, high, [low[0], high[1]]]
        shader = gpu.shader.from_builtin("UNIFORM_COLOR")
        batch = batch_for_shader(shader, "TRIS", {"pos": np.array(corners, np.float32)})
        shader.bind()
        shader.uniform_float("color", TEXT_BACKGROUND)
        batch.draw(shader)
        for at, text, colour in self._texts:
            blf.position(FONT, float(at[0]), float(at[1]), 0)
            blf.color(FONT, *colour)
            blf.draw(FONT, text)


@contextmanager
def in_window_pixels() -> Iterator[None]:
    """Draw a cursor in pixels of the window, of which Blender draws a part."""
    left, below, width, height = gpu.state.viewport_get()
    with gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
        clip_from_px = ((2 / width, 0, 0, -1), (0, 2 / height, 0, -1), (0, 0, -1, 0), (0, 0, 0, 1))
        gpu.matrix.load_projection_matrix(Matrix(clip_from_px))
        gpu.matrix.load_matrix(Matrix.Translation((-left, -below, 0.0)))
        yield
