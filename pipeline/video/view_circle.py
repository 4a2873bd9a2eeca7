"""The bright circle that microscopes and endoscopes show on black, and what else of the picture is always black.

Needs ``cv2``.
"""

from dataclasses import dataclass

import cv2
import numpy as np

DARK = 0.12
"""Brightness of the black around a view, relative to the median inside it."""

_LEAST_OUTSIDE = 0.01
_LARGEST_RESIDUAL_PX = 1.0
_LEAST_INLIERS = 0.6


@dataclass(frozen=True)
class Circle:
    """Centre and radius in px; pixel (0, 0) is the centre of the top-left one."""

    u: float
    v: float
    radius: float

    def scaled(self, factor_across: float, factor_down: float) -> "Circle":
        """The circle in a picture that is larger by these factors (nearly equal)."""
        return Circle(
            (self.u + 0.5) * factor_across - 0.5,
            (self.v + 0.5) * factor_down - 0.5,
            self.radius * (factor_across + factor_down) / 2,
        )

    def mask(self, size_wh: tuple[int, int], shrunk_px: float = 0.0) -> np.ndarray:
        """``(H, W)`` bool: pixels inside."""
        width, height = size_wh
        across, down = np.arange(width) - self.u, np.arange(height) - self.v
        return across[None] ** 2 + down[:, None] ** 2 < max(self.radius - shrunk_px, 0.0) ** 2


def lit_part(brightness: np.ndarray) -> np.ndarray | None:
    """``(h, w)`` bool: where the optics let light through; ``None`` if there is no black border.

    Parameters
    ----------
    brightness
        ``(h, w)`` mean over the film.
    """
    dark = brightness < DARK * _level(brightness)
    count, labels = cv2.connectedComponents(dark.astype(np.uint8), connectivity=4)
    border = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    outside = np.isin(labels, border[border > 0]) & dark
    if count < 2 or outside.mean() < _LEAST_OUTSIDE:
        return None
    # numbers and letters in the black
    inside = cv2.morphologyEx((~outside).astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=4)
    if count < 2:
        return None
    part = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return part if part.mean() > 0.1 else None


def view_circle(brightness: np.ndarray) -> Circle | None:
    """The circle of the view in the mean brightness of a film, ``(h, w)``; ``None`` if there is none.

    Points of half the inner brightness are found along rows and columns, and a circle is fitted to those that agree.
    """
    part = lit_part(brightness)
    if part is None:
        return None
    points = _edge_points(brightness.astype(np.float64), part)
    if len(points) < 40:
        return None
    circle, residual = _fitted(points), np.empty(0)
    for _ in range(12):
        residual = np.abs(np.hypot(points[:, 0] - circle.u, points[:, 1] - circle.v) - circle.radius)
        good = residual < max(3 * _LARGEST_RESIDUAL_PX, 1.5 * float(np.median(residual)))
        if good.sum() < 20:
            return None
        circle = _fitted(points[good])
    residual = np.abs(np.hypot(points[:, 0] - circle.u, points[:, 1] - circle.v) - circle.radius)
    inliers = residual < 2 * _LARGEST_RESIDUAL_PX
    if inliers.mean() < _LEAST_INLIERS:
        return None
    if float(np.median(residual[inliers])) > _LARGEST_RESIDUAL_PX or not _fills(circle, part):
        return None
    return _fitted(points[inliers])


def _level(brightness: np.ndarray) -> float:
    """Typical brightness of what is lit."""
    lit = brightness[brightness > 0.25 * float(np.percentile(brightness, 95))]
    return float(np.median(lit)) if lit.size else 1.0


def _fills(circle: Circle, part: np.ndarray) -> bool:
    height, width = part.shape
    inside = circle.mask((width, height))
    return bool((inside ^ part).mean() < 0.05)


def _edge_points(brightness: np.ndarray, part: np.ndarray) -> np.ndarray:
    """``(N, 2)`` points (u, v) at the border of a part, between pixels, where the brightness crosses half of it."""
    return np.concatenate([_crossings(brightness, part), _crossings(brightness.T, part.T)[:, ::-1]])


def _crossings(brightness: np.ndarray, part: np.ndarray) -> np.ndarray:
    """The first and the last point of each row; those at the picture's own border are none."""
    found = []
    width = brightness.shape[1]
    for row in np.flatnonzero(part.any(axis=1)):
        line, columns = brightness[row], np.flatnonzero(part[row])
        for start, step in ((columns[0], 1), (columns[-1], -1)):
            if not 2 <= start <= width - 3:
                continue
            inner = start + step * np.arange(4, 10)
            level = float(np.median(line[inner[(inner >= 0) & (inner < width)]])) / 2
            at = start - 3 * step
            while 0 <= at < width and 0 <= at + step < width and abs(at - start) < 8:
                one, other = line[at], line[at + step]
                if one < level <= other:
                    found.append((at + step * (level - one) / (other - one), float(row)))
                    break
                at += step
    return np.array(found).reshape(-1, 2)


def _fitted(points: np.ndarray) -> Circle:
    """The circle of least squares through points (Kåsa 1976), refined once for the geometric distance."""
    centre = points.mean(axis=0)
    x, y = (points - centre).T
    solution, *_ = np.linalg.lstsq(np.column_stack([x, y, np.ones(len(x))]), x**2 + y**2, rcond=None)
    u, v = solution[0] / 2, solution[1] / 2
    radius = float(np.sqrt(max(solution[2] + u**2 + v**2, 0.0)))
    for _ in range(3):
        dx, dy = x - u, y - v
        distance = np.maximum(np.hypot(dx, dy), 1e-9)
        step, *_ = np.linalg.lstsq(
            np.column_stack([dx / distance, dy / distance, np.ones(len(x))]), distance - radius, rcond=None
        )
        u, v, radius = u + step[0], v + step[1], radius + float(step[2])
    return Circle(float(u + centre[0]), float(v + centre[1]), radius)
