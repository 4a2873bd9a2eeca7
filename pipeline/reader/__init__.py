"""A dataset or a pack for code of your own, as a sequence of views that are decoded when they are looked at.

In: the folder of ``oneframe render`` or of ``oneframe pack``. Out: arrays, by ``open_dataset``.
"""

from .background import with_background
from .dataset import Dataset, open_dataset
from .distorted import DistortedView
from .files import Boxes
from .view import View

__all__ = ["Boxes", "Dataset", "DistortedView", "View", "open_dataset", "with_background"]
