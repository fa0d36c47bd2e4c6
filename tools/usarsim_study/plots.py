"""The pictures of a report, in which every participant is visible.

Conditions differ by colour and by shape, so that print in grey stays readable.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usarsim_report.statistics import Interval, Paired, differences
from usarsim_report.svg import COLOURS, HAIR, INK, MARKERS, MUTED, TIE, picture
from usarsim_report.wording import with_unit
from usarsim_study.analysis import Analysis, Cell, OrderEffect, Outcome


def primary(outcome: Outcome, within: bool) -> str:
    """Every participant in every condition, and the differences, one by one."""

    def draw(figure: Figure) -> None:
        two = len(outcome.cells) == 2
        figure.set_layout_engine("constrained", wspace=0.06)
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
        _cells(left, outcome, within, labelled=True)
        if two and within:
            _differences(right, outcome)
        else:
            _intervals(right, outcome)

    label = f"{outcome.measure.title} of every participant by condition, and differences"
    return picture("primary", label, 7.2, 3.3, draw)


def secondary(outcomes: Sequence[Outcome], within: bool) -> str:
    """The same for several measures, small."""
    rows = -(-len(outcomes) // 3)

    def draw(figure: Figure) -> None:
        for place, outcome in enumerate(outcomes, start=1):
            axes = figure.add_subplot(rows, 3, place)
            _cells(axes, outcome, within, labelled=False)
            axes.set_title(outcome.measure.title)
            axes.set_ylabel(_unit(outcome))

    return picture("secondary", "Secondary outcomes by condition", 7.2, 2.35 * rows, draw)


def forest(outcomes: Sequence[Outcome]) -> str:
    """Differences of two conditions in standard deviations, with their intervals; empty if there
    are none."""
    shown = [one for one in outcomes if one.comparisons and _scaled(one) is not None]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axvline(0.0, color=MUTED, linewidth=0.8)
        for place, outcome in enumerate(shown):
            found = _scaled(outcome)
            if found is None:
                continue
            middle, interval = found
            first = outcome.role == "primary"
            colour = COLOURS[0] if first else MUTED
            if interval is not None:
                axes.plot(
                    (interval.low, interval.high), (place, place), color=colour, linewidth=2.2
                )
            axes.plot(middle, place, "D", color=colour, markersize=5.5 if first else 4.5)
        axes.set_yticks(range(len(shown)), [one.measure.title for one in shown])
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0.0, labelcolor=INK)
        axes.spines["left"].set_visible(False)
        axes.grid(axis="x", color=HAIR, linewidth=0.6)
        axes.set_axisbelow(True)
        reach = max(abs(one) for one in axes.get_xlim())
        axes.set_xlim(-reach, reach)
        low, high = outcomes[0].cells[0].title, outcomes[0].cells[1].title
        axes.set_xlabel("standard deviations")
        for x, side, text in (
            (0.0, "left", f"← more with {low}"),
            (1.0, "right", f"more with {high} →"),
        ):
            axes.annotate(
                text,
                (x, 0.0),
                (0.0, -18.0),
                xycoords="axes fraction",
                textcoords="offset points",
                ha=side,
                va="top",
            )

    if not shown:
        return ""
    height = 1.0 + 0.3 * len(shown)
    return picture("forest", "Standardised differences with intervals", 7.2, height, draw)


def order(analysis: Analysis, effect: OrderEffect) -> str:
    """The primary outcome by position of the trial."""
    names = [name for name, _ in analysis.conditions]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        mine: dict[str, list[tuple[int, float, int]]] = {}
        for one in analysis.trials:
            value = one.values.get(effect.measure.name)
            if value is not None:
                row = one.trial, value, names.index(one.condition)
                mine.setdefault(one.participant, []).append(row)
        width = 0.5 / max(1, len(mine))
        for place, rows in enumerate(mine.values()):
            shift = (place - len(mine) / 2) * width
            axes.plot(
                [at + shift for at, _, _ in rows],
                [value for _, value, _ in rows],
                color=TIE,
                linewidth=0.7,
                zorder=1,
            )
            for at, value, condition in rows:
                _dot(axes, at + shift, value, condition)
        for at, found in enumerate(effect.positions, start=1):
            if found is not None:
                axes.plot((at - 0.33, at + 0.33), (found.mean,) * 2, color=INK, linewidth=1.8)
        axes.set_xticks(
            range(1, len(effect.positions) + 1),
            [f"Trial {at}" for at in range(1, len(effect.positions) + 1)],
        )
        axes.set_xlim(0.4, len(effect.positions) + 0.6)
        axes.set_ylabel(with_unit(effect.measure.title, effect.measure.unit))
        for place, (_, title) in enumerate(analysis.conditions):
            axes.plot([], [], MARKERS[place], color=COLOURS[place], markersize=4.5, label=title)
        axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))

    return picture("order", "Primary outcome by position of the trial", 7.2, 2.7, draw)


def preference(analysis: Analysis) -> str:
    """One mark per participant who chose."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots(len(analysis.preferences), 1, squeeze=False)
        for one, chart in zip(analysis.preferences, axes[:, 0], strict=True):
            for place, (_, count) in enumerate(one.counts):
                for at in range(count):
                    _dot(chart, at + 1, place, place, size=6.0)
                chart.text(count + 0.8, place, str(count), va="center", color=INK)
            chart.set_yticks(range(len(one.counts)), [title for title, _ in one.counts])
            chart.set_ylim(len(one.counts) - 0.4, -0.6)
            chart.set_xlim(0.3, max(24.0, max(count for _, count in one.counts) + 3.0))
            chart.set_xticks([])
            chart.tick_params(axis="y", length=0.0, labelcolor=INK)
            for side in ("left", "bottom"):
                chart.spines[side].set_visible(False)

    height = sum(0.35 + 0.3 * len(one.counts) for one in analysis.preferences)
    return picture("preference", "Who preferred which condition", 7.2, height, draw)


def _dot(axes: Axes, x: float, y: float, condition: int, size: float = 4.2) -> None:
    axes.plot(
        x,
        y,
        MARKERS[condition % len(MARKERS)],
        markerfacecolor=COLOURS[condition % len(COLOURS)],
        markeredgecolor="white",
        markeredgewidth=0.5,
        markersize=size,
        alpha=0.9,
        zorder=2,
    )


def _cells(axes: Axes, outcome: Outcome, within: bool, *, labelled: bool) -> None:
    """All values by condition; those of one participant are joined, means have their intervals."""
    codes = list(dict.fromkeys(code for cell in outcome.cells for code in cell.values))
    width = 0.34 / max(1, len(codes))
    places = {code: (at - (len(codes) - 1) / 2) * width for at, code in enumerate(codes)}
    if within:
        for code in codes:
            points = [(at, cell.values.get(code)) for at, cell in enumerate(outcome.cells)]
            known = [(at + places[code], value) for at, value in points if value is not None]
            axes.plot(
                *zip(*known, strict=True), color=TIE, linewidth=0.7, zorder=1
            ) if known else None
    for at, cell in enumerate(outcome.cells):
        for code, value in cell.values.items():
            if value is not None:
                _dot(axes, at + places[code], value, at, 4.2 if labelled else 3.2)
        _mean(axes, at + 0.29, cell, labelled)
    axes.set_xticks(range(len(outcome.cells)), [cell.title for cell in outcome.cells])
    axes.set_xlim(-0.5, len(outcome.cells) - 0.5)
    values = {value for cell in outcome.cells for value in cell.values.values()} - {None}
    if len(values) == 1:  # else the range would be hundredths around it, below zero for a count
        top = 2.0 * (values.pop() or 0.5)
        axes.set_ylim(*sorted((-0.05 * top, top)))
    if labelled:
        axes.set_ylabel(with_unit(outcome.measure.title, outcome.measure.unit))


def _mean(axes: Axes, x: float, cell: Cell, labelled: bool) -> None:
    if cell.summary is None:
        return
    if cell.summary.interval is not None:
        ends = cell.summary.interval.low, cell.summary.interval.high
        axes.plot((x, x), ends, color=INK, linewidth=1.6, zorder=3)
    axes.plot(x, cell.summary.mean, "D", color=INK, markersize=4.5 if labelled else 3.5, zorder=4)


def _differences(axes: Axes, outcome: Outcome) -> None:
    """Each participant's difference, sorted, with mean and interval below, if there are."""
    first, second = outcome.cells
    pairs = [
        (before, after)
        for code, before in first.values.items()
        if before is not None and (after := second.values.get(code)) is not None
    ]
    found = sorted(differences(*zip(*pairs, strict=True)).tolist()) if pairs else []
    axes.axvline(0.0, color=MUTED, linewidth=0.8)
    for place, value in enumerate(found):
        if value == 0.0:
            axes.plot(0.0, place, "o", color=MUTED, markersize=3.2)
            continue
        side = int(value > 0)
        axes.plot((0.0, value), (place, place), color=COLOURS[side], linewidth=0.7, alpha=0.5)
        _dot(axes, value, place, side)
    result = outcome.comparisons[0].result if outcome.comparisons else None
    below = -max(1.6, 0.09 * len(found))
    if isinstance(result, Paired):
        if result.interval is not None:
            ends = result.interval.low, result.interval.high
            axes.plot(ends, (below, below), color=INK, linewidth=1.8)
        axes.plot(result.mean, below, "D", color=INK, markersize=5.0)
        axes.annotate(
            mean_told([result.interval]),
            (result.mean if result.interval is None else result.interval.high, below),
            (6.0, 0.0),
            textcoords="offset points",
            va="center",
            color=MUTED,
            fontsize=7.5,
        )
    if not any(found):
        axes.set_xlim(-1.0, 1.0)
    axes.set_ylim(1.7 * below, len(found))
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(with_unit(f"{second.title} minus {first.title}", outcome.measure.unit))


def _intervals(axes: Axes, outcome: Outcome) -> None:
    """Differences of all pairs of conditions, with their intervals."""
    titles = {cell.condition: cell.title for cell in outcome.cells}
    axes.axvline(0.0, color=MUTED, linewidth=0.8)
    for place, one in enumerate(outcome.comparisons):
        if one.result.interval is not None:
            ends = one.result.interval.low, one.result.interval.high
            axes.plot(ends, (place, place), color=INK, linewidth=1.8)
        axes.plot(one.result.mean, place, "D", color=INK, markersize=5.0)
    names = [f"{titles[one.second]} − {titles[one.first]}" for one in outcome.comparisons]
    if not any(one.result.mean for one in outcome.comparisons):
        axes.set_xlim(-1.0, 1.0)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0.0, labelcolor=INK)
    axes.spines["left"].set_visible(False)
    told = mean_told(one.result.interval for one in outcome.comparisons)
    axes.set_xlabel(with_unit(f"Difference, {told}", outcome.measure.unit))


def mean_told(intervals: Iterable[Interval | None]) -> str:
    """What marks and lines are: few values have no interval."""
    return "mean and 95 % interval" if any(intervals) else "mean"


def _scaled(outcome: Outcome) -> tuple[float, Interval | None] | None:
    """A difference and its interval over the standard deviation; None without spread."""
    result = outcome.comparisons[0].result
    if result.sd is None:
        return None
    interval = result.interval
    if interval is not None:
        interval = Interval(interval.low / result.sd, interval.high / result.sd)
    return result.mean / result.sd, interval


def _unit(outcome: Outcome) -> str:
    return "" if outcome.measure.unit == "1" else outcome.measure.unit
