"""The parts of a report about cells and physics; only where a setting was run at both levels."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usarsim_exploration.measures import MEASURES
from usarsim_exploration.reporting.agreement import FEWEST, Agreement, Level, Order, Pair, costs
from usarsim_exploration.reporting.comparison import RANKED, title
from usarsim_exploration.reporting.pictures import Look, axes_of, picture_of
from usarsim_exploration.reporting.runs import DISCS, GRID
from usarsim_report.page import Page
from usarsim_report.svg import MUTED
from usarsim_report.wording import NONE, interval, number, with_unit

PICTURED = 12
"""Settings whose curves are drawn; of more there are the numbers."""
COLUMNS = 3
"""Panels beside each other."""
GOAL = "team_t90"
"""By which scatter plots compare strategies."""
WANTED = 10.0
"""Percent points that coverage at equal distance may differ by."""
WHERE = {GRID: "on the grid", DISCS: "with discs"}
"""How the levels of cells are spoken of."""
Array = Any


def write(page: Page, found: Agreement, look: Look) -> None:
    """Curves, differences, orders and costs."""
    where = WHERE[found.cells]
    page.heading(f"{found.cells.capitalize()} and physics")
    page.paragraph(_glance(found), "lead")
    for place, pair in enumerate(found.pairs[:PICTURED]):
        if pair.coverage:
            page.picture(
                _curves(f"{found.cells}-{place}", pair, look, where),
                f"{pair.real.setting}: coverage of the team by what all robots drove, {where} "
                "(dashed) and with physics (solid); means with pointwise 95 % bands (three runs or "
                "more).",
            )
    _gaps(page, found)
    _orders(page, found)
    drawn = [pair for pair in found.pairs if pair.orders[GOAL].times]
    if drawn:
        page.picture(
            _scatter(f"{found.cells}-times", drawn, look, where),
            f"{title(GOAL)}: mean steps of each strategy {where} and with physics, by "
            "setting. Strategies whose points rise together are ordered alike; on the line both "
            "levels take as many steps.",
        )
    _costs(page, found, where)


def _glance(found: Agreement) -> str:
    """The result in words."""
    gaps = [one.gap for pair in found.pairs for one in pair.coverage.values()]
    told = []
    if gaps:
        below = sum(gap < WANTED for gap in gaps)
        told.append(
            f"At equal distance coverage differs by {number(max(gaps))} percent points at most; by "
            f"less than {WANTED:.0f} in {below} of {len(gaps)} pairs of setting and strategy."
        )
    for goal, (tau, between) in found.over_all.items():
        told.append(f"{title(goal)}: tau {number(tau)} ({_between(between)}).")
    return " ".join(told) or "Runs do not tell enough to compare levels."


def _between(found: Any) -> str:
    return f"95 % interval {interval(found)}" if found else "no interval"


def _gaps(page: Page, found: Agreement) -> None:
    rows = []
    for pair in found.pairs:
        for strategy, one in pair.coverage.items():
            name = f"{pair.real.setting}: {strategy}"
            runs = f"{one.grid.runs}, {one.real.runs}"
            far = number(float(one.distance[-1]))
            rows.append([name, runs, far, number(one.gap), number(one.mean_gap)])
    if rows:
        heads = ("Coverage", "Runs", "Up to cells", "Largest difference (points)", "Mean")
        page.table(heads, rows, "numbers")


def _orders(page: Page, found: Agreement) -> None:
    rows = [
        [f"{title(goal)}: {pair.real.setting}", *_order(pair.orders[goal])]
        for goal in RANKED
        for pair in found.pairs
        if pair.orders[goal].times
    ]
    rows += [
        [f"{title(goal)}: mean over settings", "", number(tau), interval(between)]
        for goal, (tau, between) in found.over_all.items()
        if len(found.pairs) > 1
    ]
    heads = ("Order of strategies", "Strategies", "Kendall's tau", "95 % interval")
    page.table(heads, rows, "numbers")
    page.paragraph(
        "Tau is 1 where both levels order strategies alike and -1 where they order them the other "
        f"way round; there is none of fewer than {FEWEST}. Intervals are by the percentile "
        "bootstrap over seeds, the same draws of seeds for all strategies. Mean times are "
        "restricted to the steps that all runs of a level can be told for.",
        "note",
    )


def _order(one: Order) -> list[str]:
    tau = NONE if one.tau is None else number(one.tau)
    return [str(len(one.times)), tau, interval(one.interval)]


def _costs(page: Page, found: Agreement, where: str) -> None:
    """What physics costs, and how much longer it takes."""
    for pair in found.pairs:
        strategies = [name for name in pair.real.runs if name in pair.grid.runs]
        rows = [
            [with_unit(title(name), MEASURES[name].unit)]
            + [number(values[one]) if one in values else NONE for one in strategies]
            for name, values in costs(pair.real).items()
        ]
        times = pair.orders[GOAL].times
        for head, each in (
            (f"{title(GOAL)}: steps with physics by steps {where}", times),
            (f"Distance with physics by distance {where}", _distances(pair)),
        ):
            rows.append([head, *(_ratio(each.get(one)) for one in strategies)])
        page.table((f"What physics costs: {pair.real.setting}", *strategies), rows, "numbers")


def _ratio(values: tuple[float, float] | None) -> str:
    return number(values[1] / values[0]) if values and values[0] else NONE


def _distances(pair: Pair) -> dict[str, tuple[float, float]]:
    """Mean cells driven at both levels, by strategy."""
    cells = ((name, [one.cells.get(("distance", name)) for one in (pair.grid, pair.real)])
             for name in pair.real.runs)  # fmt: skip
    return {
        name: (grid.mean, real.mean)
        for name, (grid, real) in cells
        if grid and real and grid.mean is not None and real.mean is not None
    }


def _curves(name: str, pair: Pair, look: Look, where: str) -> str:
    """A panel for each strategy."""
    strategies = list(pair.coverage)
    rows = -(-len(strategies) // COLUMNS)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(rows, COLUMNS, sharey=True, squeeze=False)
        for axes, strategy in zip(panels.flat, strategies, strict=False):
            one = pair.coverage[strategy]
            line = {"color": look.colour(strategy), "linewidth": 1.5}
            _band(axes, one.distance, one.grid, line | {"linestyle": (0, (4, 2))})
            _band(axes, one.distance, one.real, line)
            axes_of(axes, strategy, "cells driven")
            axes.set_ylim(0, 102)
        for axes in panels.flat[len(strategies) :]:
            axes.set_axis_off()
        for axes in panels[:, 0]:
            axes.set_ylabel("reachable cells known (%)")

    label = f"Coverage by distance {where} and with physics, {pair.real.setting}"
    return picture_of(name, label, 2.3 * rows + 0.2, draw)


def _band(axes: Axes, distance: Array, level: Level, line: dict[str, Any]) -> None:
    axes.plot(distance, level.mean, **line)
    if level.low is not None and level.high is not None:
        axes.fill_between(
            distance, level.low, level.high, color=line["color"], alpha=0.18, linewidth=0
        )


def _scatter(name: str, pairs: list[Pair], look: Look, where: str) -> str:
    """A panel for each setting, a point for each strategy."""
    strategies = sorted({one for pair in pairs for one in pair.orders[GOAL].times})
    rows = -(-len(pairs) // COLUMNS)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(rows, COLUMNS, squeeze=False)
        for axes, pair in zip(panels.flat, pairs, strict=False):
            times = pair.orders[GOAL].times
            most = 1.1 * max(max(one) for one in times.values())
            axes.plot([0, most], [0, most], color=MUTED, linewidth=0.8)
            for strategy, (grid, real) in times.items():
                style = {"color": look.colour(strategy), "linestyle": ""}
                axes.plot([grid], [real], look.marker(strategy), ms=5, **style)
            axes_of(axes, str(pair.grid.setting), f"steps {where}")
            axes.set_xlim(0, most)
            axes.set_ylim(0, most)
        for axes in panels.flat[len(pairs) :]:
            axes.set_axis_off()
        for axes in panels[:, 0]:
            axes.set_ylabel("steps with physics")
        look.points(figure, strategies)

    label = f"{title(GOAL)} of strategies {where} and with physics"
    return picture_of(name, label, 2.5 * rows + 0.3 + 0.19 * math.ceil(len(strategies) / 4), draw)
