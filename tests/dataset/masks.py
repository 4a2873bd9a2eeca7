"""Masks of any kind, for laws of boxes and run lengths."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

sides = st.integers(1, 40)
masks = hnp.arrays(bool, st.tuples(sides, sides)) | st.builds(
    lambda seed, shape, share: np.random.default_rng(seed).random(shape) < share,
    st.integers(0, 2**32 - 1), st.tuples(sides, sides), st.sampled_from([0.0, 0.01, 0.5, 0.99, 1.0]),
)  # fmt: skip
