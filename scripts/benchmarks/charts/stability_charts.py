"""The charts of all sweeps."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from oneframe.case.surface_doubts import EXACT_PX

from ..figures import conditions_note
from ..sweeps import colouring, landmarks, refinement
from ..sweeps.cells import Cell
from .cell_panels import (
    answer_key,
    box_panel,
    in_sweep,
    outcome_key,
    outcome_panel,
    percent_right,
    right_of_all,
    with_lines,
)
from .page import PEER, WARNING
from .panels import PARTS, Axis, Panel, distinct, draw_chart, handle, line

Conditions = Sequence[str]
CAMERA = (
    ("principal point", "Principal point", "distance from the middle (image sizes)", False),
    ("focal length", "Focal length", "focal length (px)", True),
    ("fx / fy", "Pixel aspect", "fx / fy", True),
    ("image height", "Image height", "height of an image 2000 px wide (px)", True),
    ("origin", "Origin of the CT", "distance from the mesh file's origin (mm)", True),
    ("clip range", "Clip range", "radius of the surface / its distance", True),
)
"""Sweep, title, label of its x axis, and whether that is logarithmic."""
COLOURING = (
    ("pose error", "Pose error", "error of the pose (px)", True),
    ("incidence", "Grazing angles", "angle between ray and normal (°)", False),
    ("magnification", "Frame resolution", "enlargement of the frame", True),
    ("mesh density", "Mesh density", "distance of the vertices (px)", True),
    ("scale", "Acne against scale", "working distance (mm)", True),
    ("focal length", "Acne against focal length", "focal length (px)", True),
    ("thin walls", "Thin walls", "distance of the sides (pixel footprints)", True),
)
LEGENDS = {
    "pose error": "lower right",
    "incidence": "upper left",
    "magnification": "upper left",
    "mesh density": "upper left",
}
"""Sweeps whose errors are colours, and where there are no points; of the others errors are parts."""
LANDMARKS = {
    "number": "number of correspondences",
    "noise": "true click noise (px); stated: 2 px",
    "outliers": "part of the 20 pairs that is 80 px off",
    "spread": "extent of the points / the surface's",
    "coplanarity": "thickness of the points / the surface's",
    "collinearity": "width of points on a plane / the surface's",
    "sign flips": "tilt of nearly flat points (°)",
}
SOLVERS = {"EPnP": (WARNING, "^"), "SQPnP + LM": (PEER, "s")}
PERSPECTIVE = "points 600 px wide at every focal length; wrong: more than 10° or 60 px off"
FRAMES = (
    ("texture-poor", "", "Texture-poor", "contrast / the original's"),
    ("occluded", "", "Occluded", "part under instruments"),
    ("occluded", refinement.MASKED, "Occluded, masked", "part masked out"),
    ("specular", "", "Specular", "part under glare"),
    ("noisy", "", "Noisy", "standard deviation (of 1)"),
    ("blurred", "", "Blurred", "blur (px)"),
)


def camera_charts(cells: Sequence[Cell], conditions: Conditions, data: Path) -> list[Path]:
    """How far edges are from where K says."""
    y = Axis("largest error of edges (px)", log=True, ends=(5e-5, 300.0))
    panels = list[Panel]()
    for sweep, title, label, log in CAMERA:
        panel = Panel(title, Axis(label, log=log), y, legend=None if panels else "center left")
        panels.append(with_lines(panel, in_sweep(cells, sweep), quantity="error_95", wrong=EXACT_PX))
    small = (
        "One slanted triangle, 640x480 px where not swept, three turns each. Edges nowhere wrong are drawn at the "
        "lower edge. Every case goes through files, as a user's does: so do the answers.",
        conditions_note(conditions),
    )
    title = "Camera: how far rendered edges are from where K says"
    return [draw_chart(data, title, [panels[:4], panels[4:]], small, size=(3.15, 3.3), key=answer_key())]


def colouring_charts(cells: Sequence[Cell], conditions: Conditions, data: Path) -> list[Path]:
    """Colour errors, surface left grey, and hidden surface painted."""
    codes = Axis("mean colour error (of 255)", log=True, ends=(0.003, 200.0))
    panels = list[Panel]()
    for sweep, title, label, log in COLOURING:
        own = in_sweep(cells, sweep)
        if sweep in LEGENDS:
            panel = Panel(title, Axis(label, log=log), codes, legend=LEGENDS[sweep])
            panels.append(with_lines(panel, own, wrong=colouring.WRONG_CODES, label_at=0.05))
        else:
            leaks = sweep == "thin walls"
            parts = replace(PARTS, label="hidden, but painted" if leaks else "seen, but left grey")
            panel = Panel(title, Axis(label, log=log), parts, legend="center left" if leaks else None)
            panels.append(with_lines(panel, own, wrong=colouring.WRONG_PART, label_at=0.2))
    small = (
        "Views by Cycles, 480x360 px, of surfaces whose colour is known at every point: waves of 18 px. A layer nearer "
        "to the one above than TOLERANCE_PX is painted from less than a pixel beside, which does not count as wrong.",
        conditions_note(conditions),
    )
    rows = [panels[:4], panels[4:]]
    return [draw_chart(data, "Colour: where it fails", rows, small, size=(3.15, 3.3), key=answer_key())]


def landmark_charts(cells: Sequence[Cell], conditions: Conditions, data: Path) -> list[Path]:
    """Outcomes of sweeps over all focal lengths, beside the peers' failures; and ours by focal length."""
    ours = {name: in_sweep(cells, name, landmarks.OURS) for name in LANDMARKS}
    bars = [
        outcome_panel(own, name.capitalize(), LANDMARKS[name], below=name == "number", more=_failures(cells, name))
        for name, own in ours.items()
    ]
    level = landmarks.LEVEL
    region = Axis(ends=(0, 1.05), ticks={0: "0", 0.5: "50 %", level: f"{level:.0%}"})
    held = [cell for cell in in_sweep(cells, "calibration") if cell.y == level]
    empty = Panel("Truth in the 95 % region", Axis("true / stated click noise", log=True), region, legend="lower left")
    bars.append(with_lines(empty, held, quantity="value", wrong=level))
    boxes = [
        box_panel(own, name.capitalize(), (LANDMARKS[name], "focal length (px)"), percent_right, below=name == "number")
        for name, own in ours.items()
    ]
    key = [handle(f"{name}: wrong or none", colour, marker=marker) for name, (colour, marker) in SOLVERS.items()]
    said = conditions_note(conditions)
    size, focal = (3.15, 3.3), data.with_name(f"{data.stem}_focal{data.suffix}")
    return [
        draw_chart(
            data, "Pose from landmarks: where it fails", [bars[:4], bars[4:]],
            (f"Bars: OneFrame, over focal lengths of 600 to 12 800 px; {PERSPECTIVE}.", said),
            size=size, key=outcome_key() + key,
        ),
        draw_chart(
            focal, "Pose from landmarks, by focal length: part of the trials that is right", [boxes[:4], boxes[4:]],
            (f"OneFrame; {PERSPECTIVE}. Number: % of the trials that is right, with or without a warning.", said),
            size=size, key=outcome_key(),
        ),
    ]  # fmt: skip


def _failures(cells: Sequence[Cell], sweep: str) -> list:
    """The part of the trials in which a peer is wrong or finds nothing, over all focal lengths."""
    layers = []
    for name, (colour, marker) in SOLVERS.items():
        own = in_sweep(cells, sweep, name)
        by_value = [[cell for cell in own if cell.x == value] for value in distinct([cell.x for cell in own])]
        parts = [sum(c.wrong + c.refuses for c in some) / sum(c.trials for c in some) for some in by_value]
        layers.append(line(range(len(parts)), parts, colour, marker=marker, linewidth=1.2, markeredgecolor="white"))
    return layers


def refinement_charts(cells: Sequence[Cell], conditions: Conditions, data: Path) -> list[Path]:
    """The basin, and bad frames."""
    basin, source = in_sweep(cells, "basin", refinement.RENDERED), refinement.RENDERED
    axes = "start: rotation (°)", "sample, rendered:\n3 trials of one frame\n\nshift (% of distance)"
    row = [box_panel(basin, "Basin: right of all starts", axes, right_of_all)]
    row += [outcome_panel(in_sweep(cells, sweep, source + end), title, label) for sweep, end, title, label in FRAMES]
    small = (
        "Bad frames start 3° and 1.3 % of the distance (60 px) off. Wrong: accepted, beyond 2 px or 1°, further off "
        "than twice the stated error.",
        conditions_note(conditions),
    )
    widths = [1.5, *[1] * len(FRAMES)]
    return [
        draw_chart(data, "Refinement: where it fails", [row], small, size=(2.4, 2.5), key=outcome_key(), widths=widths)
    ]


CHARTS: dict[str, Callable[[Sequence[Cell], Conditions, Path], list[Path]]] = {
    "pnp": landmark_charts,
    "refinement": refinement_charts,
    "colouring": colouring_charts,
    "camera": camera_charts,
}
"""By topic: draws charts of cells, with their conditions, next to their table; gives the files written."""
