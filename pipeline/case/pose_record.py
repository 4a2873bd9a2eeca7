"""The record of a pose: how it was found and how sure it is; the optional table ``[alignment]`` of a case file."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from datetime import date
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.keys import check_keys, described
from ..files.numbers import is_number

INITIAL_GUESS = "initial guess"
"""Method of a pose that was computed without the frame: nobody has aligned it."""

FURTHER_FRAMES = "further frames"
"""Method of a pose that was corrected by further frames of the surface."""

REGISTERED = "registered"
"""Method of a pose that was found by what an aligned frame of the surface shows."""

OTHER_FRAME = "another frame"
"""Method of a pose that was found in another frame: a start for this one."""

FROM_IMAGE = ("refined", FURTHER_FRAMES, REGISTERED)
"""Methods of poses that the image or other frames have found: neither landmarks nor hands replace them unasked."""

_SHAPES: dict[str, tuple[int, ...]] = {
    "standard_deviation_deg": (3,),
    "standard_deviation_mm": (3,),
    "covariance_mm_rad": (6, 6),
    "pivot_mesh_mm": (3,),
}


@dataclass(frozen=True)
class PoseRecord:
    """How a pose was found, and how sure it is: a text is empty, and a number ``None``, where nothing is recorded.

    Attributes
    ----------
    method
        How the pose was found, in words: "landmarks", "pins", "refined", "manual"; :data:`REGISTERED`,
        :data:`FURTHER_FRAMES`, :data:`INITIAL_GUESS`, :data:`OTHER_FRAME`.
    tool, date
        Program and version; day or time in ISO 8601.
    checked
        Day on which a person has looked at the pose and found it right.
    doubt
        Why the pose may be wrong altogether: several fit the landmarks, none does, it was found in another frame, or
        little of the frame agrees with it.
    refused
        Why the refinement was refused, whose result the user took all the same.
    probability
        That a registered pose is right, 0..1.
    start_frame, start_method
        File of the aligned frame to which this one was registered; method of that frame's pose, or of the initial
        pose of a refinement.
    pairs, rms_px
        Number of correspondences that the pose was computed from, and their root mean square reprojection error.
    click_sigma_px
        The standard deviation of the click noise that the uncertainty assumes.
    error_px, start_error_px
        Estimated errors of the refined and of the initial pose: root mean square displacement of the visible surface.
    explained
        Fraction, 0..1, of the image's variation that the surface explains at the pose.
    moved_px, moved_deg
        From the initial pose: mean shift of the visible surface, and angle of rotation.
    standard_deviation_deg, standard_deviation_mm
        ``(3,)`` standard deviations of rotation and translation along the camera's x, y and z axis.
    covariance_mm_rad, pivot_mesh_mm, radius_mm
        Of a pose that was registered or corrected by further frames: the ``(6, 6)`` covariance of a twist
        in camera axes (mm, radians) about a pivot ``(3,)`` in the frame of the mesh, and the radius that makes
        rotations comparable with shifts.
    """

    method: str = ""
    tool: str = ""
    date: str = ""
    checked: str = ""
    doubt: str = ""
    refused: str = ""
    probability: float | None = None
    start_frame: str = ""
    start_method: str = ""
    pairs: int | None = None
    rms_px: float | None = None
    click_sigma_px: float | None = None
    error_px: float | None = None
    start_error_px: float | None = None
    explained: float | None = None
    moved_px: float | None = None
    moved_deg: float | None = None
    standard_deviation_deg: tuple[float, ...] | None = None
    standard_deviation_mm: tuple[float, ...] | None = None
    covariance_mm_rad: tuple[tuple[float, ...], ...] | None = None
    pivot_mesh_mm: tuple[float, ...] | None = None
    radius_mm: float | None = None

    @classmethod
    def of_table(cls, table: object, where: str) -> "PoseRecord":
        """From a table of the fields, each of which may be missing; ``where`` begins messages."""
        if not isinstance(table, Mapping):
            raise InputError(f"{where}: expected a table, found {described(table)}")
        kinds = {field.name: field.type for field in fields(cls)}
        check_keys(table, (), tuple(kinds), f"{where} ")
        return cls(**{key: _checked(key, kinds[key], value, f"{where} {key}") for key, value in table.items()})

    def table(self) -> dict[str, Any]:
        """What is recorded, in the order of the fields."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {key: value for key, value in values.items() if value not in (None, "")}

    @property
    def has_covariance(self) -> bool:
        """Whether a covariance is recorded with all that belongs to it."""
        return None not in (self.covariance_mm_rad, self.pivot_mesh_mm, self.radius_mm)

    @property
    def is_start(self) -> bool:
        """Whether nobody has aligned the pose in its frame."""
        return self.method in (INITIAL_GUESS, OTHER_FRAME)

    @property
    def is_from_image(self) -> bool:
        """Whether the pose was found in the image or in other frames."""
        return self.method in FROM_IMAGE

    @property
    def is_settled(self) -> bool:
        """Whether the pose was found in the image or in other frames, or checked by a person."""
        return self.is_from_image or bool(self.checked)

    def scaled(self, factor: float) -> "PoseRecord":
        """The record of the same pose with the surface scaled about the camera's centre: pixels and angles stay."""
        scale = np.array([factor] * 3 + [1.0] * 3)
        factors = {
            "standard_deviation_mm": factor,
            "covariance_mm_rad": np.outer(scale, scale),
            "pivot_mesh_mm": factor,
            "radius_mm": factor,
        }
        lengths = {key: getattr(self, key) for key in factors if getattr(self, key) is not None}
        return replace(self, **{key: _plain(factors[key] * np.array(value)) for key, value in lengths.items()})


UNKNOWN = PoseRecord()
"""Of a pose of which nobody knows how it was found."""


def _plain(values: np.ndarray) -> Any:
    """The same as floats in tuples."""
    return float(values) if values.ndim == 0 else tuple(map(_plain, values))


def _checked(key: str, kind: Any, value: Any, where: str) -> Any:
    if kind is str:
        if isinstance(value, date):  # TOML has dates; a datetime is a date too
            return value.isoformat()
        if not isinstance(value, str):
            raise InputError(f"{where}: expected text, found {described(value)}")
        return value
    if (shape := _SHAPES.get(key)) is None:
        if not is_number(value) or value < 0:
            raise InputError(f"{where}: expected a number from 0, found {described(value)}")
        return int(value) if key == "pairs" else float(value)
    try:
        values = np.array(value)
    except ValueError:  # rows of several lengths
        values = np.empty(0)
    if values.shape != shape or values.dtype.kind not in "iuf" or not np.isfinite(values).all():
        raise InputError(f"{where}: expected {' x '.join(map(str, shape))} finite numbers, found {described(value)}")
    values = values.astype(np.float64)
    if key.startswith("standard_deviation") and values.min() < 0:
        raise InputError(f"{where}: expected numbers from 0, found {described(value)}")
    if key == "covariance_mm_rad" and (not np.allclose(values, values.T) or np.linalg.eigvalsh(values)[0] <= 0):
        raise InputError(f"{where}: expected a covariance, symmetric and positive definite; refine again")
    return _plain(values)
