"""Trials of the registration: a photograph with a known pose is registered to a case, from nothing or tracked.

The truth counts as it is published: the sample's is exact, bloster's good to about 2 px, LM-O's to 2 to 6 px.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np

from oneframe.alignment.refinement.verification import mean_distance_px
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.frame import PosedFrame
from oneframe.case.loaded_case import LoadedCase
from oneframe.case.pose_record import UNKNOWN
from oneframe.errors import InputError
from oneframe.images.pixel_values import to_uint8
from oneframe.registration.further_frames import FurtherFrame
from oneframe.registration.register import Guess, RegisteredFrame, Registrar, judged_together
from oneframe.registration.verdict import ACCEPTED, REFUSED, WITHIN_DEG, WITHIN_PX, WITHIN_SHARE, Verdict
from oneframe.surface.mesh import TriangleMesh
from oneframe.transforms import camera_centre, inverse_rigid, rotation_angle_deg, transform_points

from .refinement_scenes import visible_points

NO_ERROR = (math.nan, math.nan, math.nan)
DRAWS = 500
"""Draws of the bootstrap."""


@dataclass(frozen=True)
class RegistrationTrial:
    """One photograph: a row of the table.

    Attributes
    ----------
    part
        Of the benchmark: ``photographs``, ``film``, ``grid``, ``limits``.
    scene, real
        The data set, and whether its images are photographs, not rendered.
    source, frame
        The aligned frame, and the one that is registered.
    kind, amount
        What was done to the frame, or what is swept, and how much.
    angle_deg
        Between the directions from which both see the surface.
    state, probability, seconds
        The verdict, and the processor time it took.
    error_deg, error_percent, error_px
        Of the pose: rotation, place in percent of the distance, mean displacement of the visible surface at the size
        of registration. NaN without a pose, infinite if the image does not show the surface.
    """

    part: str
    scene: str
    real: bool
    source: str
    frame: str
    kind: str
    amount: float
    angle_deg: float
    state: str
    probability: float
    seconds: float
    error_deg: float
    error_percent: float
    error_px: float

    @property
    def right(self) -> bool:
        """Whether the pose is within the limits that the verdict speaks of."""
        return self.error_deg <= WITHIN_DEG and self.error_percent <= 100 * WITHIN_SHARE and self.error_px <= WITHIN_PX

    @property
    def found(self) -> bool:
        """Whether the pose is accepted, and right."""
        return self.state == ACCEPTED and self.right

    @property
    def wrong(self) -> bool:
        """Whether the pose is accepted, and wrong."""
        return self.state == ACCEPTED and not self.right


@dataclass(frozen=True)
class Scene:
    """A case whose aligned frame is the source, and other photographs of its surface, at the size of registration."""

    name: str
    real: bool
    loaded: LoadedCase
    photographs: tuple[PosedFrame, ...]

    def sources(self, most: int | None = None) -> Iterator["Scene"]:
        """The same photographs with one after the other as the source, spread over all of them."""
        frames = (self.loaded.frame, *self.photographs)
        for number in range(len(frames)) if most is None else spread(len(frames), most):
            yield replace(
                self, loaded=posed_at(self.loaded, frames[number]), photographs=frames[:number] + frames[number + 1 :]
            )


def posed_at(loaded: LoadedCase, frame: PosedFrame) -> LoadedCase:
    """The case with another frame."""
    pose = frame.cam_from_model @ inverse_rigid(loaded.surface.mesh_from_model)
    return replace(loaded, frames=(frame,)).posed(pose, UNKNOWN)


def spread(count: int, most: int) -> list[int]:
    """At most so many numbers below ``count``, evenly spread."""
    return sorted({round(number) for number in np.linspace(0, count - 1, min(most, count))})


class Registration:
    """Registers photographs to a scene's source, and compares the poses with the known ones."""

    def __init__(self, scene: Scene, part: str, guess: Guess | None = None) -> None:
        """Prepare a source; ``part`` is that of the rows, ``guess`` of a network."""
        self.scene, self._part = scene, part
        self.registrar = Registrar(scene.loaded, guess)
        self._found: list[RegisteredFrame] = []

    def angle_deg(self, cam_from_model: np.ndarray) -> float:
        """Between the directions from which a pose and the source see the middle of what the source shows."""
        poses, pivot = (cam_from_model, self.registrar.cam_from_model), self.registrar.pivot_model
        one, other = ((camera_centre(pose) - pivot) for pose in poses)
        return math.degrees(math.acos(np.clip(one @ other / np.linalg.norm(one) / np.linalg.norm(other), -1, 1)))

    def trial(
        self,
        frame: PosedFrame,
        kind: str,
        amount: float = 0.0,
        *,
        image: np.ndarray | None = None,
        shows: bool = True,
        tracked: int | None = None,
    ) -> RegistrationTrial:
        """Register a frame, or what became of its image; ``tracked`` is its number in a film, if it is of one.

        ``shows`` is whether the image shows the surface at all. It is judged alone, see :meth:`together`.
        """
        codes, true = to_uint8(frame.image if image is None else image), frame.cam_from_model
        further = FurtherFrame("" if tracked is not None else "frame", tracked or 0, codes, frame.valid)
        began = time.process_time()
        registered = RegisteredFrame(Verdict(REFUSED, 0.0, "too little texture"))
        with suppress(InputError):
            registered = self.registrar.register(further)
        seconds = time.process_time() - began
        self._found.append(replace(registered, fit=None))
        found, verdict = registered.cam_from_model, judged_together([registered])[0].verdict
        errors = NO_ERROR if found is None else (math.inf,) * 3 if not shows else self.errors(found, true)
        name, scene = frame.path.stem, self.scene
        return RegistrationTrial(
            self._part, scene.name, scene.real, scene.loaded.frame.path.stem, name, kind, amount,
            self.angle_deg(true), verdict.state, verdict.probability, seconds, *errors,
        )  # fmt: skip

    def together(self, trials: Iterable[RegistrationTrial]) -> list[RegistrationTrial]:
        """The latest trials, judged as the frames of one set."""
        trials = list(trials)
        verdicts = (each.verdict for each in judged_together(self._found[len(self._found) - len(trials) :]))
        return [
            replace(trial, state=verdict.state, probability=verdict.probability)
            for trial, verdict in zip(trials, verdicts, strict=True)
        ]

    def errors(self, found: np.ndarray, true: np.ndarray) -> tuple[float, float, float]:
        """By how much a pose is off, see :func:`pose_errors`."""
        return pose_errors(found, true, self.registrar.mesh, self.registrar.camera)


def pose_errors(
    found: np.ndarray, true: np.ndarray, mesh: TriangleMesh, camera: PinholeCamera
) -> tuple[float, float, float]:
    """By how much a pose is off: degrees; of the visible surface, the shift of its middle in percent of its distance,
    and its mean displacement in px.
    """
    points = visible_points(mesh, camera, true)
    middle = points.mean(axis=0)[None]
    places = [transform_points(pose, middle)[0] for pose in (found, true)]
    return (
        rotation_angle_deg(found[:3, :3] @ true[:3, :3].T),
        100 * float(np.linalg.norm(places[0] - places[1]) / np.linalg.norm(places[1])),
        mean_distance_px(camera, points, found, true),
    )


def share(
    trials: Sequence[RegistrationTrial], counts: Callable[[RegistrationTrial], bool]
) -> tuple[float, float, float]:
    """Share of the trials that count, and its 95 % interval: a bootstrap over sources, whose trials go together."""
    clusters: dict[tuple[str, str], list[bool]] = {}
    for trial in trials:
        clusters.setdefault((trial.scene, trial.source), []).append(counts(trial))
    sums = np.array([(sum(each), len(each)) for each in clusters.values()])
    drawn = sums[np.random.default_rng(0).integers(len(sums), size=(DRAWS, len(sums)))].sum(axis=1)
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1], (0.025, 0.975))
    return float(sums[:, 0].sum()) / float(sums[:, 1].sum()), float(low), float(high)


def resized(frame: PosedFrame, factor: float) -> PosedFrame:
    """The frame at another size."""
    camera = frame.camera.resized(round(factor * frame.camera.width), round(factor * frame.camera.height))
    image, valid = (
        cv2.resize(each.astype(np.float32), camera.size_wh, interpolation=cv2.INTER_AREA)
        for each in (frame.image, frame.valid)
    )
    return replace(frame, image=image, valid=valid > 0.99, camera=camera)
