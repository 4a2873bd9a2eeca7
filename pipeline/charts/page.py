"""What all charts share: their colours on light and on dark pages, and their files.

The same data give the same bytes with the same matplotlib. Matplotlib is optional, hence imported on use, and its
figures and axes are typed as ``Any``.
"""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import RunError
from ..files.outputs import write_output

DPI = 160


@dataclass(frozen=True)
class Theme:
    """Colours for a light or a dark page; ``series`` suits colour-blind readers too (after Okabe and Ito 2008)."""

    suffix: str
    background: str
    text: str
    muted: str
    grid: str
    series: tuple[str, str, str]
    ramp: tuple[str, str]


THEMES = (
    Theme("", "#ffffff", "#1f2328", "#59636e", "#d8dee4", ("#0072b2", "#d55e00", "#007d5a"), ("#f3f6f9", "#0072b2")),
    Theme(
        "-dark", "#0d1117", "#e6edf3", "#9198a1", "#30363d", ("#56b4e9", "#e69f00", "#2bc49a"), ("#1c2430", "#56b4e9")
    ),
)
OURS, WARNING, PEER = 0, 1, 2
"""Positions in :attr:`Theme.series`."""

Draw = Callable[[Any, Theme], None]
"""Draws a chart into an empty matplotlib ``Figure``."""


def require_matplotlib() -> None:
    """Check before long measurements that charts can be drawn.

    Raises
    ------
    RunError
        matplotlib is not installed.
    """
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise RunError(
            "charts: expected matplotlib, it is not installed; run pip install matplotlib and try again"
        ) from None


def chart_outputs(data: Path) -> list[Path]:
    """The files of :func:`write_chart`."""
    return [chart_path(data, theme, kind) for theme in THEMES for kind in ("svg", "png")]


def chart_path(data: Path, theme: Theme, kind: str) -> Path:
    """The file of a chart; ``kind`` is svg or png."""
    return data.with_name(f"{data.stem}{theme.suffix}.{kind}")


def write_chart(data: Path, draw: Draw, size_inches: tuple[float, float], *, title: str) -> list[Path]:
    """Write a chart next to its data file: ``NAME.svg``, ``NAME.png``, ``NAME-dark.svg`` and ``NAME-dark.png``.

    Parameters
    ----------
    data
        The file with the chart's data: determines folder and name.
    draw
        Called with an empty figure and the theme.
    title
        The chart's title, also in the files' metadata.

    Raises
    ------
    RunError
        matplotlib is not installed, or a file cannot be written.
    """
    require_matplotlib()
    written = []
    for theme in THEMES:
        with _style(theme):
            from matplotlib.figure import Figure
            from matplotlib.layout_engine import ConstrainedLayoutEngine

            figure = Figure(figsize=size_inches, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.1))
            figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold")
            draw(figure, theme)
            for kind, metadata in (("svg", {"Date": None, "Creator": None}), ("png", {"Software": None})):
                content = io.BytesIO()
                figure.savefig(content, format=kind, metadata={"Title": title, **metadata})
                path = chart_path(data, theme, kind)
                write_output(path, content.getvalue())
                written.append(path)
    return written


@contextmanager
def _style(theme: Theme) -> Iterator[None]:
    """Use matplotlib's defaults instead of the user's settings, with the colours of a theme."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(
            {
                "svg.hashsalt": "oneframe",
                "svg.fonttype": "path",
                "savefig.dpi": DPI,
                "font.size": 11,
                "figure.facecolor": theme.background,
                "axes.facecolor": theme.background,
                "axes.edgecolor": theme.muted,
                "axes.labelcolor": theme.text,
                "axes.titlecolor": theme.text,
                "axes.titlesize": 11,
                "axes.titlelocation": "left",
                "axes.spines.top": False,
                "axes.spines.right": False,
                "axes.axisbelow": True,
                "grid.color": theme.grid,
                "text.color": theme.text,
                "xtick.color": theme.muted,
                "ytick.color": theme.muted,
                "xtick.labelcolor": theme.text,
                "ytick.labelcolor": theme.text,
            }
        )
        yield


def note(figure: Any, theme: Theme, text: str) -> None:
    """Write one line in small print below the chart."""
    figure.supxlabel(text, x=0.012, ha="left", fontsize=9.5, color=theme.muted)


def round_ticks_inside(axes: Any, *, margin: float) -> None:
    """About four round ticks along x, none of them outside the data."""
    from matplotlib.ticker import MaxNLocator

    axes.margins(x=margin)
    low, high = axes.get_xlim()
    axes.set_xticks([tick for tick in MaxNLocator(4).tick_values(low, high) if low <= tick <= high])
    axes.set_xlim(low, high)
