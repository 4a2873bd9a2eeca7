"""Which registered frames to colour a surface with, judged by the frames that are left out.

The case's own frame colours what it saw; a further one only what those before it did not see. So it is worth taking if
it is nearer there to what the other frames show than the mean colour of the surface is. Frames that are blurred, or in
which something else covers the surface (an instrument, blood, glare), are neither taken nor asked: where they show the
same points as the case's frame, they do not show the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..colour.source_view import SourceView
from ..images.pixel_values import sample_bilinear
from ..light.exposure import matched_exposures
from ..projection.z_buffer import rasterise_depth
from ..surface.mesh import TriangleMesh
from .further_frames import FurtherFrame, evenly

MOST_JUDGES = 20
"""Frames left out that are asked: of more, evenly chosen ones."""
STEP_PX, JUDGED_STEP_PX = 4, 8
"""Between the pixels that are compared with the case's frame, and with the frames left out."""
BLOCK_PX, LEAST_PIXELS = 16, 8
"""Side of the blocks that show the surface or not, and pixels that a block needs to tell."""
DETAIL_PX, AROUND_PX, COARSE_PX = 1.5, 4.0, 3.0
"""Standard deviations: finer than the first is detail, its strength is a mean over the second, and colours are compared
without what is finer than the third."""
LEAST_SHARPNESS = 0.75
"""Median strength of a frame's detail, relative to that of the case's frame at the same points: less is blurred."""
OTHER_COLOUR, SOME_COLOUR, ALIKE, FLAT = 0.25, 0.08, 0.5, 0.015
"""A block shows something else if its code values (0..1) differ by the first; by the second if the shading in it does
not correlate by the third either, unless its standard deviation is below the last in both frames."""
MOST_OTHER, LEAST_BLOCKS = 0.0075, 3
"""Share of the blocks, and number, that cover a frame if they lie side by side: light changes here and there."""
LEAST_GAIN = 0.05
"""Code values, of 255, by which a frame must lower the mean error of the frames left out."""
BLURRED, COVERED = "blurred", "covered"


@dataclass(frozen=True)
class ColourChoice:
    """What was chosen.

    Attributes
    ----------
    numbers
        Of the frames, in the order in which they colour: the one first that helps most.
    lines
        What each of them brought, and why others were not taken, in sentences.
    """

    numbers: tuple[int, ...]
    lines: tuple[str, ...]


def chosen_sources(
    mesh: TriangleMesh, source: SourceView, candidates: Sequence[tuple[FurtherFrame, np.ndarray]], count: int
) -> ColourChoice:
    """Choose frames one by one, each time the one that lowers the error over the frames left out most.

    Parameters
    ----------
    mesh
        The surface, model frame.
    source
        The case's own frame, which comes first.
    candidates
        Registered frames by the same camera, and their poses ``cam_from_model`` ``(4, 4)``, mm.
    count
        How many at most.
    """
    views, shown_faces, flaws = dict[int, SourceView](), dict[int, np.ndarray](), list[str]()
    for frame, pose in candidates:
        shown, faces = _view(mesh, source, frame, pose)
        view = matched_exposures([source, shown])[1]
        flaws.append(_flaw(source, view))
        if not flaws[-1]:
            views[frame.number], shown_faces[frame.number] = view, faces
    judges = {
        number: _Judge.of(mesh.face_normals, source, views[number], shown_faces[number])
        for number in evenly(list(views), MOST_JUDGES)
    }
    left, chosen, lines = list(views), list[int](), list[str]()
    while len(chosen) < count and left:
        tried = {
            number: _helped([judge for other, judge in judges.items() if other != number], views[number])
            for number in left
        }
        best = max(left, key=lambda number: tried[number][1] - tried[number][2])
        added, before, after = tried[best]
        if not before - after > LEAST_GAIN:
            break
        left.remove(best)
        judges.pop(best, None)
        chosen.append(best)
        lines.append(
            f"frame {best} colours {100 * added:.1f} % more of what {len(judges)} frames left out show: their mean "
            f"difference from the surface's colours is {after:.2f} instead of {before:.2f} of 255"
        )
        judges = {number: judge.coloured_by(views[best]) for number, judge in judges.items()}
    lines.append(
        f"of {len(flaws)} accepted frames, {flaws.count(BLURRED)} are blurred and {flaws.count(COVERED)} covered in "
        f"part; of the other {len(views)}, {len(chosen) or 'none'} {'brings' if len(chosen) == 1 else 'bring'} the "
        f"surface's colours nearer to what those left out show"
    )
    return ColourChoice(tuple(chosen), tuple(lines))


def _view(
    mesh: TriangleMesh, source: SourceView, frame: FurtherFrame, pose: np.ndarray
) -> tuple[SourceView, np.ndarray]:
    """A frame as a view of the surface, and the faces that it shows at the pixels of a judge, -1 for none."""
    raster = rasterise_depth(mesh, source.camera, pose)
    shown = (raster.face >= 0) & frame.valid
    inverse, image = np.where(shown, raster.inverse_depth, 0).astype(np.float32), frame.image.astype(np.float32) / 255
    view = replace(source, image=image, valid=frame.valid, cam_from_model=pose, inverse_depth=inverse)
    return view, raster.face[::JUDGED_STEP_PX, ::JUDGED_STEP_PX].copy()


def _flaw(source: SourceView, view: SourceView) -> str:
    """:data:`BLURRED` or :data:`COVERED`, or empty: by the points that a frame, in the same exposure, shares."""
    points = source.shown_points(STEP_PX)
    points = points[view.unoccluded(points)]
    pixels = [each.project(points)[0] for each in (source, view)]
    details, colours = ([sample_bilinear(of(each.image), at) for each, at in zip((source, view), pixels, strict=True)]
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
    difference = mean(np.abs(colours[1] - colours[0]).max(axis=1))
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
    """``(H, W, 1)`` strength of the finest detail around each pixel."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    fine = grey - cv2.GaussianBlur(grey, (0, 0), DETAIL_PX)
    return np.sqrt(cv2.GaussianBlur(fine * fine, (0, 0), AROUND_PX))[..., None]


@dataclass(frozen=True)
class _Judge:
    """A frame left out: what it shows of the surface, and the errors of the surface's colours there.

    Attributes
    ----------
    points, normals, codes
        ``(N, 3)`` each: points, unit normals of their faces, and the frame's code values there.
    errors
        ``(N,)`` difference of these from the surface's colours, or from the one that stands for what is not seen.
    open
        ``(N,)`` bool: no frame colours the point yet.
    """

    points: np.ndarray
    normals: np.ndarray
    codes: np.ndarray
    errors: np.ndarray
    open: np.ndarray

    @classmethod
    def of(cls, face_normals: np.ndarray, source: SourceView, view: SourceView, faces: np.ndarray) -> "_Judge":
        """A frame of the surface that one frame colours; elsewhere it has the mean of its colours."""
        shown = view.depth_mm[::JUDGED_STEP_PX, ::JUDGED_STEP_PX] > 0
        codes = view.image[::JUDGED_STEP_PX, ::JUDGED_STEP_PX][shown]
        mean = source.image[source.inverse_depth > 0].mean(axis=0)
        points, normals = view.shown_points(JUDGED_STEP_PX), face_normals[faces[shown]]
        return cls(points, normals, codes, _error(codes, mean), np.ones(len(codes), bool)).coloured_by(source)

    def coloured_by(self, view: SourceView) -> "_Judge":
        """The same once a view colours what no frame before it does."""
        seen, errors = self.open.copy(), self.errors.copy()
        seen[seen] = view.observed(self.points[seen], self.normals[seen])
        errors[seen] = _error(self.codes[seen], view.colours(view.project(self.points[seen])[0]))
        return replace(self, errors=errors, open=self.open & ~seen)


def _error(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return 255 * np.abs(one - other).mean(axis=1)


def _helped(judges: Sequence[_Judge], view: SourceView) -> tuple[float, float, float]:
    """Share of what judges show that a view adds, and their mean error without and with it."""
    coloured = [judge.coloured_by(view) for judge in judges]
    size = max(sum(len(judge.errors) for judge in judges), 1)
    still_open = [sum(int(judge.open.sum()) for judge in each) for each in (judges, coloured)]
    before, after = (sum(float(judge.errors.sum()) for judge in each) / size for each in (judges, coloured))
    return (still_open[0] - still_open[1]) / size, before, after
