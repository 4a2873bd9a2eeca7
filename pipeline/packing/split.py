"""Views divided into train, val and test by the distances of their poses, so that no near-duplicate leaks.

The distance of two poses is how far points of the surface move in the image between them, as a root mean square in
pixels. For this a pose is a point of Euclidean space: the pixels of all points, one after another, divided by the
square root of their number. That space is cut at medians into cells of equally many views. A few cells, spread over all
of it, become val and test. Views of the rest that are nearer than a gap to one of them belong to no part.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..camera.pinhole import PinholeCamera
from ..dataset.layout import VIEWS_PER_SCENE, scene_count, scene_folder
from ..errors import InputError
from ..transforms import rigid
from .whole_dataset import WholeDataset

PARTS = ("train", "val", "test")
VAL, TEST = 0.1, 0.1
"""Of all views."""
GAP = 0.01
"""The gap if none is given, relative to the longer side of the image."""
CELLS = 16
"""Cells of the space of poses. More represent all views better, and lose more views at their borders."""
LEAST_IN_CELL = 8
"""Views; there are fewer cells if these are not enough."""
LEAST_DEPTH_MM = 1.0
"""Points nearer than this, or behind the camera, are projected as if they were here."""
STEP_PX = 1 / 1024
"""Pixels are rounded to this, so that the last bit of another machine's arithmetic moves no view."""


@dataclass(frozen=True)
class Split:
    """The views of each part, by their numbers in increasing order.

    Attributes
    ----------
    train, val, test
        No view of one is nearer than the gap to a view of another.
    none
        Views that are left out.
    gap_px
        The gap.
    """

    train: tuple[int, ...]
    val: tuple[int, ...]
    test: tuple[int, ...]
    none: tuple[int, ...]
    gap_px: float

    def part(self, name: str) -> tuple[int, ...]:
        """The views of ``"train"``, ``"val"`` or ``"test"``."""
        return tuple(getattr(self, name))

    def text(self) -> str:
        """Sizes and distances in one sentence."""
        return (
            f"{len(self.train)} train, {len(self.val)} val, {len(self.test)} test; {len(self.none)} in none, nearer "
            f"than {self.gap_px:.3g} px to another part"
        )


def split_of_dataset(dataset: WholeDataset, *, gap_px: float | None = None) -> Split:
    """Divide a dataset's views into train, val and test.

    ``gap_px`` is as for :func:`split_of_views`.
    """
    count = dataset.description.count
    poses = np.empty((count, 4, 4))
    for scene in range(scene_count(count)):
        for image, truths in dataset.table(f"{scene_folder(scene)}/scene_gt.json").items():
            (truth,) = truths
            poses[scene * VIEWS_PER_SCENE + int(image)] = rigid(
                np.reshape(truth["cam_R_m2c"], (3, 3)), np.array(truth["cam_t_m2c"], float)
            )
    (model,) = dataset.table("models/models_info.json").values()
    low = np.array([model[f"min_{axis}"] for axis in "xyz"])
    size = np.array([model[f"size_{axis}"] for axis in "xyz"])
    corners = low + size * np.stack(np.meshgrid(*[(0, 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return split_of_views(poses, corners, dataset.description.camera, gap_px=gap_px)


def split_of_views(
    poses: np.ndarray, points_model: np.ndarray, camera: PinholeCamera, *, gap_px: float | None = None
) -> Split:
    """Divide views into parts that are a gap apart.

    Test has its fraction of all views, to the nearest whole number. Val has its fraction without those too near to
    test; train has what remains at least a gap away.

    Parameters
    ----------
    poses
        ``(N, 4, 4)`` rigid ``cam_from_model``, mm.
    points_model
        ``(M, 3)`` points that span the surface, such as the corners of its box, mm.
    camera
        Intrinsics of the views.
    gap_px
        Least distance of views in different parts; :data:`GAP` of the longer side of the image if left out.
    """
    gap = GAP * max(camera.size_wh) if gap_px is None else float(gap_px)
    if not 0 <= gap < np.inf:
        raise InputError(f"split: expected a gap of at least 0 px, found {gap:g}")
    places = embedded(poses, points_model, camera)
    test, val = (round(len(poses) * fraction) for fraction in (TEST, VAL))
    if min(test, val) < 1:
        raise InputError(f"split: {len(poses)} views are too few; render more views")
    part = _parts(places, test=test, val=val)
    for one, others in (("val", ("test",)), ("train", ("val", "test"))):
        kept = np.flatnonzero(part == one)
        near = _nearest(places[kept], places[np.isin(part, others)], gap) < gap
        part[kept[near]] = "none"
    empty = [name for name in PARTS if not (part == name).any()]
    if empty:
        raise InputError(
            f"split: a gap of {gap:.3g} px leaves no view in {' and '.join(empty)}; choose a smaller gap, or render "
            "views that differ more"
        )
    train, val_views, test_views, none = (tuple(np.flatnonzero(part == name).tolist()) for name in (*PARTS, "none"))
    return Split(train, val_views, test_views, none, gap)


def embedded(poses: np.ndarray, points_model: np.ndarray, camera: PinholeCamera) -> np.ndarray:
    """``(N, 2 M)`` places of ``(N, 4, 4)`` poses, px; their distance is the RMS displacement of ``(M, 3)`` points."""
    points_cam = np.einsum("nij,mj->nmi", poses[:, :3, :3], points_model) + poses[:, None, :3, 3]
    np.maximum(points_cam[..., 2], LEAST_DEPTH_MM, out=points_cam[..., 2])
    places = camera.project(points_cam).reshape(len(poses), -1)
    return np.rint(places / STEP_PX) * STEP_PX / np.sqrt(len(points_model))


def _parts(places: np.ndarray, *, test: int, val: int) -> np.ndarray:
    """``(N,)`` names of the parts before any view is left out."""
    cells = CELLS
    while cells > 2 and len(places) < cells * LEAST_IN_CELL:
        cells //= 2
    leaves = _leaves(places, np.arange(len(places)), cells)
    part = np.full(len(places), "train")
    # neighbours in this order are neighbours in space: steps as even as the fractions allow are spread over all of it
    free = list(range(len(leaves)))
    for name, wanted in (("test", test), ("val", val)):
        taken = 0
        size = min(-(-wanted // (len(places) // len(leaves))), len(free))
        chosen = [free[(2 * step + 1) * len(free) // (2 * size)] for step in range(size)]
        free = [leaf for leaf in free if leaf not in chosen]
        for step, leaf in enumerate(chosen):
            # the same number from each cell, cut off across its longest side
            share = (wanted - taken) // (size - step)
            members = _cut(places, leaves[leaf])[:share]
            part[members] = name
            taken += len(members)
    return part


def _leaves(places: np.ndarray, members: np.ndarray, cells: int) -> list[np.ndarray]:
    """Members in cells of equally many, cut at the medians of their longest sides."""
    if cells < 2:
        return [members]
    ordered = _cut(places, members)
    half = len(ordered) // 2
    return [
        *_leaves(places, ordered[:half], cells // 2),
        *_leaves(places, ordered[half:], cells // 2),
    ]


def _cut(places: np.ndarray, members: np.ndarray) -> np.ndarray:
    """Members along the longest side of their box; among equals, by number."""
    inside = places[members]
    side = int(np.argmax(inside.max(axis=0) - inside.min(axis=0)))
    return members[np.argsort(inside[:, side], kind="stable")]


def _nearest(places: np.ndarray, others: np.ndarray, limit: float) -> np.ndarray:
    """``(N,)`` distances to the nearest of others; infinite where it is not below the limit."""
    if not len(places) or not len(others):
        return np.full(len(places), np.inf)
    distances, _ = cKDTree(others).query(places, distance_upper_bound=limit)
    return np.asarray(distances)
