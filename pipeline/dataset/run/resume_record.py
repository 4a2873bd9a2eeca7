"""The record of a finished view, ``frame/NNNNNN.json``: its pose, ground truth and counts, and hashes of its files.

It is written last, so a view with a record is complete: by it a killed run resumes. All tables are made
from the records.
"""

import json
import math
import operator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...errors import InputError, RunError
from ...files.content import LARGEST_FILE, read_content
from ...files.tables import parsed_json
from ...poses.constraints import Rejections
from ..checksums import FileSum, checked_hash, sum_from_json, sums_to_json
from ..layout import ViewPaths

Box = tuple[int, int, int, int]
"""(x, y, width, height) in px with width = x_max - x_min, as in BOP; (-1, -1, -1, -1) if empty."""


@dataclass(frozen=True)
class GroundTruthInfo:
    """An entry of BOP's ``scene_gt_info.json``.

    Attributes
    ----------
    bbox_obj, bbox_visib
        Box of the whole silhouette, including what is outside the image; box of the part in the image.
    px_count_all
        Pixels of the whole silhouette.
    px_count_valid, px_count_visib
        Its pixels in the image with depth; those that are visible.
    visib_fract
        Visible fraction of the silhouette, 0..1.
    """

    bbox_obj: Box
    bbox_visib: Box
    px_count_all: int
    px_count_valid: int
    px_count_visib: int
    visib_fract: float


@dataclass(frozen=True)
class ViewRecord:
    """What is known about a finished view.

    Attributes
    ----------
    index
        Number of the view in the dataset.
    identity
        Identity of the dataset: see :func:`oneframe.dataset.identity.identity_of`.
    cam_from_model
        ``(4, 4)`` rigid, mm.
    depth_scale
        Millimetres per unit of the 16-bit depth image.
    gt_info
        Boxes and counts, as in BOP.
    px_count_observed
        Pixels of surface that the source frame saw.
    attempts, rejections
        Number of poses tried, including this one, and the constraints that they broke.
    files
        Size and hash of every file of the view, by its path relative to the dataset.
    rle_counts
        Run lengths of the mask: see :func:`oneframe.dataset.tables.bop.run_lengths`.
    """

    index: int
    identity: str
    cam_from_model: np.ndarray
    depth_scale: float
    gt_info: GroundTruthInfo
    px_count_observed: int
    attempts: int
    rejections: Rejections
    files: dict[str, FileSum]
    rle_counts: tuple[int, ...]

    @property
    def cam_r_m2c(self) -> list[float]:
        """The rotation row by row, as in BOP's tables."""
        return self.cam_from_model[:3, :3].ravel().tolist()

    @property
    def cam_t_m2c(self) -> list[float]:
        """The translation in mm, as in BOP's tables."""
        return self.cam_from_model[:3, 3].tolist()

    def to_json(self) -> dict[str, object]:
        """The JSON object of the file."""
        return {
            "index": self.index,
            "identity": self.identity,
            "cam_R_m2c": self.cam_r_m2c,
            "cam_t_m2c": self.cam_t_m2c,
            "depth_scale": self.depth_scale,
            "gt_info": asdict(self.gt_info),
            "px_count_observed": self.px_count_observed,
            "attempts": self.attempts,
            "rejections": asdict(self.rejections),
            "files": sums_to_json(self.files),
            "rle_counts": list(self.rle_counts),
        }

    def to_bytes(self) -> bytes:
        """The content of the file."""
        return (json.dumps(self.to_json(), separators=(",", ":")) + "\n").encode()

    @classmethod
    def from_json(cls, content: Any, where: str) -> "ViewRecord":
        """Read the record from a file's JSON object; ``where`` names the file in messages."""
        try:
            info, whole = content["gt_info"], operator.index
            record = cls(
                index=whole(content["index"]),
                identity=checked_hash(content["identity"]),
                cam_from_model=_pose(content["cam_R_m2c"], content["cam_t_m2c"]),
                depth_scale=float(content["depth_scale"]),
                gt_info=GroundTruthInfo(
                    bbox_obj=_box(info["bbox_obj"]),
                    bbox_visib=_box(info["bbox_visib"]),
                    px_count_all=whole(info["px_count_all"]),
                    px_count_valid=whole(info["px_count_valid"]),
                    px_count_visib=whole(info["px_count_visib"]),
                    visib_fract=float(info["visib_fract"]),
                ),
                px_count_observed=whole(content["px_count_observed"]),
                attempts=whole(content["attempts"]),
                rejections=Rejections(
                    **{name: whole(content["rejections"][name]) for name in ("surface", "observed", "clearance")}
                ),
                files={name: sum_from_json(known) for name, known in content["files"].items()},
                rle_counts=tuple(map(whole, content["rle_counts"])),
            )
            numbers = (record.depth_scale, record.gt_info.visib_fract, *record.cam_t_m2c, *record.cam_r_m2c)
            if not all(map(math.isfinite, numbers)) or max(record.rle_counts, default=0) > LARGEST_COUNT:
                raise ValueError("a number is too large")
        except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise RunError(
                f"{where}: expected the record of a view, found a damaged one ({type(error).__name__}: {error}); "
                f"remove the file and {_AGAIN}"
            ) from None
        return record


def _box(values: list[int]) -> Box:
    x, y, width, height = map(operator.index, values)
    return x, y, width, height


def _pose(r: list[float], t: list[float]) -> np.ndarray:
    """A rotation row by row and a translation as ``(4, 4)``; in one step, for a survey reads them by the 100 000."""
    if (len(r), len(t)) != (9, 3):
        raise ValueError(f"a pose of {len(r)} and {len(t)} numbers")
    return np.array([[*r[:3], t[0]], [*r[3:6], t[1]], [*r[6:], t[2]], [0.0, 0.0, 0.0, 1.0]], np.float64)


def read_record(paths: ViewPaths) -> ViewRecord:
    """Read the record of a finished view; RunError, which names the file, if it is missing, damaged or of another."""
    path = paths.file("frame")
    where = str(path)
    try:
        data = read_content(path, "the record of a view", where, most=LARGEST_FILE, noted=False)
        record = ViewRecord.from_json(parsed_json(data, where), where)
    except InputError as error:
        raise RunError(f"{error}; or remove the file and {_AGAIN}") from None
    if record.index != paths.index:
        raise RunError(
            f"{where}: expected the record of view {paths.index}, found that of view {record.index}; "
            f"remove the file and {_AGAIN}"
        )
    return record


LARGEST_COUNT = 1e15
"""No run of pixels is nearly as long."""
_AGAIN = "run the same command again: it renders the view again"
