"""Correct a surface by registered frames of it, and say where a second, independent look at them confirms it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..case.frame import PosedFrame
from ..colour.lens_shading import LensShading
from ..errors import InputError
from ..images.transfer import SRGB
from ..surface.mesh import TriangleMesh
from .control_points import ControlPoints, neighbour_means
from .displacement_fit import Estimate, Fit, Observed, fit, observed
from .frame_flow import Surface, SurfaceFrame, SurfaceView, cosines_between, flow_between
from .plane_sweep import is_confirmed
from .surface_change import changed_since

LONGER_SIDE_PX = 480
"""Frames are compared at this size."""
SPACING_PX = 6.0
"""Between the points that move, in pixels on the surface."""
FADING_PX = 12.0
"""Over which a displacement ends beside what is confirmed."""
ROUNDS, REFERENCES = 3, 3
SHARP = 0.8
"""Textured part of a frame, relative to the middle one's, below which the others are not compared with it."""
SOURCE_PRIOR, FRAME_PRIOR = (0.005, 0.00005), (2.0, 0.02)
"""Standard deviations of the shift, mm, and of the rotation, rad, of the poses: only the case's is taken for right, or
all poses would follow where the surface is wrong."""
SHARED_MM, SHARED = 0.05, 0.4
"""Standard deviation of what all displacements share, and relative to their median: nearer to the case's camera
and smaller, the other cameras with it, a surface looks the same."""
LEAST_FRAMES, MOST_FRAMES, LEAST_ANGLE_DEG = 10, 15, 15.0
"""Fewer, or nearer to one another, do not tell surface from poses; more take longer."""
LEAST_TEXTURED = 0.1
"""Part of what the case's frame shows of the surface."""
LEAST_RETURNING, FARTHEST_PX = 0.3, 5.0
"""Part of the flow that comes back, and its median, at which a frame shows what the case's frame does: 0.6 to 1 and up
to 1 px on a surface that is wrong by 1.7 mm, below 0.1 in mirrored frames, and over 9 px at the poses of others."""
LEAST_WEIGHT = 0.6
"""Mean weight of the pixels, below which no displacement explains the frames: .85 where one does."""
LEAST_FLOW = 50
"""Pixels without which a pair of frames says nothing."""
LEAST_COUNT = 6.0
"""Pixels that tell of a vertex, by their weights, without which nothing is known of it."""
SPREAD = 3.0
"""Factor of the standard deviations: neighbours are not known either. Also where what is left exceeds the median, as
much."""
ALIKE_PX = 0.4
"""How far a shift, turn and scale of the whole surface may move it, in pixels on the surface, times the part of the
displacements, as squares, that they explain: 0.9 and more with K 5 % off, up to 0.3 with a right one."""
FLOOR_PX = 1.25
"""Standard deviation up to which a place is confirmed, in pixels on the surface."""
AGREES_PX = 0.85
"""Disagreement with the sweep up to which it is, in these pixels."""


class SurfaceChanged(InputError):
    """Frames show the surface at two stages."""

    def __init__(self, since: int) -> None:
        """Say from which of the frames on, by its place, it has changed."""
        super().__init__("expected frames of one stage of the surface, found that it changes between them")
        self.since = since


@dataclass(frozen=True)
class SurfaceCorrection:
    """A surface with V vertices, corrected.

    Attributes
    ----------
    mesh
        The corrected surface, model frame, mm.
    deviation_mm
        ``(V,)`` by how much each vertex was moved, along the normal.
    std_mm
        ``(V,)`` standard deviation of what the frames say; NaN where they say nothing.
    confirmed
        ``(V,)`` bool: the sweep says the same. Elsewhere the old surface stays, but for a seam.
    frames, left_out
        How many frames it is from, and how many others show something else at their poses.
    angle_deg
        Between the directions that are farthest apart.
    floor_mm
        Below which a deviation means nothing.
    later
        What to say of frames after a change, or empty.
    """

    mesh: TriangleMesh
    deviation_mm: np.ndarray
    std_mm: np.ndarray
    confirmed: np.ndarray
    frames: int
    left_out: int
    angle_deg: float
    floor_mm: float
    later: str = ""

    @property
    def moved(self) -> np.ndarray:
        """``(V,)`` bool: what is confirmed and was moved by more than nothing."""
        return self.confirmed & (np.abs(self.deviation_mm) > self.floor_mm)

    @property
    def lines(self) -> tuple[str, ...]:
        """What was found, in sentences without a full stop."""
        known, moved = np.isfinite(self.std_mm), self.moved
        others = f"; {self.left_out} others show something else" if self.left_out else ""
        found = (
            f"{self.frames} further frames over {self.angle_deg:.0f}° tell of {known.mean():.0%} of the surface, and "
            f"{self.confirmed.sum() / max(int(known.sum()), 1):.0%} of that is confirmed{others}"
        )
        off = "next to nothing of what is confirmed was moved"
        if moved.sum() >= 0.005 * self.confirmed.sum() > 0:
            low, high = np.percentile(self.deviation_mm[moved], (2, 98))
            share, by = moved.mean() / self.confirmed.mean(), f"{low:+.2f} to {high:+.2f} mm"
            off = f"{share:.0%} of what is confirmed was moved, by {by} (positive: towards the lens)"
        return found, f"{off}; less than {self.floor_mm:.2f} mm means nothing", *((self.later,) if self.later else ())


def correct_surface(
    mesh: TriangleMesh,
    frames: Sequence[PosedFrame],
    light: LensShading | None,
    progress: Callable[[float], None] = lambda share: None,
) -> SurfaceCorrection:
    """Correct a surface by frames at their poses.

    Parameters
    ----------
    mesh
        Model frame, mm.
    frames
        The case's own first, whose pose is taken for right, then those that are registered, at
        :data:`LONGER_SIDE_PX`.
    light
        The lamp at the lens, if it is known: without it, what the moving lamp does is taken for a wrong surface.
    progress
        Called with the finished share, 0..1.

    Raises
    ------
    SurfaceChanged
        The surface is another one from one of the frames on, in their order.
    InputError
        Too few frames, or too near to one another; no texture; frames that show something else; residuals that no
        displacement explains, or all of which one shift does; or a surface that is too coarse.
    """
    curve = light.curve if light else SRGB
    run = _Run(mesh, [SurfaceFrame(frame, curve) for frame in frames], light)
    for number in range(ROUNDS):
        result = run.round()
        progress((number + 1) / (ROUNDS + 1))
    if result.weight < LEAST_WEIGHT:
        raise InputError(
            f"expected frames whose differences a displaced surface explains, found {np.median(result.left_px):.2f} px "
            f"left in the middle, and {1 - result.weight:.0%} of the pixels without weight: does tissue move, is K "
            "right, and do all frames show the surface at the same stage?"
        )
    found = run.confirmed(result)
    progress(1.0)
    return found


class _Run:
    """Frames, poses and displacements as they become better."""

    def __init__(self, mesh: TriangleMesh, frames: list[SurfaceFrame], light: LensShading | None) -> None:
        """Look at the surface as it came, and keep the frames that show it."""
        self._light = light
        views = self._looked(mesh, frames, [frame.start for frame in frames])
        source, pixel_mm = views[0], views[0].pixel_mm
        textured = int((source.frame.textured & source.shown).sum()) / max(int(source.shown.sum()), 1)
        if textured < LEAST_TEXTURED:
            raise InputError(
                f"expected texture on the surface, found it on {textured:.0%} of what the case's frame shows; a smooth "
                "surface cannot be corrected"
            )
        if mesh.median_edge > 2 * SPACING_PX * pixel_mm:
            raise InputError(
                f"expected a surface with edges up to {2 * SPACING_PX * pixel_mm:.2g} mm, found {mesh.median_edge:.2g} "
                "mm; subdivide it"
            )
        self._kept = [0, *(number for number, view in enumerate(views) if number and _shows_same(source, view))]
        if len(self._kept) <= LEAST_FRAMES:
            raise InputError(
                f"expected at least {LEAST_FRAMES} accepted frames that show what the case's frame shows, found "
                f"{len(self._kept) - 1} of {len(views) - 1}; register more frames, to this case"
            )
        self._left_out = len(views) - len(self._kept)
        self._views = [views[number] for number in self._kept]
        seen, faces = np.zeros(len(mesh.vertices), bool), mesh.faces.copy()
        for view in self._views:
            shown, first = np.unique(view.hits.face, return_index=True)
            shown, front = shown[shown >= 0], view.hits.front[first[shown >= 0]]
            seen[mesh.faces[shown]] = True
            # whichever way they are wound, vertices move towards the lens
            faces[shown[~front]] = mesh.faces[shown[~front], ::-1]
        self._given, self._points = mesh, ControlPoints.of(replace(mesh, faces=faces), seen, SPACING_PX * pixel_mm)
        pivot, poses = self._points.places.mean(axis=0), np.stack([view.pose for view in self._views])
        deviations = np.repeat([SOURCE_PRIOR, *[FRAME_PRIOR] * (len(poses) - 1)], 3, axis=1)
        self._now = Estimate(np.zeros(len(self._points.places)), poses, poses, deviations, pivot, pixel_mm)
        cosines = cosines_between(poses, pivot)
        self._angle_deg = float(np.degrees(np.arccos(cosines.min())))
        if self._angle_deg < LEAST_ANGLE_DEG:
            raise InputError(
                f"expected frames over at least {LEAST_ANGLE_DEG:g}°, found {self._angle_deg:.1f}° between those that "
                "are farthest apart; register frames from more sides"
            )
        textures = np.array([view.frame.textured.mean() for view in self._views])
        blurred, self._references = textures < SHARP * np.median(textures), [0]
        for _ in range(REFERENCES - 1):
            nearest = cosines[self._references].max(axis=0)
            self._references.append(int(np.argmin(np.where(blurred, 1, nearest))))

    def _looked(
        self, mesh: TriangleMesh, frames: Sequence[SurfaceFrame], poses: Sequence[np.ndarray] | np.ndarray
    ) -> list[SurfaceView]:
        surface = Surface(mesh, self._light)
        return [SurfaceView(surface, frame, pose) for frame, pose in zip(frames, poses, strict=True)]

    def round(self) -> Fit:
        """Move points and poses to where the flow says."""
        parts = []
        for one, other in product(self._references, range(len(self._views))):
            if one != other:
                flow = flow_between(self._views[one], self._views[other])
                if len(flow.pixels) >= LEAST_FLOW:
                    parts.append(observed(self._points, self._now.pivot, self._views, (one, other), flow))
        known = Observed.joined(parts)
        found = fit(self._points, known, self._now)
        self._now = found.estimate
        # where little is explained, as where tissue moves, what is left tells of nothing else
        if found.weight >= LEAST_WEIGHT:
            self._check_alike(found)
            since = changed_since(self._points, known, found.left_px, len(self._views))
            if since is not None:
                raise SurfaceChanged(self._kept[since])
        moved = self._points.moved(self._now.heights_mm)
        self._views = self._looked(moved, [view.frame for view in self._views], self._now.poses)
        return found

    def _check_alike(self, result: Fit) -> None:
        """Refuse displacements of the whole surface: those are the error of the case's pose or K."""
        points, now = self._points, self._now
        known = points.weights @ result.counts > LEAST_COUNT
        heights, normals = (points.weights @ now.heights_mm)[known], points.normals[known]
        places = self._given.vertices[known] - now.pivot
        by_all = np.column_stack([normals, np.cross(places, normals), (places * normals).sum(axis=1)])
        values, *_ = np.linalg.lstsq(by_all, heights, rcond=None)
        alike = np.sum((by_all @ values) ** 2)
        share = alike / max(float(heights @ heights), 1e-12)
        if share * np.sqrt(alike / max(len(heights), 1)) > ALIKE_PX * now.pixel_mm:
            raise InputError(
                f"expected a surface that is wrong in places, found one that fits better as a whole, {values[6]:+.1%} "
                f"in size, shifted and turned: that explains {share:.0%} of its displacements. The case's pose or K is "
                "wrong; look at its overlay, and align it anew"
            )

    def confirmed(self, result: Fit) -> SurfaceCorrection:
        """What is confirmed of the result of the last round."""
        points, weights, pixel_mm = self._points, self._points.weights, self._now.pixel_mm
        known, heights_mm = weights @ result.counts > LEAST_COUNT, weights @ self._now.heights_mm
        left_px = weights @ result.residuals_px
        std_mm = SPREAD * np.sqrt(weights @ result.std_mm**2) * np.maximum(left_px / np.median(left_px[known]), 1)
        laid = [(view.frame, view.pose) for view in self._views]
        sweeps = [(self._views[each], laid[:each] + laid[each + 1 :]) for each in self._references]
        confirmed = known & (std_mm < FLOOR_PX * pixel_mm)
        confirmed &= is_confirmed(points.normals, sweeps, AGREES_PX * pixel_mm)
        means, share = neighbour_means(self._given), confirmed.astype(float)
        for _ in range(int(np.clip(FADING_PX * pixel_mm / self._given.median_edge, 1, 40))):
            share = np.maximum(confirmed, means @ share)
        shared_mm = np.hypot(SHARED_MM, SHARED * np.median(np.abs(heights_mm[known])))
        deviation_mm = share * heights_mm
        mesh = replace(self._given, vertices=self._given.vertices + points.normals * deviation_mm[:, None])
        std_mm = np.where(known, np.hypot(std_mm, shared_mm), np.nan)
        return SurfaceCorrection(
            mesh, deviation_mm, std_mm, confirmed, len(laid) - 1, self._left_out, self._angle_deg, FLOOR_PX * pixel_mm
        )


def _shows_same(source: SurfaceView, view: SurfaceView) -> bool:
    """Whether a frame shows what the case's does."""
    flow = flow_between(source, view)
    if len(flow.pixels) < LEAST_FLOW or flow.share < LEAST_RETURNING:
        return False
    return bool(np.median(np.linalg.norm(flow.found - flow.placed, axis=1)) < FARTHEST_PX)
