"""Write case files that :func:`oneframe.case.case_file.read_case` reads back to the last bit."""

import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple
from datetime import date, time
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.content import command_files
from ..files.numbers import MM_PER_UNIT, length_text
from ..files.outputs import check_outputs, writing
from ..files.writing import write_bytes_atomically
from ..poses.pose_file import POSE_KEY
from ..transforms import is_same_pose
from .case_file import Case, Structure, case_from_text, read_case
from .case_history import add_to_history
from .frame import UnreadFrame
from .landmarks import Landmark

UNIT_OF = {factor: unit for unit, factor in MM_PER_UNIT.items()}


def write_case(path: Path | str, case: Case, *, comment: str = "") -> None:
    """Write a case as TOML, whole or not at all.

    A pose that is replaced goes into the file's history.

    Numbers are read back to the last bit, colours of structures as 8-bit codes. File names are relative to the folder
    of ``path``, not of ``case.path``, unless a file is on another drive.

    Parameters
    ----------
    path
        The file, ``*.toml``; its folder exists.
    case
        The case; its ``messages`` are not written.
    comment
        Lines for the beginning of the file.
    """
    path = Path(path)
    if path == case.path:
        command_files().grants(path)
    check_outputs([case_output(path)], {name: file for name, file in case.input_files().items() if name != "case"})
    text = case_text(path, case, comment=comment)
    data = encoded(path, text)
    case_from_text(text, path)
    before = _present(path)
    with writing(path):
        if before is not None and _is_replaced(before, case):
            add_to_history(path, before, case_text(path, before))
        write_bytes_atomically(path, data)


def _present(path: Path) -> Case | None:
    try:
        return read_case(path, posed=False)
    except InputError:
        return None


def _is_replaced(before: Case, after: Case) -> bool:
    """Whether a case loses its pose by another one, or what is known of it."""
    is_kept = after.posed and is_same_pose(before.cam_from_mesh, after.cam_from_mesh)
    return not is_kept or before.alignment != after.alignment or before.image != after.image


def encoded(path: Path, text: str) -> bytes:
    """The bytes of a case file."""
    try:
        return text.encode()
    except UnicodeEncodeError:
        raise InputError(f"{path.name}: expected names in Unicode, found one that is not; rename the file") from None


def case_output(path: Path) -> Path:
    """The name of a case file to write, checked."""
    if path.suffix.lower() != ".toml":
        raise InputError(f"{path}: expected the name of a case file, *.toml, found {path.name!r}; choose another name")
    return path


def case_text(path: Path, case: Case, *, comment: str = "") -> str:
    """The text that :func:`write_case` writes."""
    folder = path.parent
    blocks = [
        [*(f"# {line}" for line in comment.splitlines()), f'units = "{UNIT_OF[case.mm_per_unit]}"'],
        ["[frame]", f"image = {_file(case.image, folder)}", *_pairs(_frame_keys(case))],
        _camera_lines(case),
        ["[surface]", f"mesh = {_file(case.mesh, folder)}", *_pairs(_given(name=case.object_name))],
    ]
    if case.posed:
        rows = _rows(_pose_texts(case.cam_from_mesh, case.mm_per_unit))
        axes = "# OpenCV axes (x right, y down, z forward), frame of the mesh file"
        blocks.append(["[pose]", axes, f"{POSE_KEY} = {rows}"])
    blocks += [_frame_lines(frame, case, folder) for frame in case.frames]
    if record := case.alignment.table():
        blocks.append(["[alignment]", *_pairs(record)])
    if case.light is not None:
        blocks.append(["[light]", *_pairs({**case.light.law, **case.light.origin})])
    blocks += [_landmark_lines(landmark, case.mm_per_unit) for landmark in case.landmarks]
    blocks += [_structure_lines(structure, folder) for structure in case.structures]
    if case.dataset:
        blocks.append(["[dataset]", *_pairs(relocated_options(case.dataset, case.path.parent, folder))])
    return "\n\n".join("\n".join(lines) for lines in blocks) + "\n"


def _frame_keys(case: Case) -> dict[str, object]:
    video = {} if case.video is None else dict(zip(("video", "video_frame"), case.video, strict=True))
    return {**video, **({"refused": case.refused} if case.refused else {})}


def _given(**values: object) -> dict[str, object]:
    return {name: value for name, value in values.items() if value is not None}


def _camera_lines(case: Case) -> list[str]:
    lines = [
        "[camera]",
        f"size = {toml_value(case.camera.size_wh)}",
        f"K = {_rows([[repr(value) for value in row] for row in case.camera.k.tolist()])}",
        'pixel_origin = "center"  # (0, 0) is the centre of the top-left pixel',
    ]
    if case.distortion is not None:
        lines.append(f"distortion = {toml_value(astuple(case.distortion))}  # OpenCV: k1, k2, p1, p2, k3")
    return lines


def _frame_lines(frame: UnreadFrame, case: Case, folder: Path) -> list[str]:
    lines = ["[[frames]]", f"image = {_file(frame.image, folder)}"]
    if (frame.camera, frame.distortion) != (case.camera, case.distortion):
        distortion = None if frame.distortion is None else astuple(frame.distortion)
        camera = _given(size=frame.camera.size_wh, K=frame.camera.k, distortion=distortion)
        lines.append(f"camera = {toml_value(camera)}")
    return [*lines, f"{POSE_KEY} = {_rows(_pose_texts(frame.cam_from_mesh, case.mm_per_unit))}"]


def _landmark_lines(landmark: Landmark, mm_per_unit: float) -> list[str]:
    lines = ["[[landmarks]]", f"name = {toml_value(landmark.name)}"]
    if landmark.point is not None:
        lines.append(f"surface = [{', '.join(length_text(value, mm_per_unit) for value in landmark.point)}]")
    if landmark.pixel is not None:
        lines.append(f"pixel = {toml_value([float(value) for value in landmark.pixel])}")
    if not landmark.enabled:
        lines.append("enabled = false")
    return lines


def _structure_lines(structure: Structure, folder: Path) -> list[str]:
    codes = [round(min(max(value, 0.0), 1.0) * 255) for value in structure.colour]
    return [
        "[[structures]]",
        f"name = {toml_value(structure.name)}",
        f"mesh = {_file(structure.mesh, folder)}",
        f'color = "#{bytes(codes).hex()}"',
    ]


def _pose_texts(cam_from_mesh: np.ndarray, mm_per_unit: float) -> list[list[str]]:
    texts = [[repr(value) for value in row] for row in cam_from_mesh.tolist()]
    for row in range(3):
        texts[row][3] = length_text(float(cam_from_mesh[row, 3]), mm_per_unit)
    return texts


def _rows(texts: Iterable[Sequence[str]]) -> str:
    return "[\n" + "".join(f"  [{', '.join(row)}],\n" for row in texts) + "]"


def _pairs(table: Mapping[str, object]) -> list[str]:
    bare = re.compile(r"[A-Za-z0-9_-]+")
    return [f"{key if bare.fullmatch(key) else toml_value(key)} = {toml_value(value)}" for key, value in table.items()]


def relocated_options(dataset: Mapping[str, object], folder: Path, new_folder: Path) -> dict[str, object]:
    """The table for a case file in another folder: ``poses`` names a file relative to the case file."""
    poses = dataset.get("poses")
    if folder == new_folder or not isinstance(poses, str):
        return dict(dataset)
    return {**dataset, "poses": relative_name(folder / poses, new_folder)}


def _file(path: Path, folder: Path) -> str:
    return toml_value(relative_name(path, folder))


def relative_name(path: Path, folder: Path) -> str:
    """A file's path relative to a folder, with slashes on every system; absolute if it is on another drive."""
    if path.is_relative_to(folder):
        return path.relative_to(folder).as_posix()
    # ".." goes to the parent of a link's target, so no folder on the way may be a link
    target = Path(os.path.realpath(path.parent)) / path.name
    try:
        return Path(os.path.relpath(target, os.path.realpath(folder))).as_posix()
    except ValueError:
        return target.as_posix()


def toml_value(value: Any) -> str:
    """A value as TOML 1.0; tables become inline tables."""
    match value:
        case bool():
            return str(value).lower()
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case int():
            return str(int(value))
        case float():
            return repr(float(value))
        case date() | time():
            return value.isoformat()
        case Mapping():
            return "{" + ", ".join(_pairs(value)) + "}"
        case list() | tuple():
            return f"[{', '.join(map(toml_value, value))}]"
        case np.generic() | np.ndarray():
            return toml_value(value.tolist())
    raise InputError(f"expected a value that TOML can hold, found {value!r}")
