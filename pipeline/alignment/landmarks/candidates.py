"""Poses to start from: closed-form solutions of all pairs and of samples of three. Needs ``cv2``."""

import itertools
from collections.abc import Iterator

import cv2
import numpy as np

from .reprojection import Correspondences, Poses

UNDISTORTED = np.zeros(4)


def candidate_poses(pairs: Correspondences, samples: int) -> Poses:
    """Poses in front of which most points lie, each near one that could explain the pairs.

    From all pairs: SQPnP (Terzakis & Lourakis 2020), EPnP (Lepetit et al. 2009) and both solutions of IPPE (Collins &
    Bartoli 2014) for the points laid flat on their plane of best fit, which finds the two minima of points that are
    coplanar or nearly so. From samples of three pairs: up to four solutions each (Ke & Roumeliotis 2017), which need no
    other pair to be right; ``samples`` of them at most.
    """
    found = list(_from_all(pairs))
    for sample in _samples(len(pairs), samples):
        found += _solutions(pairs[sample], cv2.SOLVEPNP_AP3P)
    rotations = np.array([rotation for rotation, _ in found]).reshape(-1, 3, 3)
    positions = np.array([position for _, position in found]).reshape(-1, 3)
    depths = rotations[:, 2] @ pairs.offsets.T + positions[:, 2:]
    # degenerate points make some solvers return what is no rotation
    deviation = np.abs(rotations @ np.swapaxes(rotations, 1, 2) - np.eye(3)).max(axis=(1, 2))
    return Poses(rotations, positions)[((depths > 0).mean(axis=1) > 0.5) & (deviation < 1e-6)]


def _from_all(pairs: Correspondences) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    if len(pairs) >= 4:
        yield from _solutions(pairs, cv2.SOLVEPNP_SQPNP)
        yield from _solutions(pairs, cv2.SOLVEPNP_EPNP)
        centre = pairs.offsets.mean(axis=0)
        _, _, axes = np.linalg.svd(pairs.offsets - centre)
        axes[2] *= np.linalg.det(axes)
        flat = (pairs.offsets - centre) @ axes.T
        flat[:, 2] = 0
        for rotation, position in _solutions(
            Correspondences(flat, pairs.pixels, pairs.camera, centre), cv2.SOLVEPNP_IPPE
        ):
            turned = rotation @ axes
            yield turned, position - turned @ centre


def _samples(count: int, samples: int) -> Iterator[list[int]]:
    """Triples of ``count`` pairs, all of them if they are few; always the same for the same number of pairs."""
    triples = list(itertools.combinations(range(count), 3))
    if len(triples) > samples:
        chosen = np.random.default_rng(count).choice(len(triples), samples, replace=False)
        triples = [triples[index] for index in sorted(chosen)]
    yield from (list(triple) for triple in triples)


def _solutions(pairs: Correspondences, method: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotations and positions that a solver of OpenCV gives; none where it gives up."""
    try:
        if len(pairs) == 3:
            _, turns, shifts = cv2.solveP3P(pairs.offsets, pairs.pixels, pairs.camera.k, UNDISTORTED, flags=method)
        else:
            _, turns, shifts, _ = cv2.solvePnPGeneric(
                pairs.offsets, pairs.pixels, pairs.camera.k, UNDISTORTED, flags=method
            )
    except cv2.error:  # its checks for degenerate points; other starts may do, and what cannot be solved is told later
        return []
    return [
        (cv2.Rodrigues(turn)[0], np.ravel(shift))
        for turn, shift in zip(turns, shifts, strict=True)
        if np.isfinite(turn).all() and np.isfinite(shift).all()
    ]
