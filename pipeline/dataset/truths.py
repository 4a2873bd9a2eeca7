"""The arrays of a view, each declared once: what it holds, how its file holds it, who asks for it, what it must obey.

Layout, writer, record, checker, packs, reader and pages derive from :data:`TRUTHS`.
"""

import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera
from ..errors import InputError
from ..images.png import encode_png
from ..projection.rendered_view import RenderedView
from ..projection.visible_surface import pixel_points
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .normals import NORMAL_UNIT, normal_codes
from .options import NONE

_OFF = (False, 0, NONE)
"""Values of an option that ask for no array."""
DEPTH_LEVELS = 65535
"""Largest value of the 16-bit depth images."""


@dataclass(frozen=True)
class Form:
    """How a file holds an array: what it is, the end of the file's name, and type and channels of the pixels."""

    about: str
    ending: str
    dtype: type
    channels: int = 1

    def shape(self, shape_hw: tuple[int, int]) -> tuple[int, ...]:
        """The shape of the array of a view of this height and width."""
        return shape_hw if self.channels == 1 else (*shape_hw, self.channels)

    def encoded(self, array: np.ndarray) -> bytes:
        """The content of the file."""
        if self.ending != ".npy":
            return encode_png(array)
        stream = io.BytesIO()
        np.save(stream, np.ascontiguousarray(array, self.dtype), allow_pickle=False)
        return stream.getvalue()


COLOUR = Form("8 bit", ".png", np.uint8, 3)
MASK = Form("0 or 255", "_000000.png", np.uint8)
NUMBER = Form("8 bit", ".png", np.uint8)
UNITS = Form("16 bit", ".png", np.uint16)
FLOAT = Form("float32", ".npy", np.float32)
VECTOR = Form("16 bit, x y z", ".png", np.uint16, 3)
POINT = Form("float32, x y z", ".npy", np.float32, 3)


@dataclass(frozen=True)
class Shot:
    """What the arrays of a view are made from.

    Attributes
    ----------
    rendered, cam_from_model
        The rendered view and its pose (4x4, mm).
    mesh, camera
        The surface, model frame, and the intrinsics of the view.
    depth_scale
        Millimetres per unit of the depth image.
    """

    rendered: RenderedView
    cam_from_model: np.ndarray
    mesh: TriangleMesh
    camera: PinholeCamera
    depth_scale: float


@dataclass(frozen=True)
class Stored:
    """What files say of a view: its arrays by name, millimetres per unit of depth, number of frames, camera, pose."""

    arrays: Mapping[str, np.ndarray]
    depth_scale: float
    frames: int
    camera: PinholeCamera
    cam_from_model: np.ndarray

    @property
    def mask(self) -> np.ndarray:
        """``(H, W)`` bool: the surface, whatever stands in front of it."""
        return self.arrays["mask"] > 0

    def _marked(self, name: str) -> np.ndarray:
        return self.arrays[name] > 0 if name in self.arrays else np.zeros(self.mask.shape, bool)

    @property
    def occluder(self) -> np.ndarray:
        """``(H, W)`` bool: what stands in front of it, or of nothing."""
        return self._marked("mask_occluder")

    @property
    def surround(self) -> np.ndarray:
        """``(H, W)`` bool: what surrounds it, where the frame's colours go on beyond its edge."""
        return self._marked("mask_surround")

    @property
    def visible(self) -> np.ndarray:
        """``(H, W)`` bool: the visible surface."""
        return self.mask & ~self.occluder


Flaws = Iterator[tuple[np.ndarray, str]]
"""``(H, W)`` bool of pixels, and a clause that says what is wrong where it is true."""


@dataclass(frozen=True)
class Truth:
    """An array of a view.

    Attributes
    ----------
    name
        Of the array and of its folder.
    about
        What it holds.
    form
        How its file holds it.
    array
        Makes it.
    flaws
        What is wrong with it beside the other arrays of the view.
    option
        Option of a dataset that asks for it where it is neither off nor 0; always written if left out.
    of_several
        Written only if several frames colour the surface.
    """

    name: str
    about: str
    form: Form
    array: Callable[[Shot], np.ndarray]
    flaws: Callable[[Stored], Flaws]
    option: str = ""
    of_several: bool = False


def written_truths(options: Mapping[str, object], frames: int) -> tuple[str, ...]:
    """Names of the arrays of a dataset with these options whose surface so many frames colour."""
    return tuple(
        truth.name
        for truth in TRUTHS.values()
        if (not truth.option or options.get(truth.option, NONE) not in _OFF) and (frames > 1 or not truth.of_several)
    )


def depth_scale_for(farthest_mm: float) -> float:
    """Millimetres per unit of the 16-bit depth images: the finest of 1, 2, 5 times a power of ten that is enough."""
    if not (np.isfinite(farthest_mm) and farthest_mm > 0):
        raise InputError(f"depth: expected a positive distance, found {farthest_mm!r} mm")
    exponent = np.floor(np.log10(farthest_mm / DEPTH_LEVELS))
    # parsed from decimal text, so that 0.01 is exactly the float 0.01
    for digit, power in ((1, 0), (2, 0), (5, 0), (1, 1), (2, 1)):
        scale = float(f"{digit}e{int(exponent) + power}")
        if farthest_mm <= scale * DEPTH_LEVELS:
            return scale
    raise AssertionError("a decade always holds a fitting scale")


def quantised_depth(depth_mm: np.ndarray, depth_scale: float) -> np.ndarray:
    """``(H, W)`` depth in mm -> uint16, 0 for background (and never 0 for surface)."""
    units = depth_mm / np.float32(depth_scale)
    np.clip(np.rint(units, out=units), 1, DEPTH_LEVELS, out=units)
    return (units * (depth_mm > 0)).astype(np.uint16)


def _codes(shot: Shot) -> np.ndarray:
    # adding a half and truncating rounds, as no value is negative
    return (np.clip(shot.rendered.rgb, 0, 1) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _white(flags: np.ndarray) -> np.ndarray:
    return flags.view(np.uint8) * np.uint8(255)


def _none(_stored: Stored) -> Flaws:
    return iter(())


def _rgb_flaws(stored: Stored) -> Flaws:
    nothing = ~(stored.mask | stored.occluder | stored.surround)
    yield stored.arrays["rgb"].any(axis=2) & nothing, "outside the mask are not black"


def _mask_flaws(stored: Stored) -> Flaws:
    shown = stored.arrays["depth"] > 0
    yield (stored.mask | stored.occluder) != shown, "differ from where the depth image has surface"


def _visible_flaws(stored: Stored) -> Flaws:
    visible = stored.arrays["mask_visib"] > 0
    yield visible & ~stored.mask, "lie outside the mask"
    yield visible != stored.visible, "differ from the mask without what stands in front of it"


def _surround_flaws(stored: Stored) -> Flaws:
    yield stored.surround & (stored.mask | stored.occluder), "lie on the surface, or on what stands in front of it"


def _observed_flaws(stored: Stored) -> Flaws:
    observed = stored.arrays["mask_observed"] > 0
    yield observed & ~stored.mask, "lie outside the mask"
    yield observed & stored.occluder, "lie behind what stands in front"


def _source_flaws(stored: Stored) -> Flaws:
    source = stored.arrays["source_frame"]
    yield (source > 0) != (stored.arrays["mask_observed"] > 0), "differ from mask_observed"
    yield source > stored.frames, f"are of none of the {stored.frames} frames"


def _float_flaws(stored: Stored) -> Flaws:
    exact = stored.arrays["depth_mm"].astype(np.float64)
    wrong = ((exact > 0) != (stored.mask | stored.occluder)) | ~_rounds_to_depth(exact, stored, 1e-6 * exact)
    yield wrong, "are not those of the depth image before rounding"


def _rounds_to_depth(z_mm: np.ndarray, stored: Stored, beside_mm: np.ndarray) -> np.ndarray:
    units = stored.arrays["depth"]
    # depths below half a unit are stored as 1, not 0
    rounding = np.where(units == 1, 1.0, 0.5) * stored.depth_scale + beside_mm
    return np.abs(z_mm - units * stored.depth_scale) <= rounding


def points_model(depth_mm: np.ndarray, camera: PinholeCamera, cam_from_model: np.ndarray) -> np.ndarray:
    """``(H, W)`` depth of a view -> ``(H, W, 3)`` float32 points of the surface, model frame, mm; NaN where it is 0."""
    points = np.full((*depth_mm.shape, 3), np.nan, np.float32)
    seen = depth_mm > 0
    points[seen] = pixel_points(depth_mm, np.nonzero(seen), camera, cam_from_model)
    return points


def _point_flaws(stored: Stored) -> Flaws:
    points = stored.arrays["points"].astype(np.float64)
    yield (np.isnan(points) == stored.visible[..., None]).any(axis=2), "differ from where mask_visib has surface"
    points_cam = transform_points(stored.cam_from_model, points.reshape(-1, 3)).reshape(points.shape)
    z, rays = points_cam[..., 2], stored.camera.rays_cam(stored.camera.pixel_grid())
    # of single precision
    rounding = 1e-6 * (np.abs(points).max(axis=2) + z)
    off = np.abs(points_cam - z[..., None] * rays).max(axis=2)
    yield stored.visible & ~(off <= rounding), "are not on the rays through the pixels' centres"
    yield stored.visible & ~_rounds_to_depth(z, stored, rounding), "are not at the depth of the depth image"


def _normal_flaws(stored: Stored) -> Flaws:
    codes = stored.arrays["normals"]
    yield codes.any(axis=2) != stored.visible, "differ from where mask_visib has surface"
    off = np.abs(np.linalg.norm(codes / NORMAL_UNIT - 1, axis=2) - 1)
    yield stored.visible & (off > 1e-4), "are not of length 1"


TRUTHS = {
    truth.name: truth
    for truth in (
        Truth("rgb", "the view", COLOUR, _codes, _rgb_flaws),
        Truth(
            "depth", "value × depth_scale = mm along the optical axis; 0 = no surface", UNITS,
            lambda shot: quantised_depth(shot.rendered.seen_mm, shot.depth_scale), _none,
        ),
        Truth("mask", "the surface", MASK, lambda shot: _white(shot.rendered.mask), _mask_flaws),
        Truth(
            "mask_visib", "the surface that nothing stands in front of", MASK,
            lambda shot: _white(shot.rendered.visible), _visible_flaws,
        ),
        Truth(
            "mask_occluder", "what stands in front of the surface, or beside it", MASK,
            lambda shot: _white(shot.rendered.occluder), _none, option="occluders",
        ),
        Truth(
            "mask_surround", "what surrounds the surface, as the frame shows it; no depth", MASK,
            lambda shot: _white(shot.rendered.surround), _surround_flaws, option="surroundings",
        ),
        Truth(
            "mask_observed", "surface that a frame of the case saw", MASK,
            lambda shot: _white(shot.rendered.observed), _observed_flaws,
        ),
        Truth(
            "source_frame", "number of the frame that colours the pixel, from 1; 0 = none saw it", NUMBER,
            lambda shot: shot.rendered.source, _source_flaws, of_several=True,
        ),
        Truth(
            "depth_mm", "mm along the optical axis; 0 = no surface", FLOAT,
            lambda shot: shot.rendered.seen_mm, _float_flaws, option="float_depth",
        ),
        Truth(
            "normals", "unit normal of the visible side, camera axes: value / 32767.5 - 1; 0 = no surface", VECTOR,
            lambda shot: normal_codes(shot.rendered.visible, shot.mesh, shot.camera, shot.cam_from_model),
            _normal_flaws, option="normals",
        ),
        Truth(
            "points", "point of the surface (object coordinates), mm, mesh in models/; NaN = no surface", POINT,
            lambda shot: points_model(shot.rendered.visible_mm, shot.camera, shot.cam_from_model), _point_flaws,
            option="points",
        ),
    )
}  # fmt: skip
"""Every array that a view may have, by its name."""
