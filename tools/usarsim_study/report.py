"""The report of a study: one HTML file without network, and the same as Markdown and CSV.

`write` makes them of the tables alone. The same tables give the same bytes: there is no date in
them, and everything drawn comes from fixed seeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from usarsim_server.files import write_text
from usarsim_study import plots, tables
from usarsim_study.analysis import Analysis, Comparison, OrderEffect, Outcome, analyse
from usarsim_study.dataset import Dataset
from usarsim_study.page import Page
from usarsim_study.statistics import Paired, Summary
from usarsim_study.wording import NONE, interval, number, p_told, p_value, span


def write(dataset: Dataset, folder: Path) -> list[Path]:
    """Write `report.html`, `report.md` and `results.csv`.

    Returns:
        The files.
    """
    analysis = analyse(dataset)
    sections = Sections(analysis)
    contents = {
        "report.html": sections.html(),
        "report.md": sections.markdown(),
        "results.csv": results(analysis),
    }
    for name, text in contents.items():
        write_text(folder / name, text)
    return [folder / name for name in contents]


class Sections(Page):
    """All of the report."""

    def __init__(self, analysis: Analysis) -> None:
        super().__init__(analysis.title)
        _glance(self, analysis)
        _people(self, analysis)
        _primary(self, analysis)
        _secondary(self, analysis)
        _orders(self, analysis)
        _preferences(self, analysis)
        _described(self, analysis)
        _methods(self, analysis)


def _glance(page: Page, analysis: Analysis) -> None:
    """The result in words."""
    outcome = analysis.outcomes[0]
    title = outcome.measure.title
    if outcome.p is None:
        page.paragraph(f"{title}: there are too few values to compare.", "lead")
        return
    found = outcome.p < analysis.alpha
    titles = [cell.title for cell in outcome.cells]
    names = f"{', '.join(titles[:-1])} and {titles[-1]}"
    if len(outcome.cells) == 2:
        first, second = outcome.cells
        result = outcome.comparisons[0].result
        more = "more" if result.mean > 0 else "less"
        verdict = (
            f"{title}: {number(abs(result.mean))} {_of_unit(outcome)}{more} with {second.title} "
            f"than with {first.title}."
            if found
            else f"{title}: no difference was found between {names}."
        )
    else:
        verdict = (
            f"{title}: {names} differ."
            if found
            else f"{title}: no difference was found between {names}."
        )
    page.paragraph(verdict, "lead")
    if not found:
        page.paragraph(
            "That is no proof that there is none: the interval of the difference says how large it "
            "may still be."
        )
    for one in outcome.comparisons:
        page.paragraph(_sentence(outcome, one))


def _sentence(outcome: Outcome, one: Comparison) -> str:
    titles = {cell.condition: cell.title for cell in outcome.cells}
    result = one.result
    text = (
        f"{titles[one.second]} minus {titles[one.first]}: mean difference {number(result.mean)} "
        f"{_of_unit(outcome)}(95 % interval {interval(result.interval)}), "
    )
    exact = ", exact" if result.exact else ""
    if isinstance(result, Paired):
        test = f"Wilcoxon {p_told(one.p)}{exact}, n = {result.n}"
        text += f"{test}, matched rank-biserial {number(result.rank_biserial)}"
    else:
        n = f"n = {result.n[0]} and {result.n[1]}"
        text += f"Mann-Whitney {p_told(one.p)}{exact}, {n}, Cliff's delta {number(result.delta)}"
    return text + (f", Holm {p_told(one.holm)}." if one.holm is not None else ".")


def _of_unit(outcome: Outcome) -> str:
    return "" if outcome.measure.unit == "1" else f"{outcome.measure.unit} "


def _people(page: Page, analysis: Analysis) -> None:
    page.heading("Participants")
    design = "each met all conditions" if analysis.design == "within" else "each met one condition"
    trials = len(analysis.trials)
    page.paragraph(
        f"{len(analysis.counted)} participants count of {analysis.planned} planned; {design}. "
        f"{trials - len(analysis.lost)} of their {trials} trials are complete, "
        f"{len(analysis.repeated) or 'none'} of them repeated."
    )
    if analysis.excluded:
        reasons = {"running": "the session did not end", "withdrawn": "withdrawn"}
        rows = [
            [one.participant, one.status, one.reason or reasons.get(one.status, "not told")]
            for one in analysis.excluded
        ]
        page.table(("Left out", "Status", "Reason"), rows)
    if analysis.lost:
        page.table(
            ("Trial without values", "Condition", "Status", "Reason"),
            [
                [
                    f"{one.participant}, trial {one.trial}",
                    _title(analysis, one.condition),
                    one.status,
                    one.reason or "not told",
                ]
                for one in analysis.lost
            ],
        )
    rows = [
        [outcome.measure.title] + [f"{len(cell.known)} ({cell.missing})" for cell in outcome.cells]
        for outcome in (*analysis.outcomes, *_with_gaps(analysis))
    ]
    page.paragraph("Participants with a value in each condition, and in brackets without one:")
    page.table(("Values (missing)", *(title for _, title in analysis.conditions)), rows, "numbers")


def _with_gaps(analysis: Analysis) -> list[Outcome]:
    """Described measures that lack more than whole trials."""
    lost = {
        name: len({one.participant for one in analysis.lost if one.condition == name})
        for name, _ in analysis.conditions
    }
    return [
        one
        for one in analysis.described
        if any(cell.missing > lost[cell.condition] for cell in one.cells)
    ]


def _title(analysis: Analysis, condition: str) -> str:
    return dict(analysis.conditions).get(condition, condition)


def _primary(page: Page, analysis: Analysis) -> None:
    outcome = analysis.outcomes[0]
    page.heading(f"Primary outcome: {outcome.measure.title.lower()}")
    page.paragraph(outcome.measure.definition, "note")
    within = analysis.design == "within"
    joined = "; lines join the trials of one participant" if within else ""
    page.picture(
        plots.primary(outcome, within),
        f"Every participant{joined}. Diamonds: means with 95 % intervals.",
    )
    page.table(
        _SUMMARY, [_summary_row(cell.title, cell.summary) for cell in outcome.cells], "numbers"
    )
    if outcome.overall is not None:
        one = outcome.overall
        page.paragraph(
            f"{one.test}: {number(one.statistic)} with {one.freedom} degrees of freedom, "
            f"{p_told(one.p)}, effect {number(one.effect)}."
        )
    heads, rows = _test_table([outcome])
    page.table(heads, rows, "numbers")


_SUMMARY = ("", "n", "Mean", "95 % interval", "Median", "Quartiles", "SD")


def _summary_row(title: str, one: Summary | None) -> list[str]:
    if one is None:
        return [title, "0", *[NONE] * 5]
    quartiles = span(one.lower_quartile, one.upper_quartile)
    spread = number(one.sd)
    return [
        *(title, str(one.n), number(one.mean), interval(one.interval)),
        *(number(one.median), quartiles, spread),
    ]


def _test_table(outcomes: Sequence[Outcome]) -> tuple[list[str], list[list[str]]]:
    """All tests of all comparisons."""
    rows = []
    within = True
    for outcome in outcomes:
        titles = {cell.condition: cell.title for cell in outcome.cells}
        for one in outcome.comparisons:
            result = one.result
            name = outcome.measure.title
            if len(outcome.cells) > 2:
                name += f": {titles[one.second]} minus {titles[one.first]}"
            row = [name, number(result.mean), interval(result.interval), p_value(one.p)]
            row.append(p_value(one.holm))
            if isinstance(result, Paired):
                row += [number(result.rank_biserial), number(result.dz)]
                row += [p_value(result.t_p), p_value(result.sign_p), p_value(result.permutation_p)]
            else:
                within = False
                row += [number(result.delta), number(result.d)]
                row += [p_value(result.t_p), p_value(result.permutation_p)]
            rows.append(row)
    heads = ["Difference", "Mean", "95 % interval"]
    if within:
        heads += ["Wilcoxon p", "Holm p", "Rank-biserial", "dz", "t p", "Sign p", "Permutation p"]
    else:
        heads += ["Mann-Whitney p", "Holm p", "Cliff's delta", "d", "Welch t p", "Permutation p"]
    return heads, rows


def _secondary(page: Page, analysis: Analysis) -> None:
    outcomes = analysis.outcomes[1:]
    if not outcomes:
        return
    page.heading("Secondary outcomes")
    within = analysis.design == "within"
    page.picture(plots.secondary(outcomes, within), "Every participant, as above.")
    if len(analysis.conditions) == 2:
        page.picture(
            plots.forest(analysis.outcomes),
            "All outcomes side by side: differences in standard deviations, with 95 % intervals.",
        )
    rows = []
    for outcome in outcomes:
        for cell in outcome.cells:
            rows.append(_summary_row(f"{outcome.measure.title}, {cell.title}", cell.summary))
    page.table(_SUMMARY, rows, "numbers")
    if len(analysis.conditions) > 2:
        page.table(
            ("All conditions", "Test", "p", "Holm p", "Effect"),
            [
                [
                    one.measure.title,
                    one.overall.test,
                    p_value(one.p),
                    p_value(one.holm),
                    number(one.overall.effect),
                ]
                for one in outcomes
                if one.overall is not None
            ],
            "numbers",
        )
    heads, tests = _test_table(outcomes)
    page.table(heads, tests, "numbers")


def _orders(page: Page, analysis: Analysis) -> None:
    if not analysis.orders:
        return
    page.heading("Order")
    effect = analysis.orders[0]
    page.picture(plots.order(analysis, effect), "Values by position. Bars: means of all.")
    two = len(effect.positions) == 2
    heads = ["Outcome", *(f"Mean of trial {at + 1}" for at in range(len(effect.positions)))]
    heads += ["Period p", "Carried over p"] if two else ["Position p"]
    page.table(heads, [_order_row(one, two) for one in analysis.orders], "numbers")
    page.paragraph(
        f"Test: {effect.test}. A period effect, such as learning, does not bias the comparison of "
        "conditions, since orders are balanced; what is carried over may.",
        "note",
    )


def _order_row(one: OrderEffect, two: bool) -> list[str]:
    means = [NONE if at is None else number(at.mean) for at in one.positions]
    row = [one.measure.title, *means, p_value(one.period_p)]
    return [*row, p_value(one.carry_p)] if two else row


def _preferences(page: Page, analysis: Analysis) -> None:
    if not analysis.preferences:
        return
    page.heading("Preference")
    page.picture(plots.preference(analysis), "One mark per participant.")
    for one in analysis.preferences:
        told = ", ".join(f"{title} {count}" for title, count in one.counts)
        test = "sign test" if len(one.counts) == 2 else "chi-squared test of equal shares"
        strength = (
            "" if one.strength is None else f" Median strength {number(one.strength.median)} of 5."
        )
        page.paragraph(f"{told}; {test} {p_told(one.p)}.{strength}")


def _described(page: Page, analysis: Analysis) -> None:
    if not analysis.described:
        return
    page.heading("Further measures")
    page.paragraph("Described, not tested: mean, and median in brackets.", "note")
    rows = []
    for outcome in analysis.described:
        cells = [
            NONE
            if cell.summary is None
            else f"{number(cell.summary.mean)} ({number(cell.summary.median)})"
            for cell in outcome.cells
        ]
        rows.append([outcome.measure.title, outcome.measure.unit, *cells])
    page.table(("Measure", "Unit", *(title for _, title in analysis.conditions)), rows, "numbers")


def _methods(page: Page, analysis: Analysis) -> None:
    page.heading("How this was computed")
    page.paragraph(
        f"Tests are two-sided, alpha = {analysis.alpha:g}. The primary outcome is not corrected; "
        "secondary outcomes are, by Holm. Rank tests are exact for up to 50 values, ties included. "
        "Intervals are bias-corrected and accelerated bootstrap intervals of the mean (9,999 "
        "samples, fixed seed). Missing values are left out pair by pair, never replaced. "
        f"List of assignments: SHA-256 {analysis.allocation}."
    )
    page.table(
        ("Measure", "Unit", "Definition", "Source"),
        [
            [one.measure.title, one.measure.unit, one.measure.definition, one.measure.source]
            for one in (*analysis.outcomes, *analysis.described)
        ],
        "words",
    )


def results(analysis: Analysis) -> str:
    """All figures of the report as CSV, one row per comparison."""
    heads = (
        *("measure", "role", "unit", "first", "second", "n_first", "n_second", "mean_first"),
        *("mean_second", "median_first", "median_second", "difference", "low", "high", "p"),
        *("holm_p", "effect", "standardised"),
    )
    rows: list[list[tables.Cellular]] = []
    for outcome in analysis.outcomes:
        cells = {cell.condition: cell.summary for cell in outcome.cells}
        for one in outcome.comparisons:
            pair, result = (cells[one.first], cells[one.second]), one.result
            found = result.interval
            rows.append(
                [
                    *(outcome.measure.name, outcome.role, outcome.measure.unit),
                    *(one.first, one.second),
                    *(0 if cell is None else cell.n for cell in pair),
                    *(None if cell is None else cell.mean for cell in pair),
                    *(None if cell is None else cell.median for cell in pair),
                    result.mean,
                    *((None, None) if found is None else (found.low, found.high)),
                    *(one.p, one.holm),
                    result.rank_biserial if isinstance(result, Paired) else result.delta,
                    result.dz if isinstance(result, Paired) else result.d,
                ]
            )
    return tables.csv_text(heads, rows)
