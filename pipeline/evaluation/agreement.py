"""Two annotators: how far apart their poses of the same frames are, and how far their stated errors let expect."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.pinhole import PinholeCamera
from ..case.case_file import Case, read_case
from ..case.case_folder import CASE
from ..case.case_queue import queued_cases
from ..case.loaded_case import LoadedCase, frame_overlay, load_case
from ..errors import InputError, naming
from ..images.contact_sheet import contact_sheet
from ..images.pixel_values import to_uint8
from ..projection.z_buffer import rasterise_depth
from ..transforms import rotation_angle_deg, transform_points

SAME_MM = 1e-3
"""Vertices that are nearer to each other are the same: copies of a mesh are in single precision."""

HEADER = ("case", "angle_deg", "shift_mm", "px", "expected_px")
"""Columns of the table, whose rows are each an :class:`Agreement`."""


@dataclass(frozen=True)
class Agreement:
    """Two poses of one frame.

    Attributes
    ----------
    name
        Of the case.
    angle_deg, shift_mm
        Between the poses: rotation, and distance of the middle of the visible surface.
    px
        Root mean square distance of the visible surface in the image.
    expected_px
        The same as the errors that both cases state let expect, if these are independent; NaN where one states none.
    """

    name: str
    angle_deg: float
    shift_mm: float
    px: float
    expected_px: float

    @property
    def row(self) -> tuple[object, ...]:
        """Cells of the table, in the order of :data:`HEADER`."""
        return self.name, self.angle_deg, self.shift_mm, self.px, self.expected_px


def paired_cases(first: Path, second: Path) -> list[tuple[str, Case, Case]]:
    """The cases of two queues that have the same name and a pose in both; or two case files.

    Raises
    ------
    InputError
        There are none, a case cannot be read, or two of one name differ in frame size, K or distortion.
    """
    if first.is_file() and second.is_file():
        pairs = [(first.stem, read_case(first), read_case(second))]
    else:
        pairs = []
        for path in queued_cases(first):
            name = path.parent.name
            if (same := second / name / CASE).is_file():
                with naming(name):
                    one, other = read_case(path, posed=False), read_case(same, posed=False)
                pairs += [(name, one, other)] if one.posed and other.posed else []
    if not pairs:
        raise InputError(f"{first}, {second}: expected cases of the same names with a pose in both, found none")
    for name, one, other in pairs:
        if (one.camera, one.distortion) != (other.camera, other.distortion):
            raise InputError(
                f"{name}: expected the same K, distortion and frame size in both, found others in {second}"
            )
    return pairs


def agreement(name: str, one: LoadedCase, other: LoadedCase) -> Agreement:
    """How far two poses of a frame are apart, over the part of the surface that the first one shows."""
    camera, pose = one.frame.camera, one.frame.cam_from_model
    # the same point of the bone in both, whichever origin the files have
    other_pose = other.frame.cam_from_model @ np.linalg.inv(other.surface.mesh_from_model) @ one.surface.mesh_from_model
    mesh = one.surface.mesh
    face = rasterise_depth(mesh, camera, pose).face
    points = mesh.vertices[np.unique(mesh.faces[np.unique(face[face >= 0])])]
    if len(points) == 0:
        raise InputError(f"{name}: expected a pose that shows the surface, found one that does not")
    here, there = transform_points(pose, points), transform_points(other_pose, points)
    apart = camera.project(there) - camera.project(here)
    stated = [_stated_px(case, points, camera, at) for case, at in ((one, pose), (other, other_pose))]
    return Agreement(
        name,
        rotation_angle_deg(other_pose[:3, :3] @ pose[:3, :3].T),
        float(np.linalg.norm(there.mean(axis=0) - here.mean(axis=0))),
        float(np.sqrt(np.nanmean((apart**2).sum(axis=1)))),
        float(np.hypot(stated[0], stated[1])),
    )


def agreements(pairs: Sequence[tuple[str, Case, Case]]) -> Iterator[tuple[Agreement, LoadedCase, LoadedCase]]:
    """Each pair's agreement, with its cases.

    Raises
    ------
    InputError
        A case cannot be loaded, or the two are not of one photograph and one surface.
    """
    for name, *cases in pairs:
        with naming(name):
            one, other = (load_case(case) for case in cases)
            _check_alike(one, other)
        yield agreement(name, one, other), one, other


def _check_alike(one: LoadedCase, other: LoadedCase) -> None:
    """Check that two cases show the same photograph, where neither masks it, and the same surface."""
    shown = one.frame.valid & other.frame.valid
    if not np.array_equal(to_uint8(one.frame.image)[shown], to_uint8(other.frame.image)[shown]):
        raise InputError(
            f"expected the same photograph in both, found other pixels in {other.case.image}; leave the case out"
        )
    here, there = (case.surface.mesh.moved(case.surface.mesh_from_model[:3, 3]) for case in (one, other))
    if not (
        np.array_equal(here.faces, there.faces)
        and here.vertices.shape == there.vertices.shape
        and np.allclose(here.vertices, there.vertices, rtol=0, atol=SAME_MM)
    ):
        raise InputError(
            f"expected the same surface in both, found another one in {other.case.mesh}; leave the case out"
        )


def pair_picture(one: LoadedCase, other: LoadedCase) -> np.ndarray:
    """``(H, W, 3)`` uint8: the frame with the overlay at both poses, side by side."""
    images = [frame_overlay(case) for case in (one, other)]
    return to_uint8(contact_sheet(images, columns=2, tile_width=images[0].shape[1]))


def summary(found: Sequence[Agreement]) -> list[str]:
    """Medians and worst of all pairs, and what their stated errors let expect, in lines."""
    table = np.array([each.row[1:] for each in found], float)
    middle, worst = np.median(table[:, :3], axis=0), max(found, key=lambda each: each.px)
    lines = [
        f"{len(found)} pairs of poses: median {middle[0]:.2f} degrees, {middle[1]:.2f} mm, {middle[2]:.1f} px; "
        f"worst {worst.px:.1f} px in {worst.name}"
    ]
    known = np.isfinite(table[:, 3]) & (table[:, 3] > 0)
    if known.any():
        ratio = float(np.median(table[known, 2] / table[known, 3]))
        lines.append(
            f"{known.sum()} of them state their errors: apart by {ratio:.1f} times what these let expect (median)"
        )
    return lines


def _stated_px(loaded: LoadedCase, points: np.ndarray, camera: PinholeCamera, pose: np.ndarray) -> float:
    """Root mean square error in the image that a case states: its own, or that of its standard deviations."""
    record: Mapping[str, Any] = loaded.case.alignment
    if "error_px" in record:
        return float(record["error_px"])
    uncertainty = PoseUncertainty.stated(record, points, pose, loaded.surface.mesh_from_model)
    if uncertainty is None:
        return np.nan
    spreads = uncertainty.pixel_covariances(points, camera, pose)
    return float(np.sqrt(np.nanmean(np.trace(spreads, axis1=1, axis2=2))))
