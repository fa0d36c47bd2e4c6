"""The pictures of a report: curves, goals reached, spread over runs, and ranks.

Strategies differ by colour (M. Okabe, K. Ito, Color Universal Design, 2008, without the yellow that
is lost on white) and, beyond these, by dashes; points also by shape.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cbook import boxplot_stats
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from usarsim_exploration.measures import MEASURES
from usarsim_exploration.reporting.comparison import GOALS, Group, title
from usarsim_exploration.reporting.ranking import Ranking
from usarsim_exploration.reporting.runs import Array, Curves, Run
from usarsim_exploration.reporting.survival import Time, band, kaplan_meier
from usarsim_report.svg import HAIR, INK, MARKERS, MUTED, picture

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000", "#e69f00", "#56b4e9")
DASHES = ("-", (0, (5, 2)), (0, (1, 1.2)))
SPREAD = ("base_t90", "team_t90", "base_area", "mean_wait", "distance", "disconnected")
"""Measures whose spread over runs is drawn."""
WIDTH = 7.2
_POINTS = 120
"""At most so many along a curve."""
_SHIFTS = (0.0, 0.11, -0.11, 0.055, -0.055)
"""Of points of a box, in turn, in rows."""


class Look:
    """How each strategy is drawn, the same on the whole page."""

    def __init__(self, strategies: Sequence[str]) -> None:
        self._places = {name: place for place, name in enumerate(strategies)}

    def colour(self, strategy: str) -> str:
        """Of lines and points."""
        return PALETTE[self._places[strategy] % len(PALETTE)]

    def line(self, strategy: str) -> dict[str, Any]:
        """Style of a line."""
        dash = DASHES[self._places[strategy] // len(PALETTE) % len(DASHES)]
        return {"color": self.colour(strategy), "linestyle": dash, "linewidth": 1.5}

    def marker(self, strategy: str) -> str:
        """Shape of points."""
        return MARKERS[self._places[strategy] % len(MARKERS)]

    def legend(self, figure: Figure, strategies: Sequence[str]) -> None:
        """Names of lines, below the figure."""
        self._legend(figure, strategies, [Line2D([], [], **self.line(one)) for one in strategies])

    def points(self, figure: Figure, strategies: Sequence[str]) -> None:
        """Names of points, below the figure."""
        marks = [
            Line2D([], [], linestyle="", marker=self.marker(one), color=self.colour(one))
            for one in strategies
        ]
        self._legend(figure, strategies, marks)

    @staticmethod
    def _legend(figure: Figure, strategies: Sequence[str], marks: Sequence[Line2D]) -> None:
        figure.legend(
            marks,
            [_text(one) for one in strategies],
            loc="outside lower center",
            ncols=_columns(strategies),
            frameon=False,
        )


def _columns(names: Sequence[str]) -> int:
    """Of a legend, so that it is no wider than the figure."""
    return max(1, min(len(names), int(WIDTH / (0.6 + 0.08 * max(map(len, names))))))


def _legend_height(names: Sequence[str]) -> float:
    """Inches that a legend needs beyond its first line."""
    return 0.19 * (-(-len(names) // _columns(names)) - 1)


def curves(name: str, group: Group, look: Look) -> str:
    """Mean coverage by step of team and base, with 95 % bands; empty if no run tells it."""
    told = {
        strategy: [run.curves for run in runs if run.curves is not None]
        for strategy, runs in group.runs.items()
    }
    told = {strategy: found for strategy, found in told.items() if found}
    steps = np.unique(np.linspace(0, group.horizon, _POINTS + 1).round())

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, sharey=True)
        for axes, who in ((left, "team"), (right, "base")):
            for strategy, found in told.items():
                known = 100 * np.array([_at(steps, one, who) for one in found])
                axes.plot(steps, known.mean(axis=0), **look.line(strategy))
                if len(known) > 2:
                    low, high = band(known)
                    colour = look.colour(strategy)
                    axes.fill_between(steps, low, high, color=colour, alpha=0.18, linewidth=0)
            axes_of(axes, who.capitalize(), "step")
            axes.set_xlim(0, max(group.horizon, 1))
            axes.set_ylim(0, 102)
        left.set_ylabel("reachable cells known (%)")
        look.legend(figure, list(told))

    if not told:
        return ""
    height = 3.0 + _legend_height(list(told))
    return picture_of(name, f"Coverage by step, {group.setting}", height, draw)


def _at(steps: Array, curve: Curves, who: str) -> Array:
    """Linear between what was told, and the last value after the end."""
    found: Array = np.interp(steps, curve.steps, getattr(curve, who))
    return found


def goals(name: str, group: Group, look: Look) -> str:
    """The share of runs that have reached each goal, by step (Kaplan-Meier)."""

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, 3, sharex=True, sharey=True)
        for axes, goal in zip(panels.flat, GOALS, strict=True):
            for strategy, runs in group.runs.items():
                times = [time for run in runs if (time := run.time(goal)) is not None]
                if times:
                    _reached(axes, times, group.limit, look.line(strategy))
            axes_of(axes, title(goal), "")
            axes.set_ylim(-3, 103)
        for axes in panels[:, 0]:
            axes.set_ylabel("runs that are there (%)")
        for axes in panels[1]:
            axes.set_xlabel("step")
        panels[0, 0].set_xlim(0, max(group.limit, 1))
        look.legend(figure, list(group.runs))

    height = 3.9 + _legend_height(list(group.runs))
    return picture_of(name, f"Runs that have reached goals by step, {group.setting}", height, draw)


def _reached(axes: Axes, times: Sequence[Time], limit: int, line: dict[str, Any]) -> None:
    steps, shares = kaplan_meier(times)
    end = min(limit, max(time.at for time in times))
    last = max(float(steps[-1]), end)
    axes.plot(
        [*steps, last], 100 * (1 - np.append(shares, shares[-1])), drawstyle="steps-post", **line
    )
    stopped = sorted({time.at for time in times if not time.reached and math.isfinite(time.at)})
    if stopped:
        places = np.searchsorted(steps, stopped, side="right") - 1
        style = {"color": line["color"], "markersize": 7, "markeredgewidth": 1.2}
        axes.plot(stopped, 100 * (1 - shares[places]), "|", **style)


def spread(name: str, group: Group, look: Look) -> str:
    """Every run by measure, in boxes of quartiles; runs that missed a goal stand apart."""
    strategies = list(group.runs)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, 3, sharey=True)
        for axes, measure in zip(panels.flat, SPREAD, strict=True):
            for row, strategy in enumerate(strategies):
                _box(axes, measure, row, strategy, group.runs[strategy], look)
            unit = MEASURES[measure].unit
            axes_of(axes, title(measure), "part" if unit == "1" else unit)
            axes.set_yticks(range(len(strategies)), [_text(one) for one in strategies])
            axes.set_ylim(len(strategies) - 0.45, -0.55)
            axes.tick_params(axis="y", length=0.0, labelcolor=INK)
            axes.grid(axis="y", visible=False)
            axes.margins(x=0.08)

    height = 1.6 + 0.62 * len(strategies)
    return picture_of(name, f"All runs by measure, {group.setting}", height, draw)


def _box(
    axes: Axes, measure: str, row: int, strategy: str, runs: Sequence[Run], look: Look
) -> None:
    """Points of the runs of a strategy; quartiles if all have a value."""
    style: dict[str, Any] = {"color": look.colour(strategy), "linestyle": ""}
    heights = [row + _SHIFTS[place % len(_SHIFTS)] for place in range(len(runs))]
    values = [run.measures.get(measure) for run in runs]
    known = [(x, y) for x, y in zip(values, heights, strict=True) if x is not None]
    missed = [
        (time.at, y)
        for run, y in zip(runs, heights, strict=True)
        if measure in GOALS and (time := run.time(measure)) is not None and not time.reached
    ]
    if known:
        axes.plot(*zip(*known, strict=True), look.marker(strategy), alpha=0.6, ms=3.2, **style)
    if stopped := [one for one in missed if math.isfinite(one[0])]:
        axes.plot(*zip(*stopped, strict=True), ">", ms=4.5, fillstyle="none", **style)
    if never := [y for x, y in missed if math.isinf(x)]:
        edge = axes.get_yaxis_transform()
        axes.plot([1.03] * len(never), never, "x", transform=edge, clip_on=False, ms=4, **style)
    if known and not missed:
        _quartiles(axes, row, [x for x, _ in known])


def _quartiles(axes: Axes, row: int, values: Sequence[float]) -> None:
    """A box; matplotlib's own lies down by an option that differs between versions."""
    one = boxplot_stats(values)[0]
    low, high, ends = one["q1"], one["q3"], (row - 0.27, row + 0.27)
    style: dict[str, Any] = {"color": INK, "linewidth": 0.8, "zorder": 1}
    axes.plot([low, high, high, low, low], [*ends[:1] * 2, *ends[1:] * 2, ends[0]], **style)
    axes.plot([one["whislo"], low], [row, row], **style)
    axes.plot([high, one["whishi"]], [row, row], **style)
    axes.plot([one["med"]] * 2, ends, **style | {"linewidth": 1.6})


def ranks(name: str, label: str, ranking: Ranking) -> str:
    """A critical-difference diagram (Demsar): bars join what is not told apart."""
    names = list(ranking.ranks)
    half = math.ceil(len(names) / 2)
    groups = ranking.alike()
    top = 0.55 + 0.16 * len(groups)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.set_axis_off()
        count = len(names)
        axes.set_xlim(1 - 0.42 * (count - 1), count + 0.42 * (count - 1))
        axes.set_ylim(top + 0.33 * half, -1.15)
        _line(axes, (1, count), (0, 0), MUTED, 0.9)
        for tick in range(1, count + 1):
            _line(axes, (tick, tick), (0, -0.12), MUTED, 0.9)
            if (tick - 1) % math.ceil(count / 12) == 0:
                axes.text(tick, -0.17, str(tick), ha="center", va="bottom", color=MUTED)
        ends = 1, min(1 + ranking.difference, axes.get_xlim()[1])
        _line(axes, ends, (-0.72, -0.72), INK, 1.6)
        axes.text(1, -0.78, f"critical difference {ranking.difference:.2f}", ha="left", va="bottom")
        for place, (one, mean) in enumerate(ranking.ranks.items()):
            left = place < half
            row = place if left else count - 1 - place
            y = top + 0.33 * row
            x = 1 - 0.06 * (count - 1) if left else count + 0.06 * (count - 1)
            axes.plot([mean, mean, x], [0, y, y], color=INK, linewidth=0.8)
            text = f"{_text(one)}  {mean:.2f}" if left else f"{mean:.2f}  {_text(one)}"
            side = "right" if left else "left"
            shift = -0.02 if left else 0.02
            axes.text(x + shift * (count - 1), y, text, ha=side, va="center")
        for row, (first, last) in enumerate(groups):
            y = 0.25 + 0.16 * row
            span = ranking.ranks[first], ranking.ranks[last]
            reach = 0.008 * (count - 1)
            _line(axes, (span[0] - reach, span[1] + reach), (y, y), INK, 3.2)

    return picture_of(name, label, 0.75 + 0.16 * len(groups) + 0.27 * half, draw)


def _line(
    axes: Axes, x: tuple[float, float], y: tuple[float, float], colour: str, width: float
) -> None:
    axes.plot(x, y, color=colour, linewidth=width, solid_capstyle="butt")


def axes_of(axes: Axes, head: str, unit: str) -> None:
    """Title, unit below, and a grid."""
    axes.set_title(_text(textwrap.fill(head, 24)))
    axes.set_xlabel(unit)
    axes.grid(color=HAIR, linewidth=0.5)
    axes.set_axisbelow(True)


def picture_of(name: str, label: str, height: float, draw: Callable[[Figure], None]) -> str:
    """An SVG of the width of the page. height: inches."""
    return picture(name, label, WIDTH, height, draw)


def _text(name: str) -> str:
    """A name as matplotlib shows it as it is."""
    return (" " + name if name.startswith("_") else name).replace("$", r"\$")
