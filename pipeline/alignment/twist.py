"""Small motions of a pose: twists in camera axes about a pivot.

A twist is ``(6,)``: a translation in mm, then a rotation vector in radians, both along the axes of ``cam``. Applied to
a pose about a pivot P of the model, seen at p = R P + t, it carries a point y of the camera frame to
exp(rotation) (y - p) + p + translation: P moves by the translation alone, whatever the rotation. So the two halves
keep apart, and each has a meaning for the eye: the pivot shifts, the model turns about it.
"""

import numpy as np

from ..frames import rigid, rotation_from_vector, transform_points


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """``(3, 3)`` rotation -> ``(3,)`` axis times angle in radians, angle 0..pi; the inverse of Rodrigues' formula."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (float(np.trace(rotation)) - 1)
    angle = float(np.arctan2(sine, cosine))
    if cosine > -0.9:
        return skew * (angle / sine if sine > 1e-12 else 1.0)
    # near a half turn the skew part vanishes; the axis stands in the symmetric one, its sign in the skew part
    outer = 0.5 * (rotation + rotation.T) - cosine * np.eye(3)
    column = outer[:, int(np.argmax(np.diag(outer)))]
    axis = column / np.linalg.norm(column)
    return axis * (angle if axis @ skew >= 0 else -angle)


def rotations_from_vectors(vectors: np.ndarray) -> np.ndarray:
    """``(K, 3)`` rotation vectors -> ``(K, 3, 3)`` rotations: Rodrigues' formula for many."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    cross = cross_matrices(vectors)
    # sinc forms stay exact as the angle goes to zero
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross @ cross


def cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """``(..., 3)`` vectors a -> ``(..., 3, 3)`` matrices of the cross product, [a]x b = a x b."""
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 2, 1] = vectors[..., 0]
    matrices[..., 0, 2] = vectors[..., 1]
    matrices[..., 1, 0] = vectors[..., 2]
    return matrices - np.swapaxes(matrices, -1, -2)


def moved_by(twist: np.ndarray, cam_from_model: np.ndarray, pivot_model: np.ndarray) -> np.ndarray:
    """The pose ``(4, 4)`` after a twist ``(6,)`` in camera axes about a pivot ``(3,)`` of the model, mm."""
    rotation = rotation_from_vector(np.asarray(twist[3:], float)) @ cam_from_model[:3, :3]
    pivot_cam = transform_points(cam_from_model, pivot_model) + twist[:3]
    return rigid(rotation, pivot_cam - rotation @ pivot_model)


def twist_between(cam_from_model: np.ndarray, other: np.ndarray, pivot_model: np.ndarray) -> np.ndarray:
    """The twist ``(6,)`` about a pivot of the model that moves one pose to another: the inverse of :func:`moved_by`."""
    translation = transform_points(other, pivot_model) - transform_points(cam_from_model, pivot_model)
    return np.concatenate([translation, rotation_vector(other[:3, :3] @ cam_from_model[:3, :3].T)])
