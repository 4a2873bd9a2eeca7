"""The charts of stability by topic."""

from collections.abc import Callable, Sequence
from pathlib import Path

from ...files.outputs import Output
from ..stability.cells import Cell
from .page import chart_outputs
from .stability_camera_chart import camera_stability_charts
from .stability_colouring_chart import colouring_stability_charts
from .stability_landmarks_chart import focal_chart, landmark_stability_charts
from .stability_refinement_chart import refinement_stability_charts
from .stability_renderers_chart import renderer_stability_charts
from .stability_sampling_chart import sampling_stability_charts

CHARTS: dict[str, Callable[[Sequence[Cell], Sequence[str], Path], list[Path]]] = {
    "pnp": landmark_stability_charts,
    "refinement": refinement_stability_charts,
    "colouring": colouring_stability_charts,
    "camera": camera_stability_charts,
    "renderers": renderer_stability_charts,
    "sampling": sampling_stability_charts,
}
"""By topic: draws the charts of cells, with their conditions, next to their table; gives the files written."""


def draw_topic(topic: str, cells: Sequence[Cell], conditions: Sequence[str], data: Path) -> list[Path]:
    """Draw the charts of a topic next to its table."""
    return CHARTS[topic](cells, conditions, data)


def topic_outputs(topic: str, data: Path) -> list[Output]:
    """The files of :func:`draw_topic`."""
    return [*chart_outputs(data), *(chart_outputs(focal_chart(data)) if topic == "pnp" else ())]
