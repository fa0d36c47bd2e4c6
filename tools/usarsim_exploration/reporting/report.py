"""The report of exploration runs: one HTML file without network, and the same as Markdown.

The same folders give the same bytes: there is no date in it, and everything drawn comes from fixed
seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path
from statistics import median

from usarsim_exploration.measures import MEASURES
from usarsim_exploration.reporting import agreement_page, pictures, tables
from usarsim_exploration.reporting.agreement import agree
from usarsim_exploration.reporting.comparison import (
    GOALS,
    RANKED,
    Cell,
    Comparison,
    Group,
    compare,
    title,
)
from usarsim_exploration.reporting.ranking import ALPHA, Pair
from usarsim_exploration.reporting.runs import Run, Source
from usarsim_exploration.reporting.survival import log_rank
from usarsim_report.page import Page
from usarsim_report.wording import NONE, interval, number, p_told, p_value, span, with_unit
from usarsim_server.base.files import write_text

PICTURED = 24
"""Settings that get pictures; of more there are the numbers."""
LISTED = 200
"""Runs that the page lists one by one; `runs.csv` has all."""
INDENT = "\u2003"
"""Of names below a heading of a table."""
SETTINGS = 3
"""Of fewer settings strategies are not ranked by their means."""
Progress = Callable[[str], None]


def write(sources: tuple[Source, ...], folder: Path, progress: Progress) -> list[Path]:
    """Write `report.html`, `report.md`, `table.csv`, `runs.csv` and `table.tex`.

    Args:
        sources: at least one. folder: exists. progress: is told what is being done.

    Returns:
        The files.
    """
    progress("compares")
    found = compare(sources)
    page = _page(found, progress)
    contents = {
        "report.html": page.html(),
        "report.md": page.markdown(),
        "table.csv": tables.table_csv(found),
        "runs.csv": tables.runs_csv(found),
        "table.tex": tables.table_tex(found),
    }
    for name, text in contents.items():
        write_text(folder / name, text)
    return [folder / name for name in contents]


def _page(found: Comparison, progress: Progress) -> Page:
    page = Page("Exploration runs")
    look = pictures.Look(found.strategies)
    _glance(page, found)
    if found.failed:
        _failed(page, found)
    _ranking(page, found)
    _overview(page, found)
    for level in agree(found):
        progress(f"compares {level.cells} and physics")
        agreement_page.write(page, level, look)
    for number_, group in enumerate(found.groups, start=1):
        progress(f"setting {number_} of {len(found.groups)}")
        page.heading(str(group.setting))
        if number_ <= PICTURED:
            _pictures(page, group, look, f"s{number_}")
        _numbers(page, group)
        _pairs(page, group)
    _runs(page, found)
    _methods(page, found)
    return page


def _glance(page: Page, found: Comparison) -> None:
    """The result in words."""
    told = _best(found)
    if told:
        page.paragraph(told, "lead")
    runs = sum(len(mine) for group in found.groups for mine in group.runs.values())
    seeds = {run.seed for group in found.groups for mine in group.runs.values() for run in mine}
    page.paragraph(
        f"{_count(runs, 'run')} of {_count(len(found.strategies), 'strategy')} in "
        f"{_count(len(found.groups), 'setting')} (environment, robots, radio) with "
        f"{_count(len(seeds), 'seed')}; {len(found.failed) or 'none'} failed."
    )
    if len(found.groups) > PICTURED:
        page.paragraph(f"Pictures are of the first {PICTURED} settings, numbers of all.", "note")


def _best(found: Comparison) -> str:
    """Who is first by the most important goal that tells strategies apart."""
    for goal, one in found.by_seed.items():
        names = list(one.ranks)
        worse = [name for name in names if one.ranks[name] - one.ranks[names[0]] >= one.difference]
        alike = [name for name in names[1:] if name not in worse]
        if worse:
            other = f", not told apart from {_listed(alike)}" if alike else ""
            return f"{title(goal)}: {names[0]} is first{other}."
    return "Ranks do not tell the strategies apart." if found.by_seed else ""


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _count(count: int, what: str) -> str:
    if count == 1:
        return f"1 {what}"
    return f"{count} {what.removesuffix('y')}ies" if what.endswith("y") else f"{count} {what}s"


def _failed(page: Page, found: Comparison) -> None:
    page.heading("Failed runs")
    page.paragraph("They have no values and count nowhere.")
    page.table(
        ("Setting", "Strategy", "Seed", "Error"),
        [
            [str(run.setting), run.strategy, str(run.seed), " ".join(run.error.split())]
            for run in found.failed
        ],
    )


def _ranking(page: Page, found: Comparison) -> None:
    if len(found.strategies) < 2:
        return
    page.heading("Ranks over all settings")
    if not found.by_seed:
        page.paragraph("No setting and seed has runs of all strategies, so nothing is ranked.")
        return
    rankings = {
        f"{title(goal)}, {what}": one
        for what, each in (("seeds", found.by_seed), ("settings", found.by_setting))
        for goal, one in each.items()
        if what == "seeds" or one.blocks >= SETTINGS
    }
    for place, (head, one) in enumerate(rankings.items()):
        goal, _, what = head.partition(", ")
        blocks = (
            f"{_count(one.blocks, 'setting')}, by mean times"
            if what == "settings"
            else f"{_count(one.blocks, 'pair')} of setting and seed"
        )
        label = f"{goal}: mean ranks over {blocks}"
        differ = f" Friedman's test: {p_told(one.friedman.p, ALPHA)}." if one.friedman else ""
        caption = f"{label}; 1 is best.{differ} Bars join strategies that are not told apart."
        page.picture(pictures.ranks(f"ranks-{place}", label, one), caption)
    rows = [
        [strategy, *(number(one.ranks[strategy]) for one in rankings.values())]
        for strategy in next(iter(rankings.values())).ranks
    ]
    page.table(("Mean rank", *rankings), rows, "numbers")


def _overview(page: Page, found: Comparison) -> None:
    """The most important goals, setting by setting."""
    if len(found.groups) < 2:
        return
    page.heading("Settings")
    for goal in RANKED:
        rows = [
            [str(group.setting), *(_mean(group.cells.get((goal, one))) for one in found.strategies)]
            for group in found.groups
        ]
        page.table((f"{title(goal)}, mean steps", *found.strategies), rows, "numbers")
    page.paragraph("In brackets: runs that got there, if not all of them did.", "note")


def _mean(cell: Cell | None) -> str:
    if cell is None:
        return NONE
    text = number(cell.mean)
    return text if cell.reached == cell.runs else f"{text} ({_of(cell)})"


def _pictures(page: Page, group: Group, look: pictures.Look, name: str) -> None:
    page.picture(
        pictures.curves(f"{name}-curves", group, look),
        "Coverage by step: means of runs with pointwise 95 % bands (three runs or more). A run "
        "that ended keeps its last value.",
    )
    page.picture(
        pictures.goals(f"{name}-goals", group, look),
        "Share of runs that have reached a goal by step (Kaplan-Meier). A mark stands where a run "
        "was stopped before it reached the goal.",
    )
    page.picture(
        pictures.spread(f"{name}-spread", group, look),
        "All runs; boxes are quartiles, whiskers reach 1.5 times as far. An open triangle is a run "
        "that was stopped before the goal, when it was; a cross at the edge one that would never "
        "have reached it. There is no box where a run has no time.",
    )


def _numbers(page: Page, group: Group) -> None:
    rows = []
    for measure, found in groupby(group.cells.values(), lambda cell: cell.measure):
        unit = MEASURES[measure].unit
        rows.append([with_unit(title(measure), unit), *[""] * 6])
        for cell in found:
            known = cell.low is not None and cell.high is not None
            rows.append(
                [
                    INDENT + cell.strategy, _of(cell), number(cell.mean), interval(cell.interval),
                    number(cell.sd), number(cell.median),
                    span(cell.low or 0, cell.high or 0) if known else NONE,
                ]
            )  # fmt: skip
    heads = ("", "Runs", "Mean", "95 % interval", "SD", "Median", "Quartiles")
    page.table(heads, rows, "numbers")
    horizons = [
        f"{title(goal)} {number(cells[0].horizon)}"
        for goal in GOALS
        if (cells := [cell for cell in group.cells.values() if cell.measure == goal])
        and (
            any(cell.reached < cell.runs for cell in cells) or (cells[0].horizon or 0) < group.limit
        )
    ]
    if horizons:
        page.paragraph(
            "Not all runs reached these goals; means are restricted to so many steps: "
            f"{', '.join(horizons)}.",
            "note",
        )


def _of(cell: Cell) -> str:
    return str(cell.runs) if cell.reached == cell.runs else f"{cell.reached} of {cell.runs}"


def _pairs(page: Page, group: Group) -> None:
    """Which strategies differ in a setting."""
    if len(group.runs) < 2:
        return
    differ = [
        [title(name), p_value(one.friedman.p, ALPHA), str(one.blocks)]
        for name, one in group.rankings.items()
        if one.friedman is not None
    ]
    if differ:
        page.table(("Do strategies differ?", "Friedman p", "Seeds"), differ, "numbers")
    rows = [
        [
            f"{title(goal)}: {pair.first}, {pair.second}",
            f"{pair.wins}, {pair.losses}, {pair.ties}",
            p_value(pair.p, ALPHA),
            p_value(pair.holm, ALPHA),
            p_value(_log_rank(group, goal, pair), ALPHA),
        ]
        for goal in RANKED
        if goal in group.rankings
        for pair in group.rankings[goal].pairs
    ]  # fmt: skip
    if rows:
        heads = ("Pair", "First, second earlier, tie", "Sign p", "Holm p", "Log-rank p")
        page.table(heads, rows, "numbers")
    else:
        page.paragraph("No seed has runs of all strategies, so pairs are not compared.", "note")


def _log_rank(group: Group, goal: str, pair: Pair) -> float | None:
    one, other = (
        [time for run in group.runs[name] if (time := run.time(goal)) is not None]
        for name in (pair.first, pair.second)
    )
    return log_rank(one, other, group.limit)


def _runs(page: Page, found: Comparison) -> None:
    page.heading("Runs")
    good = [run for group in found.groups for mine in group.runs.values() for run in mine]
    if len(good) > LISTED:
        page.paragraph(f"{len(good)} runs are too many for a page: see runs.csv.")
    else:
        heads = ["Run", "Seed", "Ended", "Step", *map(title, GOALS)]
        rows = [
            [
                f"{run.setting}, {run.strategy}",
                str(run.seed),
                run.ended,
                str(run.step),
                *_times(run),
            ]
            for run in good
        ]
        page.table(heads, rows, "numbers")
    spent = [
        [strategy, str(len(mine)), number(median(mine)), span(min(mine), max(mine))]
        for strategy in found.strategies
        if (mine := [run.spent for run in good if run.strategy == strategy and run.spent])
    ]
    if spent:
        heads = ["Processor time (ms by step)", "Runs", "Median", "From, to"]
        page.table(heads, spent, "numbers")
    page.table(
        ("Folder", "Runs", "Format", "Version", "SHA-256"),
        [
            [one.name, str(len(one.runs)), one.format, one.version, one.digest[:16]]
            for one in found.sources
        ],
    )


def _times(run: Run) -> Iterator[str]:
    for goal in GOALS:
        value = run.measures.get(goal)
        yield NONE if value is None else f"{value:.0f}"


def _methods(page: Page, found: Comparison) -> None:
    told = {measure for group in found.groups for measure, _ in group.cells}
    page.heading("How to read this")
    page.paragraph(
        "A run that did not reach a goal has no time. If it was stopped (by its last step, or "
        "since the base knew enough) it is censored: it could have got there later. If its robots "
        "went home or were lost, it never would have. Neither counts as the last step. Means of "
        "times are restricted means: of the time to the goal or to the horizon that stands below "
        "the table, whichever comes first; where nobody got there, there is no mean. SD and "
        "quartiles are told if all runs have a value."
    )
    page.paragraph(
        "Intervals are of 95 %, by the percentile bootstrap over runs, with a fixed seed; there "
        "are none of fewer than three runs or of runs that are all equal, as those of a strategy "
        "that draws nothing from the seed are. Ranks and signs compare runs of the same setting "
        "and seed; one is better only if that is certain, else they tie (Gehan's scores, "
        "Friedman's and Nemenyi's tests, sign tests with Holm's correction for the pairs of a "
        "goal). Blocks of setting and seed say something about these settings, blocks of settings "
        "about settings like them. The log-rank test leaves the pairing out."
    )
    page.table(
        ("Measure", "Definition"),
        [
            [with_unit(title(name), one.unit), one.definition]
            for name, one in MEASURES.items()
            if name in told
        ],
    )
