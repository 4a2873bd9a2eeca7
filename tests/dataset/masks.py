"""Masks of any kind, for laws of boxes and run lengths, and a reader of COCO's masks."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

sides = st.integers(1, 40)
masks = hnp.arrays(bool, st.tuples(sides, sides)) | st.builds(
    lambda seed, shape, share: np.random.default_rng(seed).random(shape) < share,
    st.integers(0, 2**32 - 1), st.tuples(sides, sides), st.sampled_from([0.0, 0.01, 0.5, 0.99, 1.0]),
)  # fmt: skip


def coco_mask(segmentation: dict) -> np.ndarray:
    """Decode COCO's compressed run lengths, by the rule of ``rleFrString`` in cocoapi's common/maskApi.c."""
    runs, value, shift = [], 0, 0
    for character in segmentation["counts"]:
        group = ord(character) - 48
        value |= (group & 31) << shift
        shift += 5
        if not group & 32:
            if group & 16:
                value -= 1 << shift
            runs.append(value + (runs[-2] if len(runs) > 2 else 0))
            value, shift = 0, 0
    height, width = segmentation["size"]
    flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return flat.reshape(width, height).T
