"""What a dataset is made from: the content of ``dataset.json``."""

from collections.abc import Mapping
from dataclasses import asdict
from importlib import import_module
from pathlib import Path

import numpy as np

from .. import __version__
from ..camera.pinhole import PinholeCamera
from ..case.case_file import Case
from ..case.frame import UnreadFrame
from ..case.loaded_case import LoadedCase
from ..errors import InputError
from ..files.content import hashed_reading, read_content
from ..files.keys import file_and_place
from ..images.png import DEFLATE
from ..poses.distributions import PoseDistribution, ReferencePose, Trajectory, farthest_listed_mm
from .identity import COUNT, DEPTH_SCALE, POSES_HASH, geometry_hash, poses_hash
from .layout import FORMAT
from .options import NONE, SAMPLERS, DatasetOptions
from .truths import depth_scale_for

POSES = "poses"
"""Name of the list of poses among the input files."""


def input_files(case: Case, options: DatasetOptions) -> dict[str, Path]:
    """The files that the views depend on, by their names in the description; the list of poses is :data:`POSES`.

    The case file is not among them: its values are in the description, and its text may change, e.g. by landmarks,
    comments or a video.
    """
    files = {name: path for name, path in case.input_files().items() if name != "case"}
    if options.poses is not None:
        files[POSES], _ = file_and_place(Path(options.poses))
    return files


def inputs_sha256(files: Mapping[str, Path]) -> dict[str, str]:
    """SHA-256 of the files as they are now, by their names."""
    with hashed_reading() as hashes:
        for path in files.values():
            read_content(path, "an input of the dataset")
    return {name: hashes[path] for name, path in files.items()}


def describe(
    loaded: LoadedCase,
    options: DatasetOptions,
    poses: np.ndarray | None,
    *,
    hashes: Mapping[str, str],
    blender: str,
) -> dict[str, object]:
    """Describe a dataset: everything that it depends on, or that its users need; JSON types and tuples only.

    Parameters
    ----------
    loaded, options
        The case and the options.
    poses
        ``(N, 4, 4)`` listed ``cam_from_model``, mm, which replace the count; ``None`` if they are drawn.
    hashes
        SHA-256 of each of the :func:`input_files`, by name.
    blender
        Blender's version.
    """
    case, camera = loaded.case, view_camera(loaded, options)
    count = options.count if poses is None else len(poses)
    content = options.content()
    if poses is None and not SAMPLERS[options.sampler].grows:
        content["views"] = count  # each pose depends on it
    frames = [described_frame(frame, loaded.surface.mesh_from_model) for frame in case.every_frame]
    listed: dict[str, object] = {}
    if poses is not None:
        listed = {
            POSES_HASH: poses_hash(poses),
            DEPTH_SCALE: depth_scale_for(farthest_listed_mm(poses, loaded.surface.mesh.radius)),
        }
    return {
        "format": FORMAT,
        "versions": {"oneframe": __version__, "blender": blender, "deflate": DEFLATE},
        "conventions": "mm; OpenCV camera axes; pixel (0, 0): centre of the top-left pixel; b_from_a matrices",
        COUNT: count,
        "object": object_name(case),
        "options": content,
        "camera": {**asdict(camera), "K": camera.k.tolist()},
        "frame": frames[0],
        # a dataset of one frame is described as ever
        **({"frames": frames[1:]} if case.frames else {}),
        "mesh_from_model": loaded.surface.mesh_from_model.tolist(),
        **_described_light(loaded, options),
        "mm_per_unit": case.mm_per_unit,
        "geometry_sha256": geometry_hash(loaded.surface.mesh),
        "structures": {structure.name: list(structure.colour) for structure in case.structures},
        # of the list of poses, the poses themselves count, and only those of the views
        "inputs_sha256": {name: digest for name, digest in hashes.items() if name != POSES},
        **listed,
    }


def _described_light(loaded: LoadedCase, options: DatasetOptions) -> dict[str, object]:
    return {} if options.light == NONE else {"light": loaded.case.lens_light.law}


def described_frame(frame: UnreadFrame, mesh_from_model: np.ndarray) -> dict[str, object]:
    """Camera and pose of a frame in the description; the pose is computed as from the file, to the last bit."""
    return {
        **asdict(frame.camera),
        "distortion": None if frame.distortion is None else asdict(frame.distortion),
        "cam_from_model": (frame.cam_from_mesh @ mesh_from_model).tolist(),
    }


def object_name(case: Case) -> str:
    """Name of the surface in the dataset's tables: the case's; never that of its file, which may name the patient."""
    return case.object_name or "surface"


def view_camera(loaded: LoadedCase, options: DatasetOptions) -> PinholeCamera:
    """The intrinsics of the views: the frame's, scaled as in the options."""
    camera = loaded.frame.camera
    if options.scale == 1.0:
        return camera
    width, height = (round(size * options.scale) for size in camera.size_wh)
    if min(width, height) < 1:
        raise InputError(f"--scale: expected views of at least 1 px, {options.scale:g} gives {width}x{height}")
    return camera.resized(width, height)


def distribution_of(options: DatasetOptions, reference: ReferencePose, camera: PinholeCamera) -> PoseDistribution:
    """The distribution that options name, around a reference, for views with these intrinsics."""
    sampler = SAMPLERS[options.sampler]
    module, name = sampler.place.split(":")
    kind = getattr(import_module(f"..poses.{module}", __package__), name)
    distribution: PoseDistribution = kind.of(reference, _middle_ray(camera), sampler.values(options))
    return distribution


def trajectory_of(options: DatasetOptions, reference: ReferencePose, camera: PinholeCamera) -> Trajectory:
    """The path of the video, within the limits of the options."""
    return Trajectory.of(reference, _middle_ray(camera), SAMPLERS["trajectory"].values(options))


def _middle_ray(camera: PinholeCamera) -> np.ndarray:
    middle: np.ndarray = camera.rays_cam(np.array([[(camera.width - 1) / 2, (camera.height - 1) / 2]]))[0]
    return middle
