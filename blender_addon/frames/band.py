"""Draws a band along the Timeline of the film: which frames are found, doubtful and lost."""

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..pipeline.registration.verdict import COLOURS
from ..ui.pane import Pane
from ..ui.strokes import Strokes
from . import found

HEIGHT = 5
"""At interface scale 1."""


class FoundBand(Pane):
    """At the bottom of the Timeline, a frame wide for each; lost ones lie over the others, where a pixel holds many."""

    space = bpy.types.SpaceDopeSheetEditor

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return found.of(context.scene) is not None

    @classmethod
    def draw(cls, context: bpy.types.Context, strokes: Strokes) -> None:
        registered, view = found.of(context.scene), context.region.view2d
        first, last = (np.array(view.view_to_region(x, 0.0, clip=False), float)[0] for x in (0.0, 1000.0))
        per_frame = (last - first) / 1000
        shader = gpu.shader.from_builtin("UNIFORM_COLOR")
        for state in found.WORDS:
            frames = () if registered is None else registered.frames.items()
            numbers = np.array([number for number, frame in frames if frame.verdict.state == state], float)
            left = first + per_frame * (numbers - 0.5)
            right, low = np.maximum(left + per_frame, left + 1), np.zeros(len(left))
            high = low + HEIGHT * strokes.unit
            corners = [(left, low), (right, low), (right, high), (left, low), (right, high), (left, high)]
            points = np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1).reshape(-1, 2)
            if len(points):
                shader.bind()
                shader.uniform_float("color", (*(value / 255 for value in COLOURS[state]), 1.0))
                batch_for_shader(shader, "TRIS", {"pos": np.float32(points)}).draw(shader)
