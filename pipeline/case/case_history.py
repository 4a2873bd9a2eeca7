"""The poses that a case file had before: what is saved over a pose never ends it.

``case.history.json`` beside ``case.toml`` holds the last five with their records and K, and no names of files. Every
way of writing a case file keeps it: :func:`.write_case` and :func:`.update_case`.
"""

import datetime
import json
from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.distortion import Distortion
from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..files.content import LARGEST_TEXT, read_content
from ..files.keys import check_keys
from ..files.tables import parsed_json
from ..poses.pose_file import POSE_KEY
from ..transforms import checked_rigid
from .case_file import Case, checked_camera
from .pose_record import PoseRecord

MOST = 5
SUFFIX = ".history.json"


@dataclass(frozen=True)
class EarlierPose:
    """A pose that a case file had.

    Attributes
    ----------
    replaced
        When another one took its place: day and time in ISO 8601.
    mm_per_unit
        Of the case then.
    camera, distortion
        K for which the pose was found, and its distortion.
    cam_from_mesh
        4x4, mm.
    alignment
        Its record, without the name of a frame.
    """

    replaced: str
    mm_per_unit: float
    camera: PinholeCamera
    distortion: Distortion | None
    cam_from_mesh: np.ndarray
    alignment: PoseRecord

    @property
    def text(self) -> str:
        """How it was found, how sure it is, and when it was replaced."""
        record = self.alignment
        words = [record.method or "of unknown origin"]
        words += [f"checked {record.checked}"] if record.checked else []
        words += [] if record.error_px is None else [f"off by about {record.error_px:.2g} px"]
        words += [f"in doubt: {doubt}" for doubt in (record.doubt, record.refused) if doubt]
        return f"{', '.join(words)}; replaced {self.replaced.replace('T', ' ')}"

    def put_back(self, case: Case) -> Case:
        """The case at this pose, with its K.

        Raises
        ------
        InputError
            The case has another frame size or unit by now.
        """
        if (self.camera.size_wh, self.mm_per_unit) != (case.camera.size_wh, case.mm_per_unit):
            raise InputError(
                f"{case.path.name}: expected the frame size and the units of the earlier pose, "
                f"{self.camera.width}x{self.camera.height} px and {self.mm_per_unit:g} mm, found "
                f"{case.camera.width}x{case.camera.height} px and {case.mm_per_unit:g} mm; set them back first"
            )
        return replace(
            case, camera=self.camera, distortion=self.distortion, cam_from_mesh=self.cam_from_mesh, posed=True,
            alignment=self.alignment,
        )  # fmt: skip


def history_path(path: Path) -> Path:
    """The file of the earlier poses of a case file."""
    return path.with_suffix(SUFFIX)


def earlier_poses(path: Path) -> tuple[EarlierPose, ...]:
    """The poses that a case file had, the latest first; none without a history.

    Raises
    ------
    InputError
        Its history is damaged.
    """
    file = history_path(path)
    if not file.exists():
        return ()
    entries = parsed_json(read_content(file, "earlier poses of a case", most=LARGEST_TEXT), file.name)
    if not isinstance(entries, list):
        raise InputError(
            f"{file}: expected a list of earlier poses, found {type(entries).__name__}; move the file away"
        )
    return tuple(_checked(entry, f"{file.name}: number {number}") for number, entry in enumerate(entries, start=1))


def with_replaced(path: Path, before: Case, after: Case) -> dict[Path, bytes]:
    """The history to write before a case file is replaced: none if its pose stays, or if nobody had found it.

    The last five are kept; if others pushed it out, the latest one that was found in the image or checked is the fifth.

    Raises
    ------
    InputError
        The history is damaged.
    """
    is_same = after.posed and np.array_equal(before.cam_from_mesh, after.cam_from_mesh)
    if not before.posed or before.alignment.is_start or is_same:
        return {}
    now = datetime.datetime.now().isoformat(timespec="seconds")
    record = replace(before.alignment, start_frame="")
    pose = before.cam_from_mesh
    replaced = EarlierPose(now, before.mm_per_unit, before.camera, before.distortion, pose, record)
    poses = [replaced]
    for each in earlier_poses(path):
        if not (np.array_equal(each.cam_from_mesh, pose) and each.alignment == record):
            poses.append(each)
    oldest = poses[MOST - 1 :]
    poses[MOST - 1 :] = [each for each in oldest if each.alignment.is_settled][:1] or oldest[:1]
    return {history_path(path): ("[\n" + ",\n".join(map(_text, poses)) + "\n]\n").encode()}


def _text(pose: EarlierPose) -> str:
    camera = {"size": pose.camera.size_wh, "K": pose.camera.k.tolist()}
    if pose.distortion is not None:
        camera["distortion"] = astuple(pose.distortion)
    table = {"replaced": pose.replaced, "mm_per_unit": pose.mm_per_unit, "camera": camera}
    return json.dumps({**table, POSE_KEY: pose.cam_from_mesh.tolist(), "alignment": pose.alignment.table()})


def _checked(entry: Any, where: str) -> EarlierPose:
    if not isinstance(entry, Mapping) or not isinstance(entry.get("camera"), Mapping):
        raise InputError(f"{where}: expected an earlier pose with its camera, found {entry!r}")
    check_keys(entry, ("replaced", "mm_per_unit", "camera", POSE_KEY, "alignment"), (), f"{where}: ")
    check_keys(entry["camera"], ("size", "K"), ("distortion",), f"{where}: camera ")
    return EarlierPose(
        str(entry["replaced"]),
        float(entry["mm_per_unit"]),
        *checked_camera(entry["camera"], f"{where}: camera"),
        checked_rigid(entry[POSE_KEY], f"{where}: {POSE_KEY}")[0],
        PoseRecord.of_table(entry["alignment"], f"{where}: alignment"),
    )
