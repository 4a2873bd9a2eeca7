"""Register frames: the pose of each, from the pose before it or from nothing, and whether to trust it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..alignment.pose_uncertainty import PoseUncertainty
from ..camera.pinhole import PinholeCamera
from ..colour.source_view import SourceView
from ..errors import InputError
from ..surface.mesh import TriangleMesh
from .flow_refinement import FlowFit, refined_by_flow
from .known_views import KnownViews
from .localise import Localised, ViewBank, bank_of, localised
from .verdict import ACCEPTED, DOUBTFUL, LEAST_ACCEPTED, LEAST_DOUBTFUL, REFUSED, Verdict, judge
from .zoom import Zoom, at_same_focal_length, understated

LEAST_FEATURES = 200


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
        Of the pose, as far as the frame tells: for the error of the aligned frame's see :mod:`.source_uncertainty`.
    fit
        What the pose was found from.
    zoom
        The focal length that fits best; judged by :func:`judged_together`.
    """

    verdict: Verdict
    cam_from_model: np.ndarray | None = None
    uncertainty: PoseUncertainty | None = None
    fit: FlowFit | None = None
    zoom: Zoom | None = None


def judged_together(frames: Sequence[RegisteredFrame]) -> list[RegisteredFrame]:
    """Frames of one set, in their order, less sure or refused where they seem to be zoomed.

    Where their zooms scatter by more than they state, as on a soft surface, the covariances of all poses grow as much.
    """
    judged = list(frames)
    zooms = {number: frame.zoom for number, frame in enumerate(frames) if frame.zoom is not None}
    if not zooms:
        return judged
    same_of_all = at_same_focal_length(list(zooms.values()))
    factor = understated(list(zooms.values()), same_of_all)
    for number, same in zip(zooms, same_of_all, strict=True):
        found = frames[number]
        if found.uncertainty is not None:
            found = replace(found, uncertainty=found.uncertainty.widened(factor))
        probability = found.verdict.probability * float(same)
        reason = (
            f"the zoom seems to be {zooms[number].factor:.2f} times that of the case's frame, or that frame's pose is "
            f"off (--correct-source)"
        )
        if max(probability, float(same)) < LEAST_DOUBTFUL:
            judged[number] = RegisteredFrame(Verdict(REFUSED, probability, reason))
            continue
        verdict = replace(found.verdict, probability=probability)
        if verdict.state == ACCEPTED and probability < LEAST_ACCEPTED:
            verdict = Verdict(DOUBTFUL, probability, reason)
        judged[number] = replace(found, verdict=verdict)
    return judged


class Registrar:
    """Registers frames of one camera to a surface, by what an aligned frame shows of it."""

    def __init__(self, mesh: TriangleMesh, source: SourceView, pivot_model: np.ndarray) -> None:
        """Prepare a surface (model frame), the aligned frame and the ``(3,)`` middle of what it shows, mm."""
        self._views, self._pivot_model = KnownViews(mesh, source), pivot_model

    @property
    def camera(self) -> PinholeCamera:
        """Of the frames."""
        return self._views.source.camera

    @cached_property
    def _bank(self) -> ViewBank:
        bank = bank_of(self._views, self._pivot_model)
        if len(bank) < LEAST_FEATURES:
            raise InputError(
                f"the case's frame: expected texture on the surface, found {len(bank)} features (at least "
                f"{LEAST_FEATURES}); choose a sharper frame"
            )
        return bank

    def register(self, grey: np.ndarray, valid: np.ndarray, near: np.ndarray | None = None) -> RegisteredFrame:
        """Register a frame.

        Parameters
        ----------
        grey, valid
            ``(H, W)`` uint8 undistorted image, and ``(H, W)`` bool: pixels that may be used.
        near
            ``(4, 4)`` a pose that may be near, such as the frame's before.

        Raises
        ------
        InputError
            The aligned frame shows too little texture on the surface.
        """
        if near is not None:
            registered = self._judged(refined_by_flow(self._views, grey, valid, near), None)
            if registered.verdict.state == ACCEPTED:
                return registered
        found = localised(self._bank, self.camera, grey, valid)
        fit = None if found is None else refined_by_flow(self._views, grey, valid, found.cam_from_model)
        return self._judged(fit, found)

    def _judged(self, fit: FlowFit | None, found: Localised | None) -> RegisteredFrame:
        verdict, uncertainty = judge(fit, found, self._pivot_model)
        if fit is None or verdict.state == REFUSED:
            return RegisteredFrame(verdict)
        return RegisteredFrame(verdict, fit.cam_from_model, uncertainty, fit)
