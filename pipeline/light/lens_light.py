"""The light of a lamp at the lens, which moves with it, and what it does to a surface: lamp, ambient part, vignetting.

A matt surface sends back, in linear light, its albedo times

    (ambient + V max(cos θ, 0) (D / r)^falloff) cos(φ)^vignetting,

where θ is the angle between the surface's normal and the direction of the lamp, r the distance of the lamp, V 1 where
nothing stands between, φ the angle between the line of sight and the lens' axis, and D the :func:`working_distance_mm`
of the pose, at which the lamp counts 1: exposures follow the distance, as a microscope's do. What lamp and exposure are
worth together is part of the albedo. Vignetting of the lens and the spot of its lamp are one profile across the field;
in a cavity, whose walls light one another, it may be all that is left of the law.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date

import numpy as np

from ..errors import InputError
from ..files.keys import check_keys, described
from ..files.numbers import is_number
from ..images.transfer import SRGB, TRANSFERS, Transfer

PHYSICAL = 2.0
"""The falloff of a small lamp."""
STEEPEST = 4.0
MOST_VIGNETTING = 1000.0
FARTHEST_MM, FARTHEST_BEHIND_MM = 500.0, 100.0
"""How far a lamp may be from the lens, and how far behind it: the length of a microscope's head."""

LAMP_KEYS = ("lamp_cam_mm", "ambient")
ORIGIN_KEYS = (
    "method",
    "tool",
    "date",
    "frames",
    "explained",
    "standard_deviation_mm",
    "ambient_standard_deviation",
)
"""How a lamp was found: the method in words, program and version, day; how many frames; the part of their shading that
it explains, 0..1; the uncertainty of its place along the camera's axes, and of the ambient part.
"""
_TEXTS = ("method", "tool", "date")


@dataclass(frozen=True)
class LensLight:
    """A lamp that moves with the lens, and light that is the same from everywhere.

    Attributes
    ----------
    lamp_cam_mm
        Where the lamp is, camera axes, mm; ``None`` without one: the ambient part is all there is.
    ambient
        The ambient part, 0..1 of what the lamp gives a surface that faces it at the working distance.
    falloff
        Exponent of the distance.
    origin
        Where these come from, by :data:`ORIGIN_KEYS`; nothing is computed from it.
    transfer
        What the code values of the frames are: one of :data:`.TRANSFERS`.
    vignetting
        Exponent of the cosine between the line of sight and the lens' axis.
    """

    lamp_cam_mm: tuple[float, float, float] | None
    ambient: float
    falloff: float = PHYSICAL
    origin: Mapping[str, object] = field(default_factory=dict)
    transfer: str = "srgb"
    vignetting: float = 0.0

    def __post_init__(self) -> None:
        """Check the values."""
        lamp = np.asarray(self.place_cam_mm, np.float64)
        if lamp.shape != (3,) or not np.isfinite(lamp).all():
            raise InputError(f"lamp_cam_mm: expected three finite numbers, found {self.lamp_cam_mm!r}")
        if self.lamp_cam_mm is None and not self.vignetting:
            raise InputError("expected lamp_cam_mm, or vignetting above 0, found neither")
        if self.lamp_cam_mm is not None:
            object.__setattr__(self, "lamp_cam_mm", tuple(lamp.tolist()))
        away = float(np.linalg.norm(lamp))
        if away > FARTHEST_MM or lamp[2] < -FARTHEST_BEHIND_MM:
            raise InputError(
                f"lamp_cam_mm: expected a lamp at the lens, at most {FARTHEST_MM:g} mm from it and "
                f"{FARTHEST_BEHIND_MM:g} mm behind it, found one {away:.3g} mm away with z {lamp[2]:.3g} mm; give its "
                "place in the camera's axes (x right, y down, z forward), mm"
            )
        limits = (
            ("ambient", self.ambient, 1.0),
            ("falloff", self.falloff, STEEPEST),
            ("vignetting", self.vignetting, MOST_VIGNETTING),
        )
        for name, value, most in limits:
            if not (math.isfinite(value) and 0 <= value <= most):
                raise InputError(f"{name}: expected a number from 0 to {most:g}, found {described(value)}")
        if self.transfer not in tuple(TRANSFERS):
            raise InputError(f"transfer: expected one of {', '.join(TRANSFERS)}, found {self.transfer!r}")

    @property
    def law(self) -> dict[str, object]:
        """What the light is computed from, by the keys of a case file; of usual frames without their transfer."""
        law: dict[str, object] = {}
        if self.lamp_cam_mm is not None:
            law = {"lamp_cam_mm": self.lamp_cam_mm, "ambient": self.ambient, "falloff": self.falloff}
        law |= {"vignetting": self.vignetting} if self.vignetting else {}
        return law if self.curve is SRGB else {**law, "transfer": self.transfer}

    @property
    def curve(self) -> Transfer:
        """How the code values stand for linear light."""
        return TRANSFERS[self.transfer]

    @property
    def place_cam_mm(self) -> tuple[float, float, float]:
        """Where the lamp is, camera axes, mm; the lens' centre without one."""
        return (0.0, 0.0, 0.0) if self.lamp_cam_mm is None else self.lamp_cam_mm

    def place_model(self, cam_from_model: np.ndarray) -> np.ndarray:
        """``(3,)`` mm: where the lamp is at a pose (4x4, mm) of the lens, model frame."""
        place: np.ndarray = cam_from_model[:3, :3].T @ (np.array(self.place_cam_mm) - cam_from_model[:3, 3])
        return place


def checked_lens_light(table: Mapping[str, object], where: str) -> LensLight:
    """The light of a case file's table ``[light]``; ``where`` begins messages."""
    has_lamp = "vignetting" not in table or bool(table.keys() & {*LAMP_KEYS, "falloff"})
    optional = ("falloff", "transfer", "vignetting", *ORIGIN_KEYS)
    check_keys(table, LAMP_KEYS if has_lamp else (), optional, f"{where} ")
    lamp, origin = table.get("lamp_cam_mm"), {key: table[key] for key in ORIGIN_KEYS if key in table}
    if has_lamp and (not isinstance(lamp, list) or len(lamp) != 3 or not all(map(is_number, lamp))):
        raise InputError(f"{where} lamp_cam_mm: expected three numbers, found {described(lamp)}")
    numbers = ("ambient", "falloff", "vignetting")
    for key in numbers:
        if not is_number(table.get(key, 0)):
            raise InputError(f"{where} {key}: expected a number, found {described(table[key])}")
    for key, value in origin.items():
        origin[key] = _checked_origin(key, value, f"{where} {key}")
    values = {"ambient": 1.0, **{key: float(table[key]) for key in numbers if key in table}}  # type: ignore[arg-type]
    try:
        place = (float(lamp[0]), float(lamp[1]), float(lamp[2])) if isinstance(lamp, list) else None
        return LensLight(place, **values, origin=origin, transfer=table.get("transfer", "srgb"))  # type: ignore[arg-type]
    except InputError as error:
        raise InputError(f"{where} {error}") from None


def _checked_origin(key: str, value: object, where: str) -> object:
    if key in _TEXTS:
        if isinstance(value, date):
            return value.isoformat()
        if not isinstance(value, str):
            raise InputError(f"{where}: expected text, found {described(value)}")
        return value
    if key == "standard_deviation_mm":
        if not isinstance(value, list) or len(value) != 3 or not all(is_number(each) and each >= 0 for each in value):
            raise InputError(
                f"{where}: expected three numbers, for the camera's x, y and z axis, found {described(value)}"
            )
        return [float(each) for each in value]
    if not is_number(value):
        raise InputError(f"{where}: expected a number, found {described(value)}")
    return value


def working_distance_mm(cam_from_model: np.ndarray, middle_model: Sequence[float] | np.ndarray) -> float:
    """The distance D of a pose, mm: from the lens to a point (model frame) that stands for the surface; at least 1."""
    middle_cam = cam_from_model[:3, :3] @ np.asarray(middle_model) + cam_from_model[:3, 3]
    return max(float(np.linalg.norm(middle_cam)), 1.0)


def shading(
    light: LensLight,
    points: np.ndarray,
    normals: np.ndarray,
    cam_from_model: np.ndarray,
    distance_mm: float | np.ndarray,
    lit: np.ndarray | None = None,
) -> np.ndarray:
    """What points of a surface get of the light of a lens: the law of this module.

    Parameters
    ----------
    light
        At the lens.
    points, normals
        ``(N, 3)`` model frame, mm, and unit normals on the lens' side.
    cam_from_model
        4x4, mm: the pose of the lens.
    distance_mm
        The pose's :func:`working_distance_mm`, or a constant where all views are exposed alike; or ``(N,)``.
    lit
        ``(N,)`` V, 0..1; everywhere 1 if left out.

    Returns
    -------
    ``(N,)``, linear, in the precision of ``points``; without vignetting at least the ambient part.
    """
    lamp, kind = light.place_model(cam_from_model), points.dtype.type
    # column by column: numpy is slow at reductions along an axis of three
    x, y, z = (kind(at) - column for at, column in zip(lamp, points.T, strict=True))
    nx, ny, nz = normals.T
    along, squared, off_axis = x * nx + y * ny + z * nz, x * x + y * y + z * z, np.zeros_like(x)
    if light.vignetting:
        x, y, z = (points @ row[:3].astype(points.dtype) + kind(row[3]) for row in cam_from_model[:3])
        # of points beside the lens nothing is left
        off_axis = (x * x + y * y) / np.maximum(z * z, 1e-12)
    return received(light, along, squared, off_axis, distance_mm, lit)


def received(
    light: LensLight,
    along: np.ndarray,
    squared: np.ndarray,
    off_axis: np.ndarray,
    distance_mm: float | np.ndarray,
    lit: np.ndarray | None = None,
) -> np.ndarray:
    """The same from ``(N,)`` ways to the lamp along the normal, mm, and squared, and from tan(φ)^2."""
    kind = along.dtype.type
    if light.lamp_cam_mm is None:
        direct = np.zeros_like(along)
    else:
        direct = np.maximum(along, 0)
        # a point in the lamp itself has no direction
        near = np.maximum(squared * kind(1 / distance_mm**2), kind(1e-6))
        direct *= power_of(near, -(light.falloff + 1) / 2) * kind(1 / distance_mm)
    if lit is not None:
        direct *= lit
    direct += kind(light.ambient)
    if light.vignetting:
        direct *= power_of(np.minimum(off_axis, kind(1e12)) + 1, -light.vignetting / 2)
    return direct


def power_of(values: np.ndarray, exponent: float) -> np.ndarray:
    """A power of positive numbers near 1, which numpy takes several times as long for in single precision."""
    result: np.ndarray = np.log(values)
    result *= values.dtype.type(exponent)
    return np.exp(result, out=result)
