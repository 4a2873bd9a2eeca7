"""What all charts share: their colours, their style, and their file.

The same data give the same bytes with the same matplotlib. Matplotlib is optional, hence imported on use, and its
figures and axes are typed as ``Any``.
"""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from oneframe.errors import RunError
from oneframe.files.outputs import write_output

PAPER, TEXT, MUTED, GRID = "#ffffff", "#1f2328", "#59636e", "#d8dee4"
OURS, WARNING, PEER = "#0072b2", "#d55e00", "#007d5a"
"""Colours of series, which suit colour-blind readers too (after Okabe and Ito 2008)."""
DASHED = (0, (4, 3))
STYLE: dict[Any, Any] = {
    "savefig.dpi": 160,
    "font.size": 11,
    "figure.facecolor": PAPER,
    "axes.facecolor": PAPER,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": TEXT,
    "axes.titlecolor": TEXT,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "text.color": TEXT,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": TEXT,
    "ytick.labelcolor": TEXT,
}


def require_matplotlib() -> None:
    """Check before long measurements that charts can be drawn."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise RunError(
            "charts: expected matplotlib, it is not installed; run pip install matplotlib and try again"
        ) from None


def chart_path(data: Path) -> Path:
    """The file of the chart of a data file: ``NAME.png`` beside it."""
    return data.with_suffix(".png")


def write_chart(data: Path, draw: Callable[[Any], None], size_inches: tuple[float, float], *, title: str) -> Path:
    """Write a chart, and return its file, see :func:`chart_path`.

    Parameters
    ----------
    data
        The file with the chart's data: determines folder and name.
    draw
        Called with an empty matplotlib ``Figure``.
    title
        The chart's title, also in the file's metadata.
    """
    require_matplotlib()
    with _style():
        from matplotlib.figure import Figure
        from matplotlib.layout_engine import ConstrainedLayoutEngine

        figure = Figure(figsize=size_inches, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.1))
        figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold")
        draw(figure)
        content = io.BytesIO()
        figure.savefig(content, format="png", metadata={"Title": title, "Software": None})
    path = chart_path(data)
    write_output(path, content.getvalue())
    return path


@contextmanager
def _style() -> Iterator[None]:
    """Use matplotlib's defaults instead of the user's settings, with the style of all charts."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield


def note(figure: Any, text: str) -> None:
    """Write small print below the chart."""
    figure.supxlabel(text, x=0.012, ha="left", fontsize=9.5, color=MUTED)
