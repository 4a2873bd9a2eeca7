"""Which registered frames to colour a surface with: those that see most of what no frame before them saw.

Frames that are blurred, or in which something else covers the surface (an instrument, blood, glare), are not taken:
where they show the same points as the case's frame, they do not show the same.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from ..colour.seen_frame import SeenFrame
from ..images.pixel_values import sample_bilinear
from ..light.exposure import matched_exposures
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from .further_frames import FurtherFrame

STEP_PX, SEEN_STEP_PX = 4, 8
"""Between the pixels that are compared with the case's frame, and between the points that frames see or not."""
LEAST_ADDED = 0.002
"""Share of what all clear frames show that a frame must be the first to see."""
BLOCK_PX, LEAST_PIXELS = 16, 8
"""Side of the blocks that show the surface or not, and pixels that a block needs to tell."""
NOISE_PX, DETAIL_PX, AROUND_PX, COARSE_PX = 0.7, 2.0, 4.0, 3.0
"""Standard deviations: between the first two is detail, its strength is a mean over the third, and colours are compared
without what is finer than the fourth."""
LEAST_SHARPNESS = 0.8
"""Median strength of a frame's detail, relative to that of the case's frame at the same points: less is blurred."""
OTHER_COLOUR, SOME_COLOUR, ALIKE, FLAT = 0.06, 0.035, 0.5, 0.015
"""A block shows something else if its mean code values (0..1) differ by the first after one gain of all channels, as a
shadow is; by the second if the shading in it does not correlate by the third either, unless its standard deviation is
below the last in both frames."""
MOST_OTHER, LEAST_BLOCKS = 0.0075, 3
"""Share of the blocks, and number, that cover a frame if they lie side by side: light changes here and there."""
BLURRED, COVERED = "blurred", "covered"


def colouring_frames(
    mesh: TriangleMesh, own: SeenFrame, candidates: Sequence[tuple[FurtherFrame, np.ndarray]], count: int
) -> tuple[list[int], list[str]]:
    """The numbers of frames, the one first that adds most, and sentences on what each adds and why others do not.

    Parameters
    ----------
    mesh
        The surface, model frame.
    own
        The case's own frame, which comes first.
    candidates
        Registered frames by the same camera, and their poses ``cam_from_model`` ``(4, 4)``, mm.
    count
        How many at most.
    """
    views, flaws = dict[int, SeenFrame](), list[str]()
    points, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for frame, pose in candidates:
        raster = rasterise_depth(mesh, own.camera, pose)
        shown = (raster.face >= 0) & frame.valid
        inverse = np.where(shown, raster.inverse_depth, 0).astype(np.float32)
        image = frame.image.astype(np.float32) / 255
        view = replace(own, image=image, valid=frame.valid, cam_from_model=pose, inverse_depth=inverse)
        view = matched_exposures([own, view])[1]
        flaws.append(_flaw(own, view))
        if not flaws[-1]:
            views[frame.number] = view
            points.append(view.shown_points(SEEN_STEP_PX))
            faces = raster.face[::SEEN_STEP_PX, ::SEEN_STEP_PX]
            normals.append(mesh.face_normals[faces[shown[::SEEN_STEP_PX, ::SEEN_STEP_PX]]])
    places, facing = np.concatenate(points), np.concatenate(normals)
    unseen, left, chosen, lines = ~own.observed(places, facing), list(views), list[int](), list[str]()
    while len(chosen) < count and left:
        adds = {number: views[number].observed(places, facing) & unseen for number in left}
        best = max(left, key=lambda number: np.count_nonzero(adds[number]))
        if not adds[best].mean() > LEAST_ADDED:
            break
        unseen &= ~adds[best]
        left.remove(best)
        chosen.append(best)
        lines.append(f"frame {best} colours {adds[best].mean():.1%} more of what the clear frames show")
    lines.append(
        f"of {len(flaws)} accepted frames, {flaws.count(BLURRED)} are blurred and {flaws.count(COVERED)} covered in "
        f"part; of the other {len(views)}, {len(chosen) or 'none'} {'colours' if len(chosen) == 1 else 'colour'} what "
        "the case's frame did not see"
    )
    return chosen, lines


def _flaw(own: SeenFrame, view: SeenFrame) -> str:
    """:data:`BLURRED` or :data:`COVERED`, or empty: by the points that a frame, in the same exposure, shares."""
    points = own.shown_points(STEP_PX)
    points = points[view.unoccluded(points)]
    pixels = [each.project(points)[0] for each in (own, view)]
    details, colours = ([sample_bilinear(of(each.image), at) for each, at in zip((own, view), pixels, strict=True)]
                        for of in (_detail, _coarse))  # fmt: skip
    rows, columns = (-(-side // BLOCK_PX) for side in view.camera.shape_hw)
    across, down = np.maximum(pixels[1] // BLOCK_PX, 0).astype(int).T
    block = across + down * columns
    size = np.bincount(block, minlength=rows * columns)
    known = size >= LEAST_PIXELS
    if not known.any():
        return COVERED

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(block, values, len(size)) / np.maximum(size, 1)

    before, after = (mean(each[:, 0])[known] for each in details)
    if np.median(after / np.maximum(before, 1e-9)) < LEAST_SHARPNESS:
        return BLURRED
    own_mean, its_mean = (np.stack([mean(channel) for channel in each.T], axis=1) for each in colours)
    gain = (own_mean * its_mean).sum(axis=1) / np.maximum((own_mean**2).sum(axis=1), 1e-9)
    difference = np.abs(its_mean - gain[:, None] * own_mean).max(axis=1)
    one, other = (grey - mean(grey)[block] for grey in (each.mean(axis=1) for each in colours))
    variances = mean(one * one), mean(other * other)
    unlike = mean(one * other) < ALIKE * np.sqrt(variances[0] * variances[1])
    unlike &= np.maximum(*variances) > FLAT**2
    differs = known & ((difference > OTHER_COLOUR) | (difference > SOME_COLOUR) & unlike)
    _, _, stats, _ = cv2.connectedComponentsWithStats(differs.reshape(rows, columns).astype(np.uint8), connectivity=8)
    largest = int(stats[1:, cv2.CC_STAT_AREA].max(initial=0))
    return COVERED if largest >= LEAST_BLOCKS and largest > MOST_OTHER * known.sum() else ""


def _coarse(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), COARSE_PX)


def _detail(image: np.ndarray) -> np.ndarray:
    """``(H, W, 1)`` strength of the finest detail around each pixel that is no noise."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    fine = cv2.GaussianBlur(grey, (0, 0), NOISE_PX) - cv2.GaussianBlur(grey, (0, 0), DETAIL_PX)
    return np.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), AROUND_PX))[..., None]
