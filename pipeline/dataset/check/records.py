"""A dataset's description and the records of its views, read strictly: the keys of the format and no others.

Written from the description of the format and, except for file names, independent of the code that writes it.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...camera.pinhole import PinholeCamera
from ...errors import InputError
from ..layout import FORMAT, RECORD, ViewPaths
from ..options import option_names
from .checksums import HASH, FileSum, identity_of, read_sums
from .comparison import require_equal
from .files import (
    LARGEST_SMALL_FILE,
    DamagedFile,
    check_rotation,
    mapping,
    numbers,
    parsed_object,
    read_bytes,
    read_object,
    require_keys,
    shortened,
    whole_number,
)
from .png import LARGEST_IMAGE_PX

MOST_VIEWS = 10_000_000
LARGEST_RECORD = 16 << 20
GT_INFO_COUNTS = ("px_count_all", "px_count_valid", "px_count_visib")
DESCRIPTION_KEYS = {
    "format", "versions", "conventions", "count", "object", "options", "camera", "frame", "mesh_from_model",
    "mm_per_unit", "geometry_sha256", "structures", "inputs_sha256",
}  # fmt: skip
LISTED_KEYS = {"poses_sha256", "depth_scale"}
"""Keys of a dataset whose poses were listed."""
CAMERA_KEYS = {"width", "height", "fx", "fy", "cx", "cy"}
ELSEWHERE = {"count", "poses", "video", "video_frames"}
"""Options that the description does not list among the others."""
RECORD_KEYS = {
    "index", "identity", "cam_R_m2c", "cam_t_m2c", "depth_scale", "gt_info", "px_count_observed", "attempts",
    "rejections", "files", "rle_counts",
}  # fmt: skip


@dataclass(frozen=True)
class Description:
    """The content of ``dataset.json``.

    Attributes
    ----------
    content
        The whole object.
    identity
        Its identity, which every record repeats.
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
    """

    content: dict[str, Any]
    identity: str
    count: int
    object_name: str
    camera: PinholeCamera
    mesh_from_model: np.ndarray
    kinds: tuple[str, ...]

    @property
    def poses_hash(self) -> str | None:
        """SHA-256 of the poses if they were listed; ``None`` if they were drawn."""
        return self.content.get("poses_sha256")

    @property
    def poses_differ(self) -> bool:
        """Whether no two views have the same pose: none of a sampler that draws, unless it cannot but repeat itself.

        A trajectory may cross itself, and a list may hold a pose twice.
        """
        options = self.content["options"]
        spread = {
            "cone": ("cone_deg", "roll_deg", "shift_mm"),
            "gaussian": ("sigma_deg", "sigma_mm"),
            "shell": ("polar_deg", "roll_deg"),
        }
        names = spread.get(str(options["sampler"]), ())
        distances = options["sampler"] in ("cone", "shell") and options["distance_min"] != options["distance_max"]
        return self.poses_hash is None and (distances or any(options[name] for name in names))


@dataclass(frozen=True)
class ViewRecord:
    """The record of a finished view; see :mod:`oneframe.dataset.bop` for the meaning of ``gt_info``.

    Attributes
    ----------
    where
        Its file, relative to the dataset, for messages.
    data
        The bytes of the file.
    identity
        The dataset's identity, if the view belongs to it.
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
    files
        Sum of every file, by path relative to the dataset.
    """

    where: str
    data: bytes
    identity: object
    rotation: list[float]
    translation: list[float]
    cam_from_model: np.ndarray
    depth_scale: float
    gt_info: dict
    observed: int
    run_lengths: np.ndarray
    files: dict[str, FileSum]

    @property
    def pose_hash(self) -> bytes:
        """Equal for equal poses, short enough to keep for every view."""
        return hashlib.blake2b(self.cam_from_model.tobytes(), digest_size=16).digest()


def read_description(root: Path) -> Description:
    """Read ``dataset.json``.

    Raises
    ------
    DamagedFile
        The file is missing, or a value in it is missing or wrong.
    InputError
        The file is intact, but of another format.
    """
    content = read_object(root, RECORD)
    if content.get("format") != FORMAT:
        raise InputError(
            f"{root / RECORD}: expected the format {FORMAT!r}, found {shortened(content.get('format'))}; "
            "check the dataset with the version that made it"
        )
    listed = LISTED_KEYS & content.keys()
    options = mapping(content, "options", RECORD)
    if "setting" in content:
        raise InputError(
            f"{root / RECORD}: its views are of --quality {shortened(options.get('quality'))}, which this version does "
            "not have; check the dataset with the version that made it"
        )
    require_keys(content, DESCRIPTION_KEYS | (LISTED_KEYS if listed else set()), RECORD)
    count = whole_number(content, "count", RECORD, least=1, most=MOST_VIEWS)
    if not isinstance(content["object"], str):
        raise DamagedFile(f"{RECORD}: expected object to be a name, found {shortened(content['object'])}")
    given = mapping(content, "camera", RECORD)
    names = set(option_names()) - ELSEWHERE
    if options.get("sampler") == "trajectory" and not listed:
        # each pose of a trajectory depends on their number
        names.add("views")
        require_equal(options.get("views"), count, f"{RECORD}: options: views")
    require_keys(options, names, f"{RECORD}: options")
    camera = _camera(given)
    mesh_from_model = numbers(content, "mesh_from_model", (4, 4), RECORD)
    check_rotation(mesh_from_model[:3, :3], f"{RECORD}: mesh_from_model")
    frame = mapping(content, "frame", RECORD)
    require_keys(frame, CAMERA_KEYS | {"distortion", "cam_from_model"}, f"{RECORD}: frame")
    for side in ("width", "height"):
        whole_number(frame, side, f"{RECORD}: frame", least=1)
    cam_from_model = numbers(frame, "cam_from_model", (4, 4), f"{RECORD}: frame")
    check_rotation(cam_from_model[:3, :3], f"{RECORD}: frame: cam_from_model")
    if not numbers(content, "mm_per_unit", (), RECORD) > 0:
        raise DamagedFile(f"{RECORD}: expected mm_per_unit above 0, found {shortened(content['mm_per_unit'])}")
    require_keys(mapping(content, "versions", RECORD), {"oneframe", "blender"}, f"{RECORD}: versions")
    structures = mapping(content, "structures", RECORD)
    hashes = mapping(content, "inputs_sha256", RECORD)
    inputs = {"frame", "surface", *(f"structure {name}" for name in structures)}
    require_keys(hashes, inputs, f"{RECORD}: inputs_sha256")
    for name, digest in hashes.items():
        if not (isinstance(digest, str) and HASH.fullmatch(digest)):
            raise DamagedFile(f"{RECORD}: inputs_sha256: expected a SHA-256 of the {name}, found {shortened(digest)}")
    if listed:
        numbers(content, "depth_scale", (), RECORD)
        if not isinstance(content["poses_sha256"], str):
            raise DamagedFile(
                f"{RECORD}: expected poses_sha256 to be a hash, found {shortened(content['poses_sha256'])}"
            )
    whole_number(options, "samples", f"{RECORD}: options", least=1)
    float_depth = ("depth_mm",) if options["float_depth"] else ()
    return Description(
        content=content,
        identity=identity_of(content),
        count=count,
        object_name=content["object"],
        camera=camera,
        mesh_from_model=mesh_from_model,
        kinds=("rgb", "depth", "mask", "mask_visib", "mask_observed", *float_depth),
    )


def _camera(given: Mapping) -> PinholeCamera:
    where = f"{RECORD}: camera"
    require_keys(given, CAMERA_KEYS | {"K"}, where)
    width, height = (whole_number(given, side, where, least=1) for side in ("width", "height"))
    if width * height > LARGEST_IMAGE_PX:
        raise DamagedFile(f"{where}: expected at most {LARGEST_IMAGE_PX} px, found {width}x{height}")
    k = numbers(given, "K", (3, 3), where)
    try:
        camera = PinholeCamera.from_matrix(k, size=(width, height), where=f"{where} K")
    except InputError as error:
        raise DamagedFile(str(error)) from None
    for name in ("fx", "fy", "cx", "cy"):
        if given[name] != getattr(camera, name):
            raise DamagedFile(f"{where}: {name} is {shortened(given[name])}, K has {getattr(camera, name)!r}")
    return camera


def read_view_record(paths: ViewPaths, description: Description) -> ViewRecord:
    """Read ``frame/NNNNNN.json`` of a view of the dataset.

    Raises
    ------
    DamagedFile
        The file is missing, or a value in it is missing or wrong.
    """
    where, camera = paths.relative("frame"), description.camera
    # at worst, every pixel is a run of its own
    most = min(LARGEST_SMALL_FILE + 2 * camera.width * camera.height, LARGEST_RECORD)
    data = read_bytes(paths.root, where, most)
    content = parsed_object(data, where)
    if content.get("index") != paths.index:
        found = shortened(content.get("index"))
        raise DamagedFile(f"{where}: expected the record of view {paths.index}, found index {found}")
    require_keys(content, RECORD_KEYS, where)
    cam_from_model = np.eye(4)
    cam_from_model[:3, :3] = numbers(content, "cam_R_m2c", (9,), where).reshape(3, 3)
    cam_from_model[:3, 3] = numbers(content, "cam_t_m2c", (3,), where)
    check_rotation(cam_from_model[:3, :3], f"{where}: cam_R_m2c")
    depth_scale = float(numbers(content, "depth_scale", (), where))
    if depth_scale <= 0:
        raise DamagedFile(f"{where}: expected a positive depth_scale, found {depth_scale:g}")
    gt_info = mapping(content, "gt_info", where)
    require_keys(gt_info, {*GT_INFO_COUNTS, "bbox_obj", "bbox_visib", "visib_fract"}, f"{where}: gt_info")
    for name in GT_INFO_COUNTS:
        whole_number(gt_info, name, f"{where}: gt_info")
    for name in ("bbox_obj", "bbox_visib"):
        numbers(gt_info, name, (4,), f"{where}: gt_info")
    numbers(gt_info, "visib_fract", (), f"{where}: gt_info")
    _check_attempts(content, where)
    files = read_sums(mapping(content, "files", where), where)
    expected = {paths.relative(kind) for kind in description.kinds}
    if files.keys() != expected:
        different = ", ".join(sorted(files.keys() ^ expected)[:3])
        raise DamagedFile(
            f"{where}: expected sums of the view's {len(expected)} files, missing or unexpected: {different}"
        )
    return ViewRecord(
        where=where,
        data=data,
        identity=content["identity"],
        rotation=content["cam_R_m2c"],
        translation=content["cam_t_m2c"],
        cam_from_model=cam_from_model,
        depth_scale=depth_scale,
        gt_info=gt_info,
        observed=whole_number(content, "px_count_observed", where),
        run_lengths=numbers(content, "rle_counts", None, where).astype(np.int64),
        files=files,
    )


def _check_attempts(content: Mapping, where: str) -> None:
    """Every rejected pose broke one to three constraints; a pose from a list is the only one, whatever it broke."""
    attempts = whole_number(content, "attempts", where, least=1)
    rejections = mapping(content, "rejections", where)
    names = ("surface", "observed", "clearance")
    require_keys(rejections, set(names), f"{where}: rejections")
    broken = [whole_number(rejections, name, f"{where}: rejections") for name in names]
    rejected = attempts - 1
    if not (max(broken) <= rejected <= sum(broken) or (rejected == 0 and max(broken) <= 1)):
        raise DamagedFile(f"{where}: {attempts} attempts do not fit the rejections {shortened(rejections)}")
