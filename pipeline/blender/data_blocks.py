"""Data-blocks that a piece of work brings into the open file, and their removal."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import bpy

_KINDS = ("scenes", "worlds", "objects", "meshes", "cameras", "lights", "materials", "images", "node_groups")
_OF_BLENDER = ("RENDER_RESULT", "COMPOSITING")
"""Images that Blender makes and keeps for itself."""


def data_blocks() -> list[bpy.types.ID]:
    """All data-blocks of the kinds that the pipeline makes."""
    return [
        block
        for kind in _KINDS
        for block in getattr(bpy.data, kind)
        if not (kind == "images" and block.type in _OF_BLENDER)
    ]


def remove_data(blocks: Iterable[bpy.types.ID]) -> None:
    """Remove data-blocks, scenes with all that a render engine has kept of them."""
    others = []
    for block in blocks:
        if isinstance(block, bpy.types.Scene):
            # else the engine's dependency graph outlives its scene: the next removal of anything reads freed memory
            block.render.use_persistent_data = False
            # unlike batch_remove, gives a window that shows the scene another one
            bpy.data.scenes.remove(block)
        else:
            others.append(block)
    bpy.data.batch_remove(others)


@contextmanager
def temporary_data() -> Iterator[None]:
    """What is made inside the block is removed at its end."""
    existing = set(data_blocks())
    try:
        yield
    finally:
        remove_data(block for block in data_blocks() if block not in existing)
