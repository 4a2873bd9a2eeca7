"""Chart of the render time relative to PyVista's."""

from pathlib import Path
from typing import Any

from oneframe.charts.page import OURS, WARNING, Theme, note, write_chart

from ..rendering.render_times import LIT_PEER, UNLIT_PEER, RenderTimes
from .log_axes import plain_log_axis, round_ticks


def render_speed_charts(times: RenderTimes, data: Path) -> list[Path]:
    """Draw the time of a view relative to PyVista's, median and range over the rounds; returns the files written."""
    ours = times.ours

    def draw(figure: Any, theme: Theme) -> None:
        axes = figure.subplots()
        drawn = []
        for shift, peer, series, marker, sign in (
            (-0.16, LIT_PEER, OURS, "o", "\N{BLACK CIRCLE}"),
            (0.16, UNLIT_PEER, WARNING, "^", "\N{BLACK UP-POINTING TRIANGLE}"),
        ):
            colour, label = theme.series[series], f"{sign}  against {peer}"
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
                    bbox={"facecolor": theme.background, "edgecolor": "none", "pad": 1},
                )
            axes.text(0.0 if series == OURS else 0.5, 1.02, label, transform=axes.transAxes, color=colour, va="bottom")
        axes.axvline(1, color=theme.muted, linewidth=1, linestyle=(0, (4, 3)))
        axes.set_xscale("log")
        low, high = min(*drawn, 1.0) / 1.12, max(*drawn, 1.0) * 1.55
        axes.set(xlim=(low, high), ylim=(len(ours) - 0.5, -0.5))
        ticks = [tick for tick in (0.25, 0.35, 0.5, 0.7, 1, 1.4, 2, 2.8, 4, 5.6, 8) if low <= tick <= high]
        plain_log_axis(axes.xaxis, ticks if len(ticks) > 1 else round_ticks(low, high))
        axes.set_yticks(range(len(ours)), ours)
        axes.tick_params(axis="y", length=0)
        axes.grid(axis="x", linewidth=0.8)
        axes.set_xlabel("time of a view, PyVista = 1 (less is faster)")
        note(
            figure,
            theme,
            "ours: complete views on disk; PyVista: RGB in memory; "
            f"median and range of {times.rounds} alternating rounds",
        )

    return write_chart(data, draw, (10.2, 1.9 + 0.75 * len(ours)), title="Render speed against PyVista")
