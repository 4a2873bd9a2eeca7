"""Views that darken towards their corners."""

from dataclasses import replace

import numpy as np

from .staging import Filter, Staging


def vignette_filter(staging: Staging) -> Filter | None:
    """The filter that darkens a view's corners."""
    if not staging.options["vignette"]:
        return None
    height, width = staging.camera.shape_hw
    v, u = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    factors = (1 - staging.options["vignette"] * (u**2 + v**2) / 2)[..., None].astype(np.float32)
    return lambda view, _staged: replace(view, rgb=view.rgb * factors)
