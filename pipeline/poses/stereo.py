"""The right eye of a stereo pair, beside the left one, which is the view itself."""

import numpy as np

from ..transforms import rigid, rotation_from_vector, turned_about


def right_from_left(stereo_mm: float, converge_mm: float = 0.0) -> np.ndarray:
    """``(4, 4)`` rigid transform from the left eye's camera axes to the right one's, mm.

    Parameters
    ----------
    stereo_mm
        Distance of the eyes.
    converge_mm
        Distance from both eyes at which their axes meet; 0 for parallel ones, with disparity = f * stereo_mm / depth.
    """
    if not converge_mm:
        return rigid(translation=np.array([-stereo_mm, 0.0, 0.0]))
    turn = 2 * np.arcsin(stereo_mm / (2 * converge_mm))
    return turned_about(np.array([0.0, 0.0, converge_mm]), rotation_from_vector(np.array([0.0, turn, 0.0])))
