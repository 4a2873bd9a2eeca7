"""The lamp at the lens, found from the shading that frames show of a known surface.

The logarithm of a frame's light is that of its exposure, of the albedo and of the shading. Where several frames show a
point its albedo is the same in all of them, and drops out together with the exposures, in which the fit is linear. What
is left is the change of the shading as the lens moves: a light that stands still makes none. One frame alone must take
all albedos for one, and may take the light of a room for a lamp's.

Two things move with the lens as the shading does, and would be taken for a lamp elsewhere; several frames tell them:
the gloss of wet surfaces, of which one share is found, and a profile across the field, a smooth term about the axis.
Both are nuisances. What the law then keeps, the lamp, vignetting or both, is what tells most of frames that were left
out: half of them are fitted, the others foretold, and the other way round.

Least squares with Cauchy's weights, reweighted iteratively: instruments and light between
the walls are in no frame's model. How far the lamp is before or behind the lens and how its light falls off with the
distance change little, and little but what light between the walls does too: the lamp is taken to be small and beside
the lens, and what this may be wrong by is part of the uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..images.transfer import TRANSFERS
from ..least_squares import damped_least_squares
from ..surface.mesh import TriangleMesh
from .lens_light import MOST_VIGNETTING, PHYSICAL, LensLight, working_distance_mm
from .shaded_points import Image, ShadedPoints, shaded_points

X, Y, AMBIENT, GLOSS, Z, FALLOFF = range(6)
"""The parameters: place of the lamp in the camera's axes, mm, ambient part, gloss beside it, and exponent."""
START = np.array([0.0, 0.0, 0.1, 0.05, 0.0, PHYSICAL])
FARTHEST = 1 / 3
"""How far beside the lens a lamp may be, in working distances: one that is there is none at the lens."""
STEPS = np.array([0.1, 0.1, 1e-4, 1e-4, 0.1, 1e-2])
"""Of central differences."""
ENOUGH = np.array([1e-2, 1e-2, 1e-5, 1e-4, 1.0, 1.0])
"""Changes of the parameters that end the fit."""
GRANTED = {Z: 1 / 15, FALLOFF: 0.3}
"""Standard deviations of what is not looked for; of the depth in working distances: 20 mm at 300 mm."""
PROFILE = 2
"""Terms of the profile: powers of the squared distance from the axis."""
ROUNDS, ITERATIONS, REWEIGHTED = 2, 30, 5
"""Rounds before which the lamp's shadows are cast anew, and the most steps of each; rounds of what is linear."""
CAUCHY, LEAST_SCATTER = 2.5, 1e-9
"""Residuals of so many standard deviations count half; and the least of these."""
CELLS = 4
"""Cells along the surface's length: the errors of near points depend on one another, those of cells less."""
FEWEST_POINTS = 200
GAIN = 0.97
"""More of the law is kept where what frames that were left out differ by falls below this part of it."""
LAMP, VIGNETTING, BOTH = "lamp", "vignetting", "both"
MISFIT = 2.5
"""What the scatter between cells is multiplied by: light between walls, highlights and the lamp's profile push all to
one side. Of places found from path-traced photographs, nine of ten were then within two standard deviations."""
LEAST_EXPLAINED, LARGEST_DEVIATION = 0.25, 0.1
"""A lamp explains so much of the shading at least, and its place is as sure, in working distances. Over several frames
lamps explain 78 % and more, lights of rooms and suns nothing; of one frame, these end on a bound or are less sure."""
LEAST_VIGNETTED = 0.6
"""What vignetting without a lamp explains at least: 67 to 93 % of an endoscope's shading, up to 48 % in rooms."""
MOST_STRENGTH = 0.1
"""Where less of a lamp's light than this moves with the lens, by two deviations, several frames show that none does."""


@dataclass(frozen=True)
class FoundLamp:
    """The lamp that explains frames best, whether or not there is one.

    Attributes
    ----------
    light
        The lamp.
    deviation_mm, ambient_deviation
        Standard deviations of its place along the camera's axes, and of the ambient part.
    frames
        How many took part.
    working_mm
        The working distance of the first frame.
    strength, strength_deviation
        How much the light changes with the lens, relative to what a lamp in its middle makes: about 1 for a lamp, 0 for
        lights that stand still.
    explained
        The part of the variance of the logarithm of the frames' light that the lamp or vignetting explains, below 0 if
        it explains nothing; without exposure and albedo.
    vignetting_deviation
        Standard deviation of the exponent.
    """

    light: LensLight
    deviation_mm: tuple[float, float, float]
    ambient_deviation: float
    frames: int
    working_mm: float
    strength: float
    strength_deviation: float
    explained: float
    vignetting_deviation: float = 0.0

    @property
    def objection(self) -> str:
        """Why this is no light at the lens, or why nobody knows, in words; empty if it is one."""
        if self.light.lamp_cam_mm is None:
            return ""
        away = np.abs(self.light.lamp_cam_mm[:2]).max()
        beside = away < FARTHEST * self.working_mm and self.light.ambient < 1
        sure = max(self.deviation_mm[:2]) <= LARGEST_DEVIATION * self.working_mm
        if self.explained >= LEAST_EXPLAINED and beside and sure:
            return ""
        if self.frames == 1:
            return f"one frame does not tell a lamp at the lens from the light of a room here: {self.figures}"
        if self.explained < LEAST_EXPLAINED and self.strength + 2 * self.strength_deviation < MOST_STRENGTH:
            return f"no lamp at the lens, if these are frames of this surface: {self.figures}"
        return f"the frames do not tell whether there is a lamp at the lens: {self.figures}"

    @property
    def figures(self) -> str:
        """Place, ambient part, vignetting and what they explain, in words."""
        explains = f"{max(self.explained, 0):.0%} of the shading of"
        frames = "the frame" if self.frames == 1 else f"{self.frames} frames"
        field = "vignetting, the cosine off the lens' axis to the "
        field += f"{self.light.vignetting:.1f} ± {self.vignetting_deviation:.1f}"
        if self.light.lamp_cam_mm is None:
            return f"{field}, explains {explains} {frames}, and a lamp beside it no more"
        x, y, _ = self.light.lamp_cam_mm
        across, down = (f"{at:.1f} ± {sure:.1f}" for at, sure in zip((x, y), self.deviation_mm[:2], strict=True))
        return (
            f"at x {across}, y {down} mm beside the lens, with an ambient part of {self.light.ambient:.2f} ± "
            f"{self.ambient_deviation:.2f}, a lamp explains {explains} {frames}"
            f"{f', with {field}' if self.light.vignetting else ''}"
        )

    def recorded(self, tool: str, date: str) -> LensLight:
        """The lamp with how it was found, for the case, rounded to what that means."""
        origin: dict[str, object] = {
            "method": "found",
            "tool": tool,
            "date": date,
            "frames": self.frames,
            "explained": round(self.explained, 3),
        }
        vignetting = round(self.light.vignetting, 2)
        if self.light.lamp_cam_mm is None:
            return replace(self.light, vignetting=vignetting, origin=origin)
        x, y, z = (round(each, 2) for each in self.light.lamp_cam_mm)
        origin["standard_deviation_mm"] = [round(each, 2) for each in self.deviation_mm]
        origin["ambient_standard_deviation"] = round(self.ambient_deviation, 4)
        rounded = (x, y, z), round(self.light.ambient, 4), round(self.light.falloff, 3)
        return LensLight(*rounded, origin, self.light.transfer, vignetting)


def find_lamp(mesh: TriangleMesh, frames: Sequence[Image], transfer: str = "srgb") -> FoundLamp:
    """The lamp at the lens that explains frames of a surface (model frame) best; :attr:`FoundLamp.objection` judges it.

    ``transfer`` is what their code values are, as of :class:`.LensLight`.
    """
    found = lamp_of(shaded_points(mesh, frames, TRANSFERS[transfer]), mesh)
    return replace(found, light=replace(found.light, transfer=transfer))


def lamp_of(sightings: ShadedPoints, mesh: TriangleMesh) -> FoundLamp:
    """As :func:`find_lamp`, from what frames show of points; ``mesh`` casts the shadows."""
    values, problem = START, _Problem(_compared(sightings))
    for _ in range(ROUNDS):
        lit = sightings.where(sightings.lit(_light(values), mesh))
        problem = _Problem(_compared(lit))
        values = problem.solved(values)
    found, law = problem.found(values), _chosen_law(lit, values)
    if law == LAMP and found.objection and found.frames > 1:
        law = VIGNETTING
    chosen = problem.with_vignetting(found, values, law)
    least = max(LEAST_VIGNETTED, found.explained)
    return found if law == VIGNETTING and chosen.explained < least else chosen


def _chosen_law(lit: ShadedPoints, start: np.ndarray) -> str:
    """The part of the law that tells most of frames that were left out, two at least; the lamp if there are fewer."""
    halves = [lit.where(lit.frame % 2 == half).shared() for half in (0, 1)]
    if min(len(np.unique(half.point)) for half in halves) < FEWEST_POINTS:
        return LAMP
    one, other = map(_Problem, halves)
    left_over = dict.fromkeys((LAMP, VIGNETTING, BOTH), 0.0)
    for fitted, left_out in ((one, other), (other, one)):
        values = fitted.solved(start)
        lamp = fitted.found(values)
        for law in left_over:
            left_over[law] += left_out.left_over(fitted.with_vignetting(lamp, values, law).light)
    chosen = LAMP
    for law in (VIGNETTING, BOTH):
        chosen = law if left_over[law] < GAIN * left_over[chosen] else chosen
    return chosen


def _compared(sightings: ShadedPoints) -> ShadedPoints:
    """What the fit goes by: the lit points, of several frames those that two of them share."""
    several = len(sightings.poses) > 1
    chosen = sightings.shared() if several else sightings
    count = len(np.unique(chosen.point))
    if count < FEWEST_POINTS:
        raise InputError(
            f"expected at least {FEWEST_POINTS} points of the surface that are well exposed and lit"
            f"{' in two frames' if several else ''}, found {count}; is the pose right, is the frame saturated or dark?"
        )
    return chosen


def _light(values: np.ndarray) -> LensLight:
    x, y, ambient, _, z, falloff = values.tolist()
    return LensLight((x, y, z), ambient, falloff)


class _Problem:
    """Weighted least squares over sightings; albedos, exposures and profile are taken out of all columns."""

    def __init__(self, seen: ShadedPoints) -> None:
        several = len(seen.poses) > 1
        self._seen = seen
        # gloss and profile show in no single frame, where albedos vary by more
        self._free = [X, Y, AMBIENT, GLOSS] if several else [X, Y, AMBIENT]
        albedo = seen.point if several else np.zeros_like(seen.point)
        self._albedo = np.unique(albedo, return_inverse=True)[1].ravel()
        exposures = (seen.frame[:, None] == np.arange(1, len(seen.poses))).astype(np.float64)
        profile = seen.off_axis[:, None] ** np.arange(1, 1 + PROFILE * several)
        self._linear = np.concatenate([exposures, profile], axis=1)
        self._weights = np.ones(len(seen.point))
        self._working_mm = working_distance_mm(seen.poses[0], seen.middle_model)
        self._least = np.array([-FARTHEST * self._working_mm] * 2 + [0.0, 0.0, -np.inf, 0.0])
        self._most = np.array([FARTHEST * self._working_mm] * 2 + [1.0, 1.0, np.inf, np.inf])

    def solved(self, values: np.ndarray) -> np.ndarray:
        """The best parameters, from those given."""

        def linear(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            self._reweight(self._residuals(values))
            slopes = self._slopes(values, self._free)
            weighted = slopes * self._weights[:, None]
            return weighted.T @ slopes, weighted.T @ self._residuals(values)

        def better(values: np.ndarray, step: np.ndarray) -> np.ndarray | None:
            trial = values.copy()
            trial[self._free] += step
            trial = np.clip(trial, self._least, self._most)
            return trial if self._cost(self._residuals(trial)) <= self._cost(self._residuals(values)) else None

        def is_settled(before: np.ndarray, after: np.ndarray) -> bool:
            return bool((np.abs(after - before) <= ENOUGH).all())

        return damped_least_squares(values, linear, better, is_settled, steps=ITERATIONS)

    def found(self, values: np.ndarray) -> FoundLamp:
        """The parameters with what they explain, and how sure they are."""
        residuals, shown = self._residuals(values), self._without_rest(self._seen.log_light)
        deviation = self._deviation(values, residuals)
        usual = self._without_rest(self._log_shading(START))
        weight = max(self._cost(usual), 1e-300)
        strength = float((self._weights * shown * usual).sum()) / weight
        scores = self._by_cells((self._weights * usual * (shown - strength * usual))[:, None])
        return FoundLamp(
            light=_light(values),
            deviation_mm=(float(deviation[X]), float(deviation[Y]), GRANTED[Z] * self._working_mm),
            ambient_deviation=float(deviation[AMBIENT]),
            frames=len(self._seen.poses),
            working_mm=self._working_mm,
            strength=strength,
            strength_deviation=MISFIT * float(np.sqrt((scores**2).sum())) / weight,
            explained=1 - self._cost(residuals) / max(self._cost(shown), 1e-300),
        )

    def with_vignetting(self, found: FoundLamp, values: np.ndarray, law: str) -> FoundLamp:
        """What is found, by a law: vignetting is what fits best beside the lamp of the parameters, or in its place."""
        if law == LAMP:
            return found
        told = self._seen.log_light - (self._log_shading(values) if law == BOTH else 0)
        exponent = 0.0
        for _ in range(REWEIGHTED):
            shown, slope = (self._without_exposures(each) for each in (told, self._seen.log_cosine))
            weight = max(self._cost(slope), 1e-300)
            exponent = float(np.clip((self._weights * slope * shown).sum() / weight, 0.01, MOST_VIGNETTING))
            residuals = shown - exponent * slope
            self._reweight(residuals)
        scores = self._by_cells((self._weights * slope * residuals)[:, None])
        deviation = MISFIT * float(np.sqrt((scores**2).sum())) / weight
        if law == BOTH:
            return replace(found, light=replace(found.light, vignetting=exponent), vignetting_deviation=deviation)
        explained = 1 - self._cost(residuals) / max(self._cost(shown), 1e-300)
        alone = LensLight(None, 1.0, vignetting=exponent)
        return replace(found, light=alone, vignetting_deviation=deviation, explained=explained)

    def left_over(self, light: LensLight) -> float:
        """What the logarithm of the frames' light differs by from that of a light: the mean."""
        told = self._seen.log_light - np.log(np.maximum(self._seen.shading(light), 1e-3))
        for _ in range(REWEIGHTED):
            residuals = self._without_exposures(told)
            self._reweight(residuals)
        return float(np.abs(residuals).mean())

    def _deviation(self, values: np.ndarray, residuals: np.ndarray) -> np.ndarray:
        """Standard deviations, robust to errors that depend on one another within cells (White 1980)."""
        slopes = self._slopes(values, self._free)
        weighted = slopes * self._weights[:, None]
        inverse = np.linalg.pinv(weighted.T @ slopes)
        scores = self._by_cells(weighted * residuals[:, None])
        count = len(scores)
        covariance = inverse @ (scores.T @ scores) @ inverse * (MISFIT**2 * count / max(count - 1, 1))
        granted = self._slopes(values, [Z, FALLOFF]) * [GRANTED[Z] * self._working_mm, GRANTED[FALLOFF]]
        shift = inverse @ (weighted.T @ granted)
        deviation = np.zeros(len(values))
        deviation[self._free] = np.sqrt(np.diag(covariance) + (shift**2).sum(axis=1))
        return deviation

    def _by_cells(self, values: np.ndarray) -> np.ndarray:
        """``(C, P)`` sums of ``(N, P)`` values over the cells of the surface."""
        points = self._seen.points
        places = np.floor((points - points.min(axis=0)) * (CELLS / max(float(np.ptp(points, axis=0).max()), 1e-9)))
        cell = np.unique(places, axis=0, return_inverse=True)[1].ravel()
        return np.stack([np.bincount(cell, column) for column in values.T], axis=1)

    def _reweight(self, residuals: np.ndarray) -> None:
        scatter = max(1.4826 * float(np.median(np.abs(residuals))), LEAST_SCATTER)
        self._weights = 1 / (1 + (residuals / (CAUCHY * scatter)) ** 2)

    def _cost(self, residuals: np.ndarray) -> float:
        return float((self._weights * residuals**2).sum())

    def _log_shading(self, values: np.ndarray) -> np.ndarray:
        light = _light(values)
        told = self._seen.shading(light)
        if GLOSS in self._free:
            told += values[GLOSS] * self._seen.gloss(light)
        return np.log(np.maximum(told, 1e-3))

    def _residuals(self, values: np.ndarray) -> np.ndarray:
        return self._without_rest(self._seen.log_light - self._log_shading(values))

    def _slopes(self, values: np.ndarray, parameters: list[int]) -> np.ndarray:
        """``(N, P)`` derivatives of the logarithm of the shading."""
        columns = []
        for at in parameters:
            up, down = values.copy(), values.copy()
            up[at], down[at] = up[at] + STEPS[at], down[at] - STEPS[at]
            up, down = (np.clip(each, self._least, self._most) for each in (up, down))
            columns.append((self._log_shading(up) - self._log_shading(down)) / (up[at] - down[at]))
        return self._without_rest(np.stack(columns, axis=1))

    def _without_rest(self, values: np.ndarray) -> np.ndarray:
        """``(N,)`` or ``(N, P)`` less what albedos, exposures and profile explain of them."""
        return self._without(self._linear, values)

    def _without_exposures(self, values: np.ndarray) -> np.ndarray:
        """As :meth:`_without_rest`, but for the profile."""
        return self._without(self._linear[:, : len(self._seen.poses) - 1], values)

    def _without(self, linear: np.ndarray, values: np.ndarray) -> np.ndarray:
        values, linear = self._without_albedo(values), self._without_albedo(linear)
        weighted = linear * self._weights[:, None]
        return values - linear @ (np.linalg.pinv(weighted.T @ linear) @ (weighted.T @ values))

    def _without_albedo(self, values: np.ndarray) -> np.ndarray:
        total = np.bincount(self._albedo, self._weights)
        columns = values.reshape(len(values), -1).T
        means = [(np.bincount(self._albedo, self._weights * each) / total)[self._albedo] for each in columns]
        return values - np.reshape(np.transpose(means), values.shape) if means else values
