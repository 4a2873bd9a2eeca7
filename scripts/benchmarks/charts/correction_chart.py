"""The chart of corrected surfaces: errors, what is confirmed, views and poses, by what was wrong."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from oneframe.charts.page import MUTED, OURS, WARNING

from ..figures import conditions_note
from ..sweeps.surface_correction import CorrectionTrial
from .panels import PARTS, Axis, Layer, Panel, categories, distinct, draw_chart, line, rule

Drawn = Mapping[str, tuple[str, str]]
"""Field of a trial -> its name and colour."""
CHANGED = {"before": ("before", MUTED), "changed": ("after", OURS), "changed_95": ("after, 95 %", WARNING)}
ELSEWHERE = {"elsewhere": ("after", OURS), "elsewhere_95": ("after, 95 %", WARNING)}
SHARES = {
    "within": ("changed: within two deviations", OURS),
    "confirmed_changed": ("changed: confirmed", MUTED),
    "passed": ("over 0.3 mm off: confirmed", WARNING),
}
VIEWS = {"ssim_before": ("wrong", WARNING), "ssim": ("corrected", OURS), "ssim_true": ("true", MUTED)}
POSES = {"px_before": ("on the wrong surface", MUTED), "px": ("on the corrected one", OURS)}
SMALL = (
    "A point a seed, lines: means. Errors are distances from the true surface, of what is confirmed; changed is what "
    "was displaced by more than 0.2 mm. Dotted: goals."
)


def correction_chart(rows: Sequence[CorrectionTrial], conditions: Sequence[str], data: Path) -> Path:
    """Draw the trials beside their table."""
    error = Axis("error (mm)", log=True, ends=(0.005, 3.0))
    panels = [
        _panel(rows, "Where changed", error, CHANGED, (0.06, 0.2)),
        _panel(rows, "Elsewhere", error, ELSEWHERE, (0.02, 0.06)),
        _panel(rows, "Shares", Axis(ends=(-0.04, 1.6), ticks=PARTS.ticks), SHARES, (0.05, 0.9)),
        _panel(rows, "Views beside frames left out, where changed", Axis("SSIM"), VIEWS),
        _panel(rows, "Registered poses", Axis("displacement of the surface (px)", log=True), POSES),
    ]
    small = SMALL, conditions_note(conditions)
    return draw_chart(data, "Surfaces corrected by frames", [panels[:3], panels[3:]], small, size=(5.0, 3.3))


def _panel(rows: Sequence[CorrectionTrial], title: str, y: Axis, drawn: Drawn, goals: Sequence[float] = ()) -> Panel:
    kinds = distinct([(row.scene, row.surface) for row in rows])
    layers: list[Layer] = [rule(goal) for goal in goals]
    for field, (name, colour) in drawn.items():
        found = [[getattr(row, field) for row in rows if (row.scene, row.surface) == kind] for kind in kinds]
        known = [(x, np.array(some)[np.isfinite(some)]) for x, some in enumerate(found)]
        known = [(x, some) for x, some in known if len(some)]
        points = [(x, value) for x, some in known for value in some]
        if points:
            at, values = np.array(points).T
            layers.append(line(at, values, colour, marker="o", markersize=4, linestyle="none", alpha=0.6))
            layers.append(line([x for x, _ in known], [some.mean() for _, some in known], colour, name))
    named = [surface.replace(", ", ",\n") if scene == "sample" else scene for scene, surface in kinds]
    return Panel(title, categories("", named), y, layers, "best" if len(layers) > len(goals) else None)
