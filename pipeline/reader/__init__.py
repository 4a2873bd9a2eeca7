"""A dataset or a pack for code of your own, as a sequence of views that are decoded when they are looked at.

In: the folder of ``oneframe render`` or of ``oneframe pack``. Out: arrays, by ``open_dataset``.
"""

from .dataset import Dataset, open_dataset
from .view import Boxes, View

__all__ = ["Boxes", "Dataset", "View", "open_dataset"]
