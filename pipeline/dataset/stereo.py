"""The right eye of each view: a dataset of its own, in a folder within that of the left eyes, which are the views."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..transforms import rigid, rotation_from_vector, turned_about
from .identity import DEPTH_SCALE, described, differences
from .layout import FURTHER
from .options import DatasetOptions

LEFT, RIGHT = "left", "right"


def camera_from_planned(options: Mapping[str, Any]) -> np.ndarray | None:
    """``(4, 4)`` rigid, mm: from the axes of the camera whose pose is planned, the left eye, to those of the views'.

    ``options`` are those of a description; ``None`` if the two are the same.
    """
    if options["eye"] == LEFT:
        return None
    return right_from_left(options["stereo_mm"], options["converge_mm"])


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


def further_datasets(options: DatasetOptions) -> dict[str, DatasetOptions]:
    """The datasets that belong into the folder of one with these options: their folders and options."""
    if not options.stereo_mm or options.eye == RIGHT:
        return {}
    return {FURTHER: replace(options, eye=RIGHT, video=False)}


def has_further(description: Mapping[str, Any]) -> bool:
    """Whether a dataset with this description has another one in its folder."""
    return bool(description["options"]["stereo_mm"]) and description["options"]["eye"] == LEFT


def eyes_apart(left: Mapping[str, Any], right: Mapping[str, Any]) -> str:
    """What keeps two descriptions from being those of both eyes of the same views, in words; empty if nothing does."""
    expected = {**left, "options": {**left["options"], "eye": RIGHT}}
    changes = [change for change in differences(right, expected) if change.key != DEPTH_SCALE]
    return "; ".join(described(changes))
