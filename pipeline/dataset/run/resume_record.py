"""The record of a finished view, ``frame/NNNNNN.json``: its pose, ground truth and counts, and hashes of its files.

It is written last, so a view with a record is complete: by it a killed run resumes. All tables are made
from the records.
"""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...errors import InputError, RunError
from ...files.content import LARGEST_FILE, read_content
from ...files.tables import parsed_json
from ...poses.constraints import Rejections
from ..checksums import FileSum, sums_to_json
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
        Run lengths of the mask: see :func:`oneframe.dataset.tables.coco.run_lengths`.
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
        """Read the record from a file's JSON object; ``where`` names the file in messages.

        Raises
        ------
        RunError
            A key is missing, or its value is of the wrong kind.
        """
        _check_kinds(content, _KINDS, where)
        _check_kinds(content["gt_info"], _INFO_KINDS, where)
        _check_kinds(content["rejections"], _REJECTION_KINDS, where)
        info = content["gt_info"]
        return cls(
            index=content["index"],
            identity=content["identity"],
            cam_from_model=_pose(content["cam_R_m2c"], content["cam_t_m2c"]),
            depth_scale=float(content["depth_scale"]),
            gt_info=GroundTruthInfo(
                bbox_obj=tuple(info["bbox_obj"]),
                bbox_visib=tuple(info["bbox_visib"]),
                px_count_all=info["px_count_all"],
                px_count_valid=info["px_count_valid"],
                px_count_visib=info["px_count_visib"],
                visib_fract=float(info["visib_fract"]),
            ),
            px_count_observed=content["px_count_observed"],
            attempts=content["attempts"],
            rejections=Rejections(**{name: content["rejections"][name] for name in _REJECTION_KINDS}),
            files={name: FileSum(known["sha256"], known["bytes"]) for name, known in content["files"].items()},
            rle_counts=tuple(content["rle_counts"]),
        )


def _pose(r: list[float], t: list[float]) -> np.ndarray:
    """A rotation row by row and a translation as ``(4, 4)``; in one step, for a survey reads them by the 100 000."""
    return np.array([[*r[:3], t[0]], [*r[3:6], t[1]], [*r[6:], t[2]], [0.0, 0.0, 0.0, 1.0]], np.float64)


def read_record(paths: ViewPaths, *, with_mask: bool = True) -> ViewRecord:
    """Read the record of a finished view.

    Parameters
    ----------
    paths
        The view's files.
    with_mask
        False leaves the run lengths empty: they are only checked to be whole, which takes a tenth of the time.

    Raises
    ------
    RunError
        Missing, damaged, or of another view; the message names the file.
    """
    path = paths.file("frame")
    where = str(path)
    try:
        data = read_content(path, "the record of a view", where, most=LARGEST_FILE)
        record = ViewRecord.from_json(_parsed(data, where, with_mask=with_mask), where)
    except InputError as error:
        raise RunError(f"{error}; or remove the file and {_AGAIN}") from None
    if record.index != paths.index:
        raise RunError(
            f"{where}: expected the record of view {paths.index}, found that of view {record.index}; "
            f"remove the file and {_AGAIN}"
        )
    return record


_RUN_LENGTHS = b',"rle_counts":['


def _parsed(data: bytes, where: str, *, with_mask: bool) -> Any:
    """Parse a record; its thousands of run lengths, which come last, apart from the rest: they are only digits."""
    head, mark, tail = data.partition(_RUN_LENGTHS)
    only_digits = tail[-3:] == b"]}\n" and not tail[:-3].translate(None, b"0123456789,")
    if not mark or (with_mask and not only_digits):
        return parsed_json(data, where)
    if not only_digits:
        raise InputError(f"{where}: expected the record of a view, found a damaged one")
    # too large numbers are refused whatever they are read as
    content = parsed_json(head + _RUN_LENGTHS + b"]}", where, parse_int=int)
    if with_mask:
        try:
            content["rle_counts"] = json.loads(b"[" + tail[:-2])
        except ValueError as error:
            raise InputError(
                f"{where}: expected JSON, found a mistake: {error}; correct it or write it again"
            ) from None
    return content


LARGEST_NUMBER = 1e15
"""No distance, count or index is near it; NaN is none at all."""
_AGAIN = "run the same command again: it renders the view again"


_HASH = re.compile("[0-9a-f]{64}")


def _is_object(value: object) -> bool:
    return isinstance(value, dict)


def _is_hash(value: object) -> bool:
    return isinstance(value, str) and _HASH.fullmatch(value) is not None


def _is_integer(value: object) -> bool:
    return type(value) is int and -LARGEST_NUMBER <= value <= LARGEST_NUMBER


def _is_number(value: object) -> bool:
    # one after the other: twice as quick as isinstance with a union
    return (type(value) is float or type(value) is int) and -LARGEST_NUMBER <= value <= LARGEST_NUMBER


def _are_numbers(count: int) -> Callable[[object], bool]:
    return lambda value: isinstance(value, list) and len(value) == count and all(map(_is_number, value))


def _are_integers(value: object) -> bool:
    # thousands of them: without a call for each
    return isinstance(value, list) and (
        not value or ({*map(type, value)} == {int} and -LARGEST_NUMBER <= min(value) <= max(value) <= LARGEST_NUMBER)
    )


def _is_box(value: object) -> bool:
    return isinstance(value, list) and len(value) == 4 and _are_integers(value)


def _are_sums(value: object) -> bool:
    return isinstance(value, dict) and all(
        isinstance(entry, dict) and _is_hash(entry.get("sha256")) and _is_integer(entry.get("bytes"))
        for entry in value.values()
    )


_Kinds = Mapping[str, tuple[Callable[[object], bool], str]]
"""Keys of an object -> whether a value is right, and what it should be."""
_INTEGER, _NUMBER, _OBJECT = (_is_integer, "a whole number"), (_is_number, "a number"), (_is_object, "an object")
_KINDS: _Kinds = {
    "index": _INTEGER,
    "identity": (_is_hash, "64 hexadecimal digits"),
    "cam_R_m2c": (_are_numbers(9), "9 numbers"),
    "cam_t_m2c": (_are_numbers(3), "3 numbers"),
    "depth_scale": _NUMBER,
    "gt_info": _OBJECT,
    "px_count_observed": _INTEGER,
    "attempts": _INTEGER,
    "rejections": _OBJECT,
    "files": (_are_sums, "sha256 and bytes by name of a file"),
    "rle_counts": (_are_integers, "whole numbers"),
}
_INFO_KINDS: _Kinds = {
    **dict.fromkeys(("bbox_obj", "bbox_visib"), (_is_box, "4 whole numbers")),
    **dict.fromkeys(("px_count_all", "px_count_valid", "px_count_visib"), _INTEGER),
    "visib_fract": _NUMBER,
}
_REJECTION_KINDS: _Kinds = dict.fromkeys(("surface", "observed", "clearance"), _INTEGER)


def _check_kinds(content: object, kinds: _Kinds, where: str) -> None:
    again = f"remove the file and {_AGAIN}"
    if not isinstance(content, dict):
        raise RunError(f"{where}: expected the record of a view, found {content!r}; {again}")
    for key, (is_right, expected) in kinds.items():
        if not is_right(content.get(key)):
            found = repr(content[key])[:60] if key in content else "no such key"
            raise RunError(f"{where}: expected {key} to be {expected}, found {found}; {again}")
