"""The right eye of each view: a dataset of its own, in a folder within that of the left eyes, which are the views."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

LEFT, RIGHT = "left", "right"


def further_eyes(options: Mapping[str, Any]) -> tuple[str, ...]:
    """The eyes whose datasets belong into the folder of one with these options; their folders have their names."""
    return (RIGHT,) if options["stereo_mm"] and options["eye"] == LEFT else ()


def camera_from_planned(options: Mapping[str, Any]) -> "np.ndarray | None":
    """``(4, 4)`` rigid, mm: from the axes of the camera whose pose is planned, the left eye, to those of the views'.

    ``options`` are those of a description; ``None`` if the two are the same.
    """
    return None if options["eye"] == LEFT else right_from_left(options["stereo_mm"], options["converge_mm"])


def right_from_left(stereo_mm: float, converge_mm: float = 0.0) -> "np.ndarray":
    """``(4, 4)`` rigid transform from the left eye's camera axes to the right one's, mm.

    Parameters
    ----------
    stereo_mm
        Distance of the eyes.
    converge_mm
        Distance from both eyes at which their axes meet; 0 for parallel ones, with disparity = f * stereo_mm / depth.
    """
    # the options' own words need no numpy
    import numpy as np

    from ..transforms import rigid, rotation_from_vector, turned_about

    if not converge_mm:
        return rigid(translation=np.array([-stereo_mm, 0.0, 0.0]))
    turn = 2 * math.asin(stereo_mm / (2 * converge_mm))
    return turned_about(np.array([0.0, 0.0, converge_mm]), rotation_from_vector(np.array([0.0, turn, 0.0])))
