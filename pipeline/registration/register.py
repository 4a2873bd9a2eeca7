"""Register frames to a case: the pose of each, from the pose before it or from nothing, and whether to trust it."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.pinhole import PinholeCamera
from ..case.loaded_case import LoadedCase
from ..colour.reference_view import reference_view
from ..errors import InputError
from ..files.numbers import format_two_digits
from ..transforms import camera_centre, inverse_rigid
from .flow_refinement import FlowFit, refined_by_flow
from .further_frames import LONGER_SIDE_PX, FrameReader, FurtherFrame, small_frame
from .known_views import KnownViews, Localised, ViewBank, bank_of, grey_codes, localised
from .verdict import (
    ACCEPTED,
    DOUBTFUL,
    LEAST_ACCEPTED,
    LEAST_DOUBTFUL,
    REFUSED,
    FilmAgreement,
    FilmChange,
    Verdict,
    judge,
    within,
)
from .zoom import Zoom, at_same_focal_length, understated, zoom_of

LEAST_FEATURES = 200
SURE = 0.995
"""Probability of a guess above which features are not asked: they find another pose in a few of those below."""
SURFACE_SHARE = 1 / 3000
"""Standard deviation of the surface's depth as a whole, seen from the aligned frame, relative to the distance: 0.1 mm
at 300 mm. Two surfaces from CT with voxels of 0.4 mm were 0.05 and 0.1 mm off; half or twice as much covers as many."""
MOST_KEPT = 60
"""Accepted frames whose images are kept, to colour the surface: of more, evenly chosen ones."""

Guess = Callable[[np.ndarray, PinholeCamera], Iterable[np.ndarray]]
"""Gives first poses ``cam_from_model`` of an undistorted image ``(H, W, 3)`` uint8, the likeliest first, as needed."""


@dataclass(frozen=True)
class RegisteredFrame:
    """A frame with its pose, unless it is refused.

    Attributes
    ----------
    verdict
        State, probability and reason.
    cam_from_model
        ``(4, 4)`` the pose, mm.
    uncertainty
        That of the pose, with the zoom as the case's.
    fit
        What the pose was found from.
    zoom
        The focal length that fits best; judged by :func:`judged_together`.
    by_zoom
        ``(6,)`` by how much a standard deviation of the zoom would move the pose, mm and radians.
    changed
        Whether the film no longer shows there what the case's frame shows.
    """

    verdict: Verdict
    cam_from_model: np.ndarray | None = None
    uncertainty: PoseUncertainty | None = None
    fit: FlowFit | None = None
    zoom: Zoom | None = None
    by_zoom: np.ndarray = field(default_factory=partial(np.zeros, 6))
    changed: bool = False


class Registrar:
    """Registers frames to a case, by what its aligned frame shows of the surface."""

    def __init__(self, loaded: LoadedCase, guess: Guess | None = None) -> None:
        """Prepare a case at its pose; ``guess`` is asked before the features."""
        self.loaded, self.reader, self._guess = loaded, FrameReader(loaded.case), guess
        view = reference_view(replace(loaded, frames=(small_frame(loaded.frame),)))
        self.mesh, self.case_view, self.pivot_model = view.mesh, view.view, view.pivot_model
        self.camera, self.cam_from_model = self.case_view.camera, self.case_view.cam_from_model
        self.views = KnownViews(self.mesh, self.case_view)
        own = _stated(loaded, self.case_view.shown_points())
        self.own = None if own is None else own.about(self.pivot_model, self.cam_from_model)
        self._before: tuple[np.ndarray, ...] = ()

    def register(self, frame: FurtherFrame) -> RegisteredFrame:
        """Register the next frame, that of a video from those before.

        What the surface and the case's own pose are off is included; whether the frame is zoomed, the others of its set
        tell: :func:`.judged_together`.
        """
        registered = self.register_alone(frame)
        if registered.fit is None:
            return registered
        return self.with_case(replace(registered, zoom=zoom_of(registered.fit, self.pivot_model)))

    def with_case(self, registered: RegisteredFrame) -> RegisteredFrame:
        """A frame whose covariance, probability and state include what surface and aligned frame are off.

        To first order, what the aligned frame shows moves with its pose as a whole, and takes the others along. A
        surface that is too deep along its rays is one scaled about its centre: so is the way from there to the frame.
        """
        pose, alone = registered.cam_from_model, registered.uncertainty
        if pose is None or alone is None:
            return registered
        way = pose[:3, :3] @ (camera_centre(pose) - camera_centre(self.cam_from_model))
        both = alone.plus(np.pad(SURFACE_SHARE**2 * np.outer(way, way), (0, 3)))
        if self.own is not None:
            turn = np.kron(np.eye(2), pose[:3, :3] @ self.cam_from_model[:3, :3].T)
            both = both.plus(turn @ self.own.covariance @ turn.T)
        kept = min(within(both, self.camera) / max(within(alone, self.camera), 1e-9), 1.0)
        verdict = replace(registered.verdict, probability=registered.verdict.probability * kept)
        if verdict.state == ACCEPTED and verdict.probability < LEAST_ACCEPTED:
            reason = f"{verdict.reason}, but the aligned frame's pose is not sure"
            verdict = replace(verdict, state=DOUBTFUL, reason=reason)
        return replace(registered, verdict=verdict, uncertainty=both)

    def register_alone(self, frame: FurtherFrame, near: np.ndarray | None = None) -> RegisteredFrame:
        """Register a frame as if the case's pose were certain, from a pose ``(4, 4)`` that may be near."""
        if frame.problem:
            self._before = ()
            return RegisteredFrame(Verdict(REFUSED, 0.0, frame.problem))
        if near is None and not frame.name and self._before:
            # the camera goes on as it did
            near = self._before[-1] @ inverse_rigid(self._before[0]) @ self._before[-1]
        registered = self.find(frame, near)
        pose = registered.cam_from_model if registered.verdict.state == ACCEPTED else None
        self._before = () if pose is None else (*self._before[-1:], pose)
        return registered

    def find(self, frame: FurtherFrame, near: np.ndarray | None = None) -> RegisteredFrame:
        """A frame that can be used: by a pose that may be near, by guesses, and by features, which take longer."""
        grey = grey_codes(frame.image)
        if near is not None:
            registered = self._refined(grey, frame.valid, near)
            if registered.verdict.state == ACCEPTED:
                return registered
        others = list[RegisteredFrame]()
        for guess in () if self._guess is None else self._guess(frame.image, self.camera):
            others.append(self._refined(grey, frame.valid, guess))
            if others[-1].verdict.probability > SURE:
                return others[-1]
        found = localised(self._bank, self.camera, grey, frame.valid)
        own = self._judged(None) if found is None else self._refined(grey, frame.valid, found.cam_from_model, found)
        return max([own, *others], key=lambda each: each.verdict.probability)

    def _refined(
        self, grey: np.ndarray, valid: np.ndarray, cam_from_model: np.ndarray, found: Localised | None = None
    ) -> RegisteredFrame:
        """A frame refined from a rough pose."""
        return self._judged(refined_by_flow(self.views, grey, valid, cam_from_model), found)

    def _judged(self, fit: FlowFit | None, found: Localised | None = None) -> RegisteredFrame:
        verdict, uncertainty = judge(fit, found, self.pivot_model)
        if fit is None or verdict.state == REFUSED:
            return RegisteredFrame(verdict)
        return RegisteredFrame(verdict, fit.cam_from_model, uncertainty, fit)

    @cached_property
    def _bank(self) -> ViewBank:
        bank = bank_of(self.views, self.pivot_model)
        if len(bank) < LEAST_FEATURES:
            raise InputError(
                f"the case's frame: expected texture on the surface, found {len(bank)} features (at least "
                f"{LEAST_FEATURES}); choose a sharper frame"
            )
        return bank


class RegistrationRun:
    """Registers frames one after the other, and keeps what each tells alone, and what all tell together.

    Attributes
    ----------
    alone
        Number of a frame -> what was found in it, without the fit.
    kept
        Some of the accepted frames, evenly chosen.
    """

    def __init__(self, registrar: Registrar, *, is_film: bool) -> None:
        self.registrar, self._is_film = registrar, is_film
        self._agreement = FilmAgreement(registrar.camera, registrar.cam_from_model, registrar.pivot_model)
        self.alone, self.kept = dict[int, RegisteredFrame](), list[FurtherFrame]()
        self._accepted, self._step = 0, 1

    def register(self, frame: FurtherFrame) -> RegisteredFrame:
        """Register the next frame, see :meth:`Registrar.register`."""
        registered = self.registrar.register(frame)
        if registered.fit is not None and registered.verdict.state == ACCEPTED:
            if self._is_film:
                self._agreement.add(frame.number, registered.fit)
            if self._accepted % self._step == 0:
                self.kept.append(frame)
            self._accepted += 1
            if len(self.kept) > MOST_KEPT:
                del self.kept[1::2]
                self._step *= 2
        self.alone[frame.number] = replace(registered, fit=None)
        return registered

    def judged(self) -> dict[int, RegisteredFrame]:
        """The frames, judged together."""
        return dict(zip(self.alone, judged_together(list(self.alone.values())), strict=True))

    def change(self) -> FilmChange | None:
        """What a film no longer shows as the case's frame does."""
        return self._agreement.change()

    def accepted(self, frames: Mapping[int, RegisteredFrame]) -> list[FurtherFrame]:
        """The kept frames that are still accepted, and show the surface as the case's frame does."""
        poses = accepted_poses(frames)
        return [each for each in self.kept if each.number in poses]


def judged_together(frames: Sequence[RegisteredFrame]) -> list[RegisteredFrame]:
    """Frames of one set, in their order, less sure or refused where they seem to be zoomed.

    Where their zooms scatter by more than they state, as on a soft surface, the covariances of all poses grow as much.
    """
    judged = list(frames)
    zooms = {number: frame.zoom for number, frame in enumerate(frames) if frame.zoom is not None}
    if not zooms:
        return judged
    same_of_all, deviations = at_same_focal_length(list(zooms.values()))
    factor = understated(list(zooms.values()), same_of_all)
    for (number, zoom), same, deviation in zip(zooms.items(), same_of_all, deviations, strict=True):
        frame = frames[number]
        if frame.uncertainty is not None:
            frame = replace(frame, uncertainty=frame.uncertainty.widened(factor), by_zoom=deviation * zoom.moves)
        probability = frame.verdict.probability * float(same)
        reason = (
            f"the zoom seems to be {zoom.factor:.2f} times that of the case's frame, or that frame's pose is "
            f"off (--correct-source)"
        )
        if max(probability, float(same)) < LEAST_DOUBTFUL:
            judged[number] = RegisteredFrame(Verdict(REFUSED, probability, reason))
            continue
        verdict = replace(frame.verdict, probability=probability)
        if verdict.state == ACCEPTED and probability < LEAST_ACCEPTED:
            verdict = Verdict(DOUBTFUL, probability, reason)
        judged[number] = replace(frame, verdict=verdict)
    return judged


def marked(frames: Mapping[int, RegisteredFrame], change: FilmChange | None) -> dict[int, RegisteredFrame]:
    """The frames by their numbers, those marked that no longer show what the case's frame shows."""
    since = np.inf if change is None else change.since
    return {number: replace(each, changed=each.changed or number >= since) for number, each in frames.items()}


def accepted_poses(frames: Mapping[int, RegisteredFrame]) -> dict[int, np.ndarray]:
    """The poses ``cam_from_model`` of accepted frames that show what the case's frame shows, by number."""
    return {
        number: each.cam_from_model
        for number, each in frames.items()
        if each.verdict.state == ACCEPTED and each.cam_from_model is not None and not each.changed
    }


def doubt_of_case(loaded: LoadedCase) -> str:
    """A sentence if no frame can be accepted, so unsure is the case's own pose; empty otherwise."""
    own = _stated(loaded, loaded.surface.mesh.vertices)
    probability = 1.0 if own is None else within(own, loaded.frame.camera.within(LONGER_SIDE_PX))
    if own is None or probability >= LEAST_ACCEPTED:
        return ""
    return (
        f"the case's own pose is within the limits of an accepted one with {probability:.0%} only: ±"
        f"{format_two_digits(own.largest_rotation_deg)}°, least certain: {own.weakest}; no frame can be surer; "
        "refine it, or add --correct-source"
    )


def _stated(loaded: LoadedCase, points_model: np.ndarray) -> PoseUncertainty | None:
    """How sure the case's pose is, if the case states it; ``(N, 3)`` points stand for the surface."""
    pose, mesh_from_model = loaded.frame.cam_from_model, loaded.surface.mesh_from_model
    return PoseUncertainty.stated(loaded.case.alignment, points_model, pose, mesh_from_model)
