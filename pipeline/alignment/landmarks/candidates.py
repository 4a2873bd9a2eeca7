"""Initial poses: closed-form solutions from all correspondences and from samples of three. Needs ``cv2``."""

import itertools
from collections.abc import Iterator

import cv2
import numpy as np

from ..reprojection import Correspondences, Poses

UNDISTORTED = np.zeros(4)
"""Distortion coefficients for OpenCV: none."""


def candidate_poses(correspondences: Correspondences, samples: int) -> Poses:
    """Candidate poses that see more than half of the points in front of the camera.

    From all correspondences: SQPnP (Terzakis & Lourakis 2020), EPnP (Lepetit et al. 2009), and both solutions of IPPE
    (Collins & Bartoli 2014) for the points projected onto their best-fit plane. IPPE finds both minima of points that
    are coplanar or nearly so. From samples of three correspondences: up to four AP3P solutions each (Ke & Roumeliotis
    2017), which do not depend on any other correspondence being right.

    The solvers for all correspondences run from 4 on; ``samples`` is the largest number of samples of three.
    """
    found = list(_from_all_correspondences(correspondences))
    for sample in _triples(len(correspondences), samples):
        found += _opencv_solutions(correspondences[sample], cv2.SOLVEPNP_AP3P)
    rotations = np.array([rotation for rotation, _ in found]).reshape(-1, 3, 3)
    positions = np.array([position for _, position in found]).reshape(-1, 3)
    depths = rotations[:, 2] @ correspondences.offsets.T + positions[:, 2:]
    # for degenerate points some solvers return matrices that are not rotations
    deviation = np.abs(rotations @ np.swapaxes(rotations, 1, 2) - np.eye(3)).max(axis=(1, 2))
    return Poses(rotations, positions)[((depths > 0).mean(axis=1) > 0.5) & (deviation < 1e-6)]


def _from_all_correspondences(correspondences: Correspondences) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    if len(correspondences) >= 4:
        yield from _opencv_solutions(correspondences, cv2.SOLVEPNP_SQPNP)
        yield from _opencv_solutions(correspondences, cv2.SOLVEPNP_EPNP)
        centre = correspondences.offsets.mean(axis=0)
        _, _, axes = np.linalg.svd(correspondences.offsets - centre)
        axes[2] *= np.linalg.det(axes)
        flat = (correspondences.offsets - centre) @ axes.T
        flat[:, 2] = 0
        for rotation, position in _opencv_solutions(
            Correspondences(flat, correspondences.pixels, correspondences.camera, centre), cv2.SOLVEPNP_IPPE
        ):
            from_model = rotation @ axes
            yield from_model, position - from_model @ centre


def _triples(count: int, samples: int) -> Iterator[list[int]]:
    """At most ``samples`` triples of indices below ``count``; deterministic for a given ``count``."""
    triples = list(itertools.combinations(range(count), 3))
    if len(triples) > samples:
        chosen = np.random.default_rng(count).choice(len(triples), samples, replace=False)
        triples = [triples[index] for index in sorted(chosen)]
    yield from (list(triple) for triple in triples)


def _opencv_solutions(correspondences: Correspondences, method: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """``(3, 3)`` rotations and ``(3,)`` positions from one of OpenCV's solvers; empty where it fails."""
    try:
        if len(correspondences) == 3:
            _, rotation_vectors, translations = cv2.solveP3P(
                correspondences.offsets, correspondences.pixels, correspondences.camera.k, UNDISTORTED, flags=method
            )
        else:
            _, rotation_vectors, translations, _ = cv2.solvePnPGeneric(
                correspondences.offsets, correspondences.pixels, correspondences.camera.k, UNDISTORTED, flags=method
            )
    except cv2.error:
        # degenerate points; another solver may succeed, and check_fit refuses what none can solve
        return []
    return [
        (cv2.Rodrigues(rotation_vector)[0], np.ravel(translation))
        for rotation_vector, translation in zip(rotation_vectors, translations, strict=True)
        if np.isfinite(rotation_vector).all() and np.isfinite(translation).all()
    ]
