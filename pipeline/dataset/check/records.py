"""A dataset's identity and the records of its views, read strictly: every number that the check needs must be there.

Written from the description of the format and, except for file names, independent of the code that writes it.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ...files.content import read_content
from ...files.tables import parsed_json
from ..layout import FORMAT, RECORD, ViewPaths

ROTATION_TOLERANCE = 1e-9
GT_INFO_COUNTS = ("px_count_all", "px_count_valid", "px_count_visib")


class DamagedFile(ValueError):
    """A file of a dataset is missing or does not hold what it should; the message names the file."""


@dataclass(frozen=True)
class Identity:
    """The content of ``dataset.json``.

    Attributes
    ----------
    count
        Number of views.
    object_name
        Name of the surface.
    camera
        Intrinsics of the views.
    mesh_from_model
        4x4, mm.
    kinds
        Kinds of a view's files, without its record.
    anti_aliased
        Whether the colour images have soft edges.
    """

    count: int
    object_name: str
    camera: PinholeCamera
    mesh_from_model: np.ndarray
    kinds: tuple[str, ...]
    anti_aliased: bool


@dataclass(frozen=True)
class ViewRecord:
    """The record of a finished view; see :mod:`pipeline.dataset.bop` for the meaning of ``gt_info``.

    Attributes
    ----------
    where
        Its file, relative to the dataset, for messages.
    rotation, translation
        The record's lists of 9 and 3 numbers: ``cam_from_model``, row-major, mm.
    cam_from_model
        The same as a 4x4 matrix.
    depth_scale
        mm per unit of the depth image.
    gt_info
        Entry of ``scene_gt_info``.
    observed
        Pixels of ``mask_observed``.
    run_lengths
        ``(N,)`` run lengths of the visible mask, column by column, zeros first.
    sha256
        Hash of every file, by path relative to the dataset.
    """

    where: str
    rotation: list[float]
    translation: list[float]
    cam_from_model: np.ndarray
    depth_scale: float
    gt_info: dict
    observed: int
    run_lengths: np.ndarray
    sha256: dict[str, str]


def read_identity(root: Path) -> Identity:
    """Read ``dataset.json``.

    Raises
    ------
    DamagedFile
        The file is missing, or a value in it is missing or wrong.
    InputError
        The file is intact, but of another format.
    """
    content = read_object(root / RECORD, RECORD)
    if content.get("format") != FORMAT:
        raise InputError(
            f"{root / RECORD}: expected the format {FORMAT!r}, found {content.get('format')!r}; "
            "check the dataset with the version that made it"
        )
    count, object_name = whole_number(content, "count", RECORD, least=1), content.get("object")
    if not isinstance(object_name, str):
        raise DamagedFile(f"{RECORD}: expected object to be a name, found {shortened(object_name)}")
    options, given = mapping(content, "options", RECORD), mapping(content, "camera", RECORD)
    width, height = (whole_number(given, side, f"{RECORD}: camera", least=1) for side in ("width", "height"))
    k = numbers(given, "K", (3, 3), f"{RECORD}: camera")
    try:
        camera = PinholeCamera.from_matrix(k, size=(width, height), where=f"{RECORD}: camera K")
    except InputError as error:
        raise DamagedFile(str(error)) from None
    for name in ("fx", "fy", "cx", "cy"):
        if given.get(name) != getattr(camera, name):
            raise DamagedFile(f"{RECORD}: camera: {name} is {given.get(name)!r}, K has {getattr(camera, name)!r}")
    mesh_from_model = numbers(content, "mesh_from_model", (4, 4), RECORD)
    check_rotation(mesh_from_model[:3, :3], f"{RECORD}: mesh_from_model")
    frame = numbers(mapping(content, "frame", RECORD), "cam_from_model", (4, 4), f"{RECORD}: frame")
    check_rotation(frame[:3, :3], f"{RECORD}: frame: cam_from_model")
    float_depth = ("depth_mm",) if options.get("float_depth") else ()
    return Identity(
        count=count,
        object_name=object_name,
        camera=camera,
        mesh_from_model=mesh_from_model,
        kinds=("rgb", "depth", "mask", "mask_visib", "mask_observed", *float_depth),
        anti_aliased=whole_number(options, "samples", f"{RECORD}: options", least=1) > 1,
    )


def read_view_record(paths: ViewPaths, kinds: tuple[str, ...]) -> ViewRecord:
    """Read ``frame/NNNNNN.json`` of a view that has files of these kinds.

    Raises
    ------
    DamagedFile
        The file is missing, or a value in it is missing or wrong.
    """
    where = paths.relative("frame")
    content = read_object(paths.file("frame"), where)
    if content.get("index") != paths.index:
        raise DamagedFile(f"{where}: expected the record of view {paths.index}, found index {content.get('index')!r}")
    cam_from_model = np.eye(4)
    cam_from_model[:3, :3] = numbers(content, "cam_R_m2c", (9,), where).reshape(3, 3)
    cam_from_model[:3, 3] = numbers(content, "cam_t_m2c", (3,), where)
    check_rotation(cam_from_model[:3, :3], f"{where}: cam_R_m2c")
    depth_scale = float(numbers(content, "depth_scale", (), where))
    if depth_scale <= 0:
        raise DamagedFile(f"{where}: expected a positive depth_scale, found {depth_scale:g}")
    gt_info = mapping(content, "gt_info", where)
    for name in GT_INFO_COUNTS:
        whole_number(gt_info, name, f"{where}: gt_info")
    for name in ("bbox_obj", "bbox_visib"):
        numbers(gt_info, name, (4,), f"{where}: gt_info")
    numbers(gt_info, "visib_fract", (), f"{where}: gt_info")
    files = mapping(content, "files", where)
    sha256 = {name: str(mapping(files, name, where).get("sha256")) for name in files}
    expected = {paths.relative(kind) for kind in kinds}
    if sha256.keys() != expected:
        different = ", ".join(sorted(sha256.keys() ^ expected)[:3])
        raise DamagedFile(
            f"{where}: expected sums of the view's {len(expected)} files, missing or unexpected: {different}"
        )
    return ViewRecord(
        where=where,
        rotation=content["cam_R_m2c"],
        translation=content["cam_t_m2c"],
        cam_from_model=cam_from_model,
        depth_scale=depth_scale,
        gt_info=gt_info,
        observed=whole_number(content, "px_count_observed", where),
        run_lengths=numbers(content, "rle_counts", None, where).astype(np.int64),
        sha256=sha256,
    )


def read_object(path: Path, where: str) -> dict:
    """Read the object in a JSON file.

    Raises
    ------
    DamagedFile
        Missing, unreadable, not JSON, not an object.
    """
    try:
        content = parsed_json(read_content(path, "a file of the dataset", where), where)
    except InputError as error:
        raise DamagedFile(str(error)) from None
    if not isinstance(content, dict):
        raise DamagedFile(f"{where}: expected an object, found {shortened(content)}")
    return content


def mapping(content: Mapping, key: str, where: str) -> dict:
    """The object at a key of an object; :class:`DamagedFile` if there is none."""
    value = content.get(key)
    if not isinstance(value, dict):
        raise DamagedFile(f"{where}: expected {key} with entries, found {shortened(value)}")
    return value


def numbers(content: Mapping, key: str, shape: tuple[int, ...] | None, where: str) -> np.ndarray:
    """The finite numbers of a shape (``None``: any list) at a key of an object; :class:`DamagedFile` if not there."""
    try:
        values = np.array(content[key], dtype=np.float64)
    except (KeyError, TypeError, ValueError):
        values = np.array(np.nan)
    fits = values.ndim == 1 if shape is None else values.shape == shape
    if not fits or not np.isfinite(values).all():
        meant = (
            "a list of numbers" if shape is None else " x ".join(map(str, shape)) + " numbers" if shape else "a number"
        )
        raise DamagedFile(f"{where}: expected {key} to be {meant}, found {shortened(content.get(key))}")
    return values


def whole_number(content: Mapping, key: str, where: str, *, least: int = 0) -> int:
    """The whole number at a key of an object; :class:`DamagedFile` if there is none."""
    value = content.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise DamagedFile(f"{where}: expected {key} to be a whole number from {least}, found {shortened(value)}")
    return value


def check_rotation(rotation: np.ndarray, where: str) -> None:
    """Check that a ``(3, 3)`` matrix is orthonormal with determinant 1; :class:`DamagedFile` if not."""
    deviation = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if deviation > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise DamagedFile(
            f"{where}: expected a rotation, found a matrix off by {deviation:.2g} with determinant "
            f"{np.linalg.det(rotation):.6g}"
        )


def shortened(value: object) -> str:
    """A value as JSON of at most 60 characters, for messages."""
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
