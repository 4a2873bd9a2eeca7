"""Frames without the light of their lens, and surfaces in it: :mod:`oneframe.light.lens_light` on code values.

Colours are interpolated as code values, but light multiplies linear ones. Above 0.04, sRGB is a shifted power: there a
code value c under s times the light is (c + 0.055) s^(1/2.4) - 0.055, a product again; so are other curves, with
numbers of their own. Continued down to -0.055, black, this holds everywhere, so albedos and lit colours are *shifted
codes* of that power alone, without upper bound, and only what a view shows has the straight piece near black. At a
frame's own pose the same factor is divided by and multiplied with: the frame comes back to rounding.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..case.frame import PosedFrame
from ..case.loaded_case import LoadedCase
from ..errors import InputError
from ..images.transfer import SRGB, Transfer
from ..light.lens_light import LensLight, power_of, shading, working_distance_mm
from ..projection.rendered_view import RenderedView
from ..projection.visible_surface import central_point
from ..projection.z_buffer import rasterise_depth, reached_from
from ..surface.mesh import TriangleMesh
from ..transforms import transform_points
from .vertex_colours import NEUTRAL

LARGEST_NOISE = 8 / 255
"""No frame is divided by so little light that the standard deviation of its noise exceeds this code value."""
LEAST_SHADING = (0.1, 0.2)
"""Whatever the noise, light counts at least between these.

An edge pixel of a frame mixes surfaces of which the law knows one: less would make it a speck. Up to 0.16, views of the
sample are as near to its photographs as with none.
"""

FARTHEST_BEFORE = 0.25
"""Part of the way to the surface that a lamp may be before the lens."""
NEAR = 0.5
"""Part of the frame's working distance below which a view's lamp comes to its lens."""
SMALL_PX = 240
"""Longer side of the picture that tells where the surface is in a frame."""

SAME_PLACE = 1e-5
"""Part of the lamp's distance up to which what its ray meets is the point itself."""

COARSE_DEG, COARSE_PART = 30.0, 0.2
"""Where the normals at a face's corners differ by more, its edges are longer than what they shade; from this part of
the frame's surface on, the user is told."""
SATURATED, SATURATED_PART = 0.997, 0.1
"""Code value of a saturated pixel, and the part of such pixels from which on the user is told."""


@dataclass(frozen=True)
class LensShading:
    """The light of a case's lens on its surface.

    Attributes
    ----------
    light
        The lamp. It counts 1 at each view's own working distance: exposures follow the distance.
    least
        What every point gets at least: less would be noise in the frame without its light.
    shadows
        Whether the lamp casts shadows.
    middle_model
        The point, model frame, whose distance is the working distance: what the frame shows at its middle.
    frame_mm
        The frame's own working distance; 0 lets the lamp keep its place however near the lens is.
    """

    light: LensLight
    least: float
    shadows: bool = False
    middle_model: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frame_mm: float = 0.0

    @property
    def curve(self) -> Transfer:
        """The codes' transfer: shifted codes plus its shift are proportional to light to one over its gamma."""
        return self.light.curve

    def at(self, cam_from_model: np.ndarray) -> tuple[LensLight, float]:
        """The lamp of the lens at a pose (4x4, mm), and the pose's working distance, mm.

        Nearer than :data:`NEAR` of the frame's distance the lamp comes to the lens as the lens comes to the surface:
        beside or before the lens as ever, it would get into the walls.
        """
        distance_mm = working_distance_mm(cam_from_model, self.middle_model)
        part = distance_mm / max(NEAR * self.frame_mm, distance_mm)
        if part == 1 or self.light.lamp_cam_mm is None:
            return self.light, distance_mm
        x, y, z = (part * each for each in self.light.lamp_cam_mm)
        return replace(self.light, lamp_cam_mm=(x, y, z)), distance_mm

    def moved(self, b_from_a: np.ndarray) -> "LensShading":
        """The same lamp for lenses at ``b``, of which those at ``a`` have it."""
        if self.light.lamp_cam_mm is None:
            return self
        x, y, z = transform_points(b_from_a, np.array([self.light.lamp_cam_mm]))[0].tolist()
        return replace(self, light=replace(self.light, lamp_cam_mm=(x, y, z)))

    def factors(
        self, points: np.ndarray, normals: np.ndarray, cam_from_model: np.ndarray, lit: np.ndarray | None = None
    ) -> np.ndarray:
        """``(N,)`` what multiplies shifted codes plus their shift; parameters as of :func:`.shading`."""
        light, distance_mm = self.at(cam_from_model)
        return self.factors_of(shading(light, points, normals, cam_from_model, distance_mm, lit))

    def factors_of(self, linear: np.ndarray) -> np.ndarray:
        """The same of linear light ``(N,)``."""
        return power_of(np.maximum(linear, linear.dtype.type(self.least)), 1 / self.curve.gamma)


def corner_normals(mesh: TriangleMesh) -> np.ndarray:
    """``(F, 3, 3)`` the vertices' normals at each corner of the faces, on the side of the face's front.

    So faces that are flipped among others are shaded as these.
    """
    normals = mesh.smooth_normals[mesh.faces]
    normals[mesh.is_flipped] *= -1
    return normals


def shifted_codes(codes: np.ndarray, curve: Transfer = SRGB) -> np.ndarray:
    """Code values -> shifted codes, any shape, float32."""
    codes = np.array(codes, np.float32)
    dark = codes < curve.straight
    light = np.maximum(codes[dark], 0) / np.float32(curve.slope)
    codes[dark] = (1 + curve.shift) * light ** np.float32(1 / curve.gamma) - curve.shift
    return codes


def albedo_codes(codes: np.ndarray, factors: np.ndarray, curve: Transfer) -> np.ndarray:
    """Code values over factors of light -> shifted codes that multiply light, as of :meth:`LensShading.factors`."""
    return (shifted_codes(codes, curve) + curve.shift) / factors - curve.shift


def shown_codes(rgb: np.ndarray, factors: np.ndarray | None = None, curve: Transfer = SRGB) -> np.ndarray:
    """Shifted codes ``(N, 3)``, times ``(N,)`` factors of light -> code values, from 0, in place."""
    shift = np.float32(curve.shift)
    if factors is not None:
        rgb += shift
        rgb *= factors[:, None]
        rgb -= shift
    dark = rgb < curve.straight
    linear = (np.maximum(rgb[dark] + shift, 0) / np.float32(1 + curve.shift)) ** np.float32(curve.gamma)
    rgb[dark] = np.float32(curve.slope) * linear
    return rgb


def lit_by_lamp(
    mesh: TriangleMesh, lens: LensShading, faces: np.ndarray | None, points: np.ndarray, pose: np.ndarray
) -> np.ndarray:
    """``(N,)`` float32, 1 where the lamp at the lens of a pose reaches points ``(N, 3)`` of faces, else 0.

    Without faces their places alone tell what the lamp's rays meet.
    """
    return reached_from(mesh, lens.at(pose)[0].place_model(pose), points, SAME_PLACE, faces).astype(np.float32)


def lens_shading_of(loaded: LoadedCase, *, shadows: bool = False) -> LensShading:
    """The light at the lens of a case."""
    light, name = loaded.case.lens_light, loaded.case.path.name
    depths = [_small_depth_mm(loaded.surface.mesh, frame) for frame in loaded.frames]
    nearest = min(float(depth[depth > 0].min(initial=np.inf)) for depth in depths)
    if shadows and light.lamp_cam_mm is None:
        raise InputError(f"{name}: [light]: expected lamp_cam_mm for shadows, found vignetting alone; use --light lens")
    # views come nearer to the surface than the frames: the lamp must not get into it
    if light.place_cam_mm[2] > nearest * FARTHEST_BEFORE:
        raise InputError(
            f"{name}: [light] lamp_cam_mm: expected a lamp at the lens, at most a quarter of the way to the surface "
            f"before it, found one {light.place_cam_mm[2]:.4g} mm before the lens, the surface begins at {nearest:.4g} "
            "mm; give its place in the camera's axes, mm"
        )
    noise = max(map(_noise, (each.image for each in loaded.frames)))
    least = float(np.clip((noise / LARGEST_NOISE) ** light.curve.gamma, *LEAST_SHADING))
    x, y, z = central_point(depths[0], loaded.frame.camera.within(SMALL_PX), loaded.frame.cam_from_model).tolist()
    return LensShading(light, least, shadows, (x, y, z), working_distance_mm(loaded.frame.cam_from_model, (x, y, z)))


def _small_depth_mm(mesh: TriangleMesh, frame: PosedFrame) -> np.ndarray:
    """``(H, W)`` depth of the surface in a small picture of a frame, 0 where there is none."""
    return rasterise_depth(mesh, frame.camera.within(SMALL_PX), frame.cam_from_model).depth_mm


def _noise(image: np.ndarray) -> float:
    """Standard deviation of the noise of an image's code values (Immerkaer 1996, by the median)."""
    grey = image.mean(axis=2)
    rows = grey[:-2] - 2 * grey[1:-1] + grey[2:]
    second = rows[:, :-2] - 2 * rows[:, 1:-1] + rows[:, 2:]
    # of the three channels' mean
    return float(np.sqrt(3) * np.median(np.abs(second)) / (6 * 0.6745)) if second.size else 0.0


def without_light(loaded: LoadedCase, lit: Sequence[RenderedView], curve: Transfer) -> LoadedCase:
    """The case with its frames' albedos in place of their colours, shifted codes, where they show the surface.

    ``lit`` are the bare surface, neutral grey, in the light of each frame's lens. Saturated pixels are divided
    too: what the frame saw depends on no light.
    """
    frames = []
    for frame, view in zip(loaded.frames, lit, strict=True):
        factors = (shifted_codes(view.rgb[view.mask], curve) + curve.shift) / (NEUTRAL + curve.shift)
        albedo = frame.image.astype(np.float32)
        albedo[view.mask] = albedo_codes(frame.image[view.mask], factors, curve)
        frames.append(replace(frame, image=albedo))
    return replace(loaded, frames=tuple(frames))


def lens_doubts(loaded: LoadedCase, lit: RenderedView) -> list[str]:
    """What the user should know of the case's frame without its light: saturated pixels, a coarse surface."""
    said, frame, mesh = [], loaded.frame, loaded.surface.mesh
    shown = lit.mask & frame.valid
    saturated = float((frame.image[shown].max(axis=1) >= SATURATED).mean()) if shown.any() else 0.0
    if saturated > SATURATED_PART:
        said.append(f"{frame.path.name}: {saturated:.0%} of the surface is saturated, its albedo there is not known")
    a, b, c = np.moveaxis(corner_normals(mesh), 1, 0)
    least = np.min([(a * b).sum(axis=1), (b * c).sum(axis=1), (c * a).sum(axis=1)], axis=0)
    area = np.linalg.norm(mesh.face_cross, axis=1)
    coarse = float(area[least < np.cos(np.radians(COARSE_DEG))].sum() / area.sum())
    if coarse > COARSE_PART:
        said.append(
            f"{loaded.case.mesh.name}: on {coarse:.0%} of the surface the normals turn by more than {COARSE_DEG:g}° "
            "from one vertex to the next: its edges are longer than what they shade; use a finer surface"
        )
    return said
