"""Lists of photographs with poses, in JSON: of registered frames; and read."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.pinhole import PinholeCamera
from ..case.case_file import Case
from ..case.frame import PosedFrame, UnreadFrame
from ..case.loaded_case import LoadedCase
from ..case.pose_record import REGISTERED, UNKNOWN, PoseRecord
from ..errors import InputError
from ..files.content import LARGEST_FILE, read_content
from ..files.keys import file_and_place
from ..files.tables import parsed_json
from ..poses.pose_file import POSE_KEY, is_without_pose, listed_poses, read_poses
from ..transforms import checked_rigid, inverse_rigid
from .further_frames import FrameReader, ListedImage, evenly, small_frame
from .register import RegisteredFrame, accepted_poses
from .verdict import ACCEPTED, Verdict

POSES = "poses.json"
CHANGED, BY_ZOOM = "changed", "by_zoom_mm_rad"
"""Keys of a frame's entry: where a film no longer shows what the case's frame shows; the zoom's part of covariance."""
MOST_ACCEPTED = 12
"""Frames that :func:`small_frames` takes: of more, evenly chosen ones."""


def pose_entry(
    name: str, number: int, registered: RegisteredFrame, mesh_from_model: np.ndarray, mm_per_unit: float
) -> dict[str, object]:
    """A frame's entry: ``cam_from_mesh`` in the units of the mesh, ``null`` where it is refused."""
    verdict = registered.verdict
    entry: dict[str, object] = {"image": name} if name else {}
    entry |= {"frame": number, "state": verdict.state, "probability": round(verdict.probability, 4)}
    entry |= {"reason": verdict.reason, POSE_KEY: None}
    entry |= {CHANGED: True} if registered.changed else {}
    if registered.cam_from_model is None or registered.uncertainty is None:
        return entry
    pose = registered.cam_from_model @ inverse_rigid(mesh_from_model)
    pose[:3, 3] /= mm_per_unit
    with_zoom = registered.uncertainty.plus(np.outer(registered.by_zoom, registered.by_zoom))
    return entry | {POSE_KEY: pose.tolist(), **with_zoom.entry(mesh_from_model), BY_ZOOM: registered.by_zoom.tolist()}


def registered_of(
    entries: Sequence[Any], mesh_from_model: np.ndarray, mm_per_unit: float
) -> dict[int, RegisteredFrame]:
    """Number of a frame -> what its entry says of it, without the fit: the inverse of :func:`pose_entry`.

    Raises
    ------
    KeyError, TypeError, ValueError
        An entry is not one of these.
    """
    frames = {}
    for entry in entries:
        verdict = Verdict(str(entry["state"]), float(entry["probability"]), str(entry["reason"]))
        pose, uncertainty, by_zoom = None, None, np.zeros(6)
        if entry[POSE_KEY] is not None:
            cam_from_mesh, _ = checked_rigid(entry[POSE_KEY], POSE_KEY)
            cam_from_mesh[:3, 3] *= mm_per_unit
            pose = cam_from_mesh @ mesh_from_model
            by_zoom = np.array(entry[BY_ZOOM], float)
            uncertainty = PoseUncertainty.of_entry(entry, pose, mesh_from_model).plus(-np.outer(by_zoom, by_zoom))
            if not np.isfinite(uncertainty.covariance).all():
                raise ValueError("expected a finite covariance")
        changed = bool(entry.get(CHANGED))
        frames[int(entry["frame"])] = RegisteredFrame(verdict, pose, uncertainty, by_zoom=by_zoom, changed=changed)
    return frames


def registration_record(
    registered: RegisteredFrame,
    camera: PinholeCamera,
    mesh_from_model: np.ndarray,
    case_record: PoseRecord,
    case_name: str,
    tool: str,
    date: str,
) -> PoseRecord:
    """The record of the frame's pose; an unknown one if the frame is refused.

    Parameters
    ----------
    registered
        The frame.
    camera
        The camera of the frame at its full size.
    mesh_from_model
        ``(4, 4)``, mm.
    case_record, case_name
        The record of the aligned frame's pose, and the name of its file.
    tool, date
        Program and version; day in ISO 8601.
    """
    pose, uncertainty, verdict = registered.cam_from_model, registered.uncertainty, registered.verdict
    if pose is None or uncertainty is None:
        return UNKNOWN
    # nobody knows how far it is off where the aligned frame's pose says nothing
    is_known = case_record.standard_deviation_mm is not None
    return PoseRecord(
        method=REGISTERED,
        tool=tool,
        date=date,
        doubt="" if verdict.state == ACCEPTED else verdict.reason,
        probability=verdict.probability,
        start_frame=case_name,
        start_method=case_record.method,
        error_px=uncertainty.spread_px(camera, pose) if is_known else None,
        **uncertainty.deviations(),
        **uncertainty.entry(mesh_from_model),
    )


def encoded_list(entries: Sequence[Mapping[str, object]]) -> bytes:
    """The JSON of a list."""
    text = json.dumps(list(entries), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    # names of files that are no Unicode as JSON's escapes, with which Python finds them again
    return text.encode(errors="backslashreplace")


@dataclass(frozen=True)
class AcceptedFrames:
    """Accepted frames of a video, or images.

    Attributes
    ----------
    poses
        Number of a frame -> ``cam_from_model`` ``(4, 4)``, mm.
    video
        The film.
    images
        Number of a frame -> its image, instead.
    """

    poses: Mapping[int, np.ndarray]
    video: Path | None = None
    images: Mapping[int, ListedImage] = field(default_factory=dict)

    @property
    def files(self) -> dict[str, Path]:
        """All that is read of the frames, by what it is."""
        named = {f"image {each.path.name}": each.path for each in self.images.values()}
        return {"video": self.video} if self.video else named


def accepted_frames(folder: Path, video: Path | None, loaded: LoadedCase) -> AcceptedFrames:
    """The frames that ``oneframe register`` has accepted in its folder; ``video`` if they are those of a film."""
    path = folder / POSES if folder.is_dir() else folder
    content = read_content(path, "the poses of registered frames", most=LARGEST_FILE)
    try:
        entries: Any = parsed_json(content, str(path))
        registered = registered_of(entries, loaded.surface.mesh_from_model, loaded.case.mm_per_unit)
        listed = [entry for entry in entries if entry.get("image")]
        images = {int(entry["frame"]): ListedImage.of_entry(entry, path.name, path.parent) for entry in listed}
    except (InputError, AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            f"{path}: expected the poses that oneframe register writes, found something else; name the folder that it "
            "wrote, and the video of these frames with --video"
        ) from None
    poses = accepted_poses(registered)
    if not poses:
        raise InputError(f"{path}: expected accepted frames, found none among {len(registered)}")
    if (video is None) != (poses.keys() <= images.keys()):
        raise InputError(f"{path}: expected frames of a video with --video, or images of a folder without; name either")
    images = {number: images[number] for number in poses if images}
    if missing := [each.path for each in images.values() if not each.path.is_file()]:
        raise InputError(
            f"{missing[0].parent}: expected the images that were registered, {missing[0].name} is not there; bring it "
            "back, or register the others again"
        )
    return AcceptedFrames(poses, video, images)


def small_frames(loaded: LoadedCase, accepted: AcceptedFrames | None) -> list[PosedFrame]:
    """The case's frames and some accepted ones, at the size at which frames are registered."""
    frames = [small_frame(frame) for frame in loaded.frames]
    if accepted is None:
        return frames
    chosen, reader = evenly(sorted(accepted.poses), MOST_ACCEPTED), FrameReader(loaded.case)
    if accepted.video is None:
        further = [reader.image(number, accepted.images[number]) for number in chosen]
    else:
        with reader.opened(accepted.video) as opened:
            further = [frame for frame in opened.frames if frame.number in chosen]
    found = dict.fromkeys(chosen, "the film has no such frame") | {frame.number: frame.problem for frame in further}
    if lost := next(((number, problem) for number, problem in found.items() if problem), None):
        raise InputError(f"frame {lost[0]}: expected it as it was registered, but {lost[1]}; register the frames again")
    return frames + [
        PosedFrame(frame.image.astype(np.float32) / 255, frame.valid, reader.camera, accepted.poses[frame.number])
        for frame in further
    ]


def read_photographs(path: Path, case: Case) -> tuple[list[UnreadFrame], list[str]]:
    """Read a list of ``{"image": file, "cam_from_mesh": 4x4}``, poses as in the case file, or ``null``: left out.

    In JSON, or a table of :mod:`oneframe.poses.pose_tables`. Photographs by another camera than the case's have a
    ``"camera"``: a file that :func:`.read_camera` reads, and after # which of its cameras.

    Returns
    -------
    The photographs; and messages about what was corrected.
    """
    poses, messages = read_poses(path, mesh_from_model=np.eye(4), mm_per_unit=case.mm_per_unit)
    file, _ = file_and_place(path)
    frames = []
    for number, entry in enumerate(each for each in listed_poses(path) if not is_without_pose(each)):
        listed = ListedImage.of_entry(entry, f"{file.name}: entry {number}", file.parent)
        size_wh = listed.size_wh if listed.camera else case.camera.size_wh
        frames.append(UnreadFrame(listed.path, *listed.lens(case, size_wh), poses[number]))
    return frames, messages
