"""A dataset or a pack for code of your own, as a sequence of views that are decoded when they are looked at.

In: the folder of ``oneframe render`` or of ``oneframe pack``. Out: arrays, by ``open_dataset``.
"""

from .background import Background
from .dataset import Dataset, open_dataset
from .distorted import DistortedView
from .lens import Defocus, Exposure, RoundView, SensorNoise, through_lens
from .view import Boxes, View

__all__ = [
    "Background",
    "Boxes",
    "Dataset",
    "Defocus",
    "DistortedView",
    "Exposure",
    "RoundView",
    "SensorNoise",
    "View",
    "open_dataset",
    "through_lens",
]
