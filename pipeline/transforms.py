"""Coordinate frames and rigid transforms: the conventions of the project, as code.

Frames
------
``mesh``
    The frame of the mesh file and of the user's pose, ``cam_from_mesh``, in millimetres.
``model``
    ``mesh`` moved so that the mean of the surface's vertices is the origin (V' = V - mean(V), Zhang & Noble). All
    computation and every dataset file uses it; each dataset stores ``mesh_from_model``.
``cam``
    A camera with OpenCV axes: x right, y down, z forward, origin at the centre of projection.
``px``
    Pixels: x right, y down, (0, 0) is the *centre* of the top-left pixel.

Transforms are named ``b_from_a`` and are 4x4 float64 matrices that act on column vectors, so neighbours cancel when
they are composed: ``cam_from_mesh = cam_from_model @ model_from_mesh``. All frames are right-handed, lengths are
millimetres, angles are degrees where the name ends in ``_deg`` and radians otherwise.
"""

import numpy as np

from .errors import InputError

ORTHONORMAL_TOLERANCE = 1e-2
"""Largest entry of |R Rt - 1| that counts as inaccurate: published ground truth reaches 9.6e-3 (LM-O). A matrix so far
off is 0.5 % too large in some direction, a pixel or two at the edge of an object; a scale by mistake is far more."""

BLOCK = 1 << 14
"""Number of points transformed at once: few enough for a processor's cache, and for the linear algebra library to
use one thread; its other threads cost more than they save on matrices of three columns."""

LONGEST_TRANSLATION = 1e12
"""In the unit of the file; squares of longer ones may overflow."""

ORTHONORMAL_TO_ROUNDING = 1e-14
"""Largest entry of |R Rt - 1| of a rotation rounded to float64; such a pose is kept to the last bit."""

NOTED_DEVIATION = 1e-6
"""Largest entry of |R Rt - 1| that is corrected without a message: numbers of seven digits."""

SAME_POSE = 1e-9
"""Difference of numbers, absolute and relative, up to which two poses are the same."""

CAM_FROM_OPENGL_CAM = np.diag([1.0, -1.0, -1.0, 1.0])
"""The one axis flip: Blender's cameras and NeRF files have OpenGL axes, y up and looking along -z. Its own inverse."""


def turned_about(pivot: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """``(4, 4)`` rigid transform that rotates by ``rotation`` (3, 3) and keeps ``pivot`` (3,) fixed."""
    return rigid(rotation, pivot - rotation @ pivot)


def inverse_rigid(b_from_a: np.ndarray) -> np.ndarray:
    """``(..., 4, 4)`` rigid ``b_from_a`` -> ``a_from_b``."""
    rotation = np.swapaxes(b_from_a[..., :3, :3], -1, -2)
    a_from_b = np.zeros_like(b_from_a)
    a_from_b[..., :3, :3] = rotation
    a_from_b[..., :3, 3] = -(rotation @ b_from_a[..., :3, 3, None])[..., 0]
    a_from_b[..., 3, 3] = 1.0
    return a_from_b


def rigid(rotation: np.ndarray | None = None, translation: np.ndarray | None = None) -> np.ndarray:
    """4x4 from a ``(3, 3)`` rotation and a ``(3,)`` translation in mm; either may be left out."""
    b_from_a = np.eye(4)
    if rotation is not None:
        b_from_a[:3, :3] = rotation
    if translation is not None:
        b_from_a[:3, 3] = translation
    return b_from_a


def is_same_pose(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two poses ``(4, 4)`` are equal but for the rounding of other units, another frame or a text."""
    return np.allclose(one, other, rtol=SAME_POSE, atol=SAME_POSE)


def transform_points(b_from_a: np.ndarray, points_a: np.ndarray) -> np.ndarray:
    """``(N, 3)`` points in frame a -> ``(N, 3)`` in frame b."""
    rotation, translation = b_from_a[:3, :3].T, b_from_a[:3, 3]
    if len(points_a) <= BLOCK:
        return points_a @ rotation + translation
    points_b = np.empty(points_a.shape, np.result_type(points_a, b_from_a))
    for start in range(0, len(points_a), BLOCK):
        part = slice(start, start + BLOCK)
        np.add(points_a[part] @ rotation, translation, out=points_b[part])
    return points_b


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation nearest to a ``(3, 3)`` matrix in the Frobenius norm (Arun 1987)."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


def checked_matrix(values: object, size: int, where: str) -> np.ndarray:
    """Copy the user's values into a ``(size, size)`` float64 matrix of finite numbers; ``where`` begins the message."""
    try:
        if not isinstance(values, np.ndarray) and any(
            isinstance(each, str | bool) for each in np.array(values, object).flat
        ):
            raise TypeError("texts or truth values")
        matrix = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        rows = [len(row) for row in values if isinstance(row, list)] if isinstance(values, list) else []
        found = f"rows of {', '.join(map(str, rows))}" if len(set(rows)) > 1 else "something else"
        raise InputError(
            f"{where}: expected {size} rows of {size} numbers, with decimal points, found {found}; correct it"
        ) from None
    if matrix.shape != (size, size):
        raise InputError(
            f"{where}: expected a {size}x{size} matrix, found shape {matrix.shape}; write {size} rows of {size} "
            "numbers, with decimal points"
        )
    if not np.isfinite(matrix).all():
        raise InputError(f"{where}: expected finite numbers, found NaN or infinity")
    return matrix


def checked_rigid(matrix: object, where: str) -> tuple[np.ndarray, str | None]:
    """Check a pose at the border and make its rotation exactly orthonormal.

    Parameters
    ----------
    matrix
        The user's values: they should be a ``(4, 4)`` rigid transform.
    where
        Names the place in messages, e.g. ``"case.toml: [pose] cam_from_mesh"``.

    Returns
    -------
    ``(4, 4)`` float64 rigid transform, and a message if the rotation had to be corrected, else ``None``.
    """
    b_from_a = checked_matrix(matrix, 4, where)
    if not np.allclose(b_from_a[3], [0, 0, 0, 1], atol=1e-9):
        raise InputError(
            f"{where}: expected the last row 0 0 0 1, found {b_from_a[3].tolist()}; "
            "the translation belongs in the last column (transpose the matrix if it is in the last row)"
        )
    rotation = b_from_a[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        determinant = np.linalg.det(rotation)
        deviation = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if determinant < 0:
        raise InputError(
            f"{where}: expected a rotation, found a reflection (determinant {determinant:.3g}); "
            "a mirrored axis convention, e.g. y up instead of y down, usually causes it"
        )
    # NaN, of numbers whose squares overflow, is not within it
    if not deviation <= ORTHONORMAL_TOLERANCE:
        raise InputError(
            f"{where}: expected a rotation, found a matrix that deviates from orthonormal by {deviation:.2g} "
            f"(allowed {ORTHONORMAL_TOLERANCE:g}); remove scale or shear from the pose"
        )
    if np.abs(b_from_a[:3, 3]).max() > LONGEST_TRANSLATION:
        raise InputError(
            f"{where}: expected a shorter translation, found {b_from_a[:3, 3].tolist()}, which is too long"
        )
    if deviation > ORTHONORMAL_TO_ROUNDING:
        b_from_a[:3, :3] = nearest_rotation(rotation)
    b_from_a[3] = [0, 0, 0, 1]
    if deviation <= NOTED_DEVIATION:
        return b_from_a, None
    return b_from_a, f"{where}: rotation off by {deviation:.1e}, corrected to the nearest rotation"


def cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """``(..., 3)`` vectors a -> ``(..., 3, 3)`` matrices of the cross product, [a]x b = a x b."""
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 2, 1] = vectors[..., 0]
    matrices[..., 0, 2] = vectors[..., 1]
    matrices[..., 1, 0] = vectors[..., 2]
    return matrices - np.swapaxes(matrices, -1, -2)


def rotation_from_vector(rotation_vector: np.ndarray) -> np.ndarray:
    """Rodrigues' formula: ``(..., 3)`` axis times angle in radians -> ``(..., 3, 3)`` rotations."""
    vector = np.ascontiguousarray(rotation_vector, dtype=np.float64)
    # as a matrix product: equal to the last bit for a single vector and for each of many
    angle = np.sqrt(vector[..., None, :] @ vector[..., :, None])
    cross = cross_matrices(vector)
    # sinc forms stay exact as the angle goes to zero; float_power rounds alike for scalars and arrays, ** does not
    square = np.float_power(np.sinc(angle / (2 * np.pi)), 2)
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * square * cross @ cross


def rotation_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """``(3, 3)`` rotation by the smallest angle that takes ``start`` to ``end``, directions that are not opposite."""
    axis = np.cross(start, end)
    sine, cosine = np.linalg.norm(axis), start @ end
    return rotation_from_vector(axis * (np.arctan2(sine, cosine) / sine)) if sine > 0 else np.eye(3)


def se3_exp(twist: np.ndarray) -> np.ndarray:
    """Exponential map of se(3): ``(6,)`` = (translation in mm, rotation vector in radians) -> ``(4, 4)``."""
    upsilon, omega = np.asarray(twist[:3], float), np.asarray(twist[3:], float)
    angle = float(np.linalg.norm(omega))
    cross = cross_matrices(omega)
    second = (1 - np.sinc(angle / np.pi)) / angle**2 if angle > 1e-4 else 1 / 6 - angle**2 / 120
    left_jacobian = np.eye(3) + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross + second * cross @ cross
    return rigid(rotation_from_vector(omega), left_jacobian @ upsilon)


def rotation_angle_deg(rotation: np.ndarray) -> float:
    """Angle of a ``(3, 3)`` rotation in degrees, accurate near 0 and near 180."""
    skew = rotation - rotation.T
    sine = 0.5 * np.linalg.norm([skew[2, 1], skew[0, 2], skew[1, 0]])
    return float(np.degrees(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1))))


def camera_centre(cam_from_model: np.ndarray) -> np.ndarray:
    """``(..., 3)`` centre of projection in model coordinates, mm."""
    rotation = cam_from_model[..., :3, :3]
    return -(np.swapaxes(rotation, -1, -2) @ cam_from_model[..., :3, 3, None])[..., 0]


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """``(3, 3)`` rotation -> ``(3,)`` axis times angle in radians, angle 0..pi; the inverse of Rodrigues' formula."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (float(np.trace(rotation)) - 1)
    angle = float(np.arctan2(sine, cosine))
    if cosine > -0.9:
        return skew * (angle / sine if sine > 1e-12 else 1.0)
    # near 180 degrees the skew part vanishes: take the axis from the symmetric part, its sign from the skew part
    outer = 0.5 * (rotation + rotation.T) - cosine * np.eye(3)
    column = outer[:, int(np.argmax(np.diag(outer)))]
    axis = column / np.linalg.norm(column)
    return axis * (angle if axis @ skew >= 0 else -angle)
