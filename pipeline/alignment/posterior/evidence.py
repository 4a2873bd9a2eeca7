"""Evidence for a pose besides landmarks: the image, a known distance or roll. Each is a normal density of the pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ...transforms import inverse_rigid, transform_points
from ..pose_uncertainty import PoseUncertainty
from ..reprojection import apply_twist, twist_between

Kind = Literal["image", "distance", "roll"]

IMAGE: Kind = "image"

UNKNOWN = 10.0
"""Standard deviation of what a prior does not say, in distances and in radians: wide enough to say nothing."""


@dataclass(frozen=True)
class PoseEvidence:
    """A normal density of the pose.

    Attributes
    ----------
    kind
        Where it comes from.
    cam_from_model
        ``(4, 4)`` its mean, mm.
    uncertainty
        Of this pose.
    """

    kind: Kind
    cam_from_model: np.ndarray
    uncertainty: PoseUncertainty

    def reframed(self, old_from_new: np.ndarray) -> "PoseEvidence":
        """The same of the surface in another frame; ``old_from_new`` is ``(4, 4)``, mm."""
        pivot = transform_points(inverse_rigid(old_from_new), self.uncertainty.pivot_model)
        return PoseEvidence(self.kind, self.cam_from_model @ old_from_new, replace(self.uncertainty, pivot_model=pivot))


def view_prior(
    kind: Literal["distance", "roll"],
    cam_from_model: np.ndarray,
    pivot_model: np.ndarray,
    radius_mm: float,
    deviation: float,
) -> PoseEvidence:
    """A prior on the distance of the pivot, or on the roll about the view ray.

    Parameters
    ----------
    kind
        One of the two.
    cam_from_model
        ``(4, 4)`` a pose near the wanted one, at the expected distance, or with the expected roll.
    pivot_model, radius_mm
        ``(3,)`` the middle of the surface, and its size.
    deviation
        Standard deviation of the distance in mm, or of the roll in radians.
    """
    pivot_cam = transform_points(cam_from_model, pivot_model)
    distance = float(np.linalg.norm(pivot_cam))
    unknown = UNKNOWN * np.array([distance] * 3 + [1.0] * 3)
    covariance, first = np.diag(unknown**2), 0 if kind == "distance" else 3
    part, ray = slice(first, first + 3), pivot_cam / distance
    covariance[part, part] += (deviation**2 - unknown[first] ** 2) * np.outer(ray, ray)
    uncertainty = PoseUncertainty(pivot_model, covariance, np.inf, np.nan, radius_mm, pivot_cam)
    return PoseEvidence(kind, cam_from_model, uncertainty)


def fused(evidence: Sequence[PoseEvidence]) -> PoseEvidence:
    """The density of the pose from all of some evidence, at least one, the most certain first."""
    first = evidence[0]
    if len(evidence) == 1:
        return first
    pivot = first.uncertainty.pivot_model
    spreads = [each.uncertainty.about(pivot, each.cam_from_model) for each in evidence]
    precisions = np.linalg.inv([spread.covariance for spread in spreads])
    twists = [twist_between(first.cam_from_model, each.cam_from_model, pivot) for each in evidence]
    covariance = np.linalg.inv(precisions.sum(axis=0))
    mean = covariance @ np.einsum("kij,kj->i", precisions, np.array(twists))
    pose = apply_twist(mean, first.cam_from_model, pivot)
    shares = np.linalg.eigvals(covariance @ precisions).real
    dof = joint_dof(shares, [spread.dof for spread in spreads])
    uncertainty = replace(spreads[0], covariance=covariance, dof=dof, pivot_cam=transform_points(pose, pivot))
    return PoseEvidence(first.kind, pose, uncertainty)


def joint_dof(shares: np.ndarray, dofs: Sequence[float]) -> float:
    """Degrees of freedom of a sum of covariances, each estimated with its own: Welch and Satterthwaite's.

    Parameters
    ----------
    shares
        ``(K, D)`` fractions of the sum, 0..1, in each of D directions; the inverses of theirs are averaged.
    dofs
        ``(K,)`` of each.
    """
    total = float((shares**2 / np.array(dofs)[:, None]).sum(axis=0).mean())
    return 1 / total if total > 0 else np.inf
