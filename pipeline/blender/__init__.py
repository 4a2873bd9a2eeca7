"""The stages that need Blender: the only code below the add-on that imports bpy.

The same topics as in the rest of the pipeline, and ``bridge``, where arrays become data-blocks.
"""

import os
import sys
from typing import TYPE_CHECKING

from ..images.image_reader import register_decoder

if TYPE_CHECKING:
    import numpy as np

# Blender takes its colours from the configuration that this names when it starts; views must not depend on it
if "bpy" not in sys.modules:
    os.environ.pop("OCIO", None)


def _decode(data: bytes, where: str) -> "np.ndarray":
    # imports Blender
    from .bridge.image import decode

    return decode(data, where)


register_decoder(_decode)
