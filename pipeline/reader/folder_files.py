"""Views in the folder of a dataset."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..dataset.dataset_file import Description
from ..dataset.layout import ViewPaths, largest_view_file
from ..dataset.run.resume_record import read_record
from ..errors import InputError, RunError
from ..files.content import read_file
from .view import Boxes, Numbers, ViewFiles


@dataclass(frozen=True)
class FolderFiles(ViewFiles):
    """The files of a dataset's views.

    ``opened`` opens another folder, that of the right eyes.
    """

    root: Path
    description: Description
    opened: Callable[[Path], ViewFiles]

    def numbers(self, index: int) -> Numbers:
        """The numbers of a view, from its record."""
        try:
            record = read_record(ViewPaths(self.root, index), with_mask=False)
        except RunError as error:
            raise InputError(str(error)) from None
        info = record.gt_info
        return Numbers(
            k=self.description.camera.k,
            cam_from_model=record.cam_from_model,
            depth_scale=record.depth_scale,
            boxes=Boxes(info.bbox_obj, info.bbox_visib),
            visib_fract=info.visib_fract,
        )

    def read(self, index: int, kind: str) -> tuple[bytes, str]:
        """The content of a file of a view, and its path."""
        path = ViewPaths(self.root, index).file(kind)
        try:
            return read_file(path, largest_view_file(*self.description.camera.size_wh)), str(path)
        except OSError as error:
            raise InputError(
                f"{path}: expected a file of view {index}, cannot read it ({error.strerror}); check the dataset "
                "(oneframe check)"
            ) from None
