"""The report of a study: one HTML file without network, and the same as Markdown and CSV.

`write` makes them of the tables alone. The same tables give the same bytes: there is no date in
them, and everything drawn comes from fixed seeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from usarsim_report.page import Page
from usarsim_report.statistics import Paired, Summary, rejects
from usarsim_report.wording import (
    NONE,
    comparative,
    counted,
    interval,
    number,
    p_told,
    p_value,
    span,
    unit_told,
    with_unit,
)
from usarsim_server.base.csv_files import Cellular, csv_text
from usarsim_server.base.files import write_text
from usarsim_study import plots
from usarsim_study.analysis import Analysis, Comparison, OrderEffect, Outcome, analyse
from usarsim_study.dataset import Dataset
from usarsim_study.measures import Measure
from usarsim_study.misread import CURE


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
        _made(self, analysis)
        _glance(self, analysis)
        _logs(self, analysis)
        _words(self, analysis)
        _people(self, analysis)
        if any(_known(one) for one in analysis.outcomes):
            _primary(self, analysis)
            _secondary(self, analysis)
        _orders(self, analysis)
        _preferences(self, analysis)
        _described(self, analysis)
        _methods(self, analysis)


def _made(page: Page, analysis: Analysis) -> None:
    """Whether those who count are people."""
    made, all_ = len(analysis.scripted), len(analysis.counted)
    if not made:
        return
    if made == all_:
        who = f"Scripted: {counted(made, 'participant', 'participants')} made by code, no people."
        rest = "What follows tries the study out, and says nothing about people."
    else:
        codes = ", ".join(one.participant for one in analysis.scripted)
        who = f"Partly scripted: {made} of {all_} participants were made by code ({codes})."
        rest = "What follows mixes them with people, and says nothing about people alone."
    page.paragraph(f"{who} {rest}", "warning")


def _logs(page: Page, analysis: Analysis) -> None:
    """What logs of earlier versions lack."""
    which = (
        "Teleoperation share, teleoperations, interaction time, neglect time, attention demand "
        "and fan-out"
    )
    all_ = len(analysis.trials)
    if analysis.inferred:
        page.paragraph(
            f"Warning: in {len(analysis.inferred)} of {counted(all_, 'trial', 'trials')} the log, "
            "of an earlier version, has no command where operators let go of the keys or the "
            f"stick. {which} of these trials go by what the operators' pages said instead.",
            "warning",
        )
    if analysis.untold:
        page.paragraph(
            f"Warning: the tables of {len(analysis.untold)} of {counted(all_, 'trial', 'trials')} "
            f"were exported by an earlier version. {which} may count on after operators had let "
            "go; export them again from the folder of the study.",
            "warning",
        )


def _glance(page: Page, analysis: Analysis) -> None:
    """The result in words."""
    outcome = analysis.outcomes[0]
    title = outcome.measure.title
    if not analysis.counted:
        page.paragraph("Nobody has taken part to the end: there is nothing to tell yet.", "lead")
        return
    if outcome.p is None:
        page.paragraph(f"{title}: there are too few values to compare.", "lead")
        return
    found = rejects(outcome.p, analysis.alpha)
    titles = [cell.title for cell in outcome.cells]
    names = f"{', '.join(titles[:-1])} and {titles[-1]}"
    if not found:
        page.paragraph(f"{title}: no difference was found between {names}.", "lead")
    elif len(outcome.cells) == 2:
        page.paragraph(f"{title}: {_direction(outcome, outcome.comparisons[0])}.", "lead")
    else:
        page.paragraph(f"{title}: {names} differ.", "lead")
    for text in _cautions(outcome, analysis.alpha, found):
        page.paragraph(text)
    for one in outcome.comparisons:
        page.paragraph(_sentence(outcome, one, analysis.alpha))


def _direction(outcome: Outcome, one: Comparison) -> str:
    """Which condition has more by the test that decides, and how much if the mean agrees."""
    first, second = (_cell_title(outcome, name) for name in (one.first, one.second))
    result, unit = one.result, outcome.measure.unit
    text = f"{comparative(result.direction, unit)} with {second} than with {first}"
    if result.mean * result.direction > 0.0:
        return f"{number(abs(result.mean))}{unit_told(unit)} {text}"
    if not isinstance(result, Paired):
        share = 0.5 * (1.0 + abs(result.delta))
        return f"{text} ({100.0 * share:.0f} % of all pairs of one participant of each)"
    agree = result.positive if result.direction > 0 else result.negative
    if 2 * agree <= result.changed:
        return f"{text}, by the ranks of the differences"
    return f"{text} ({agree} of {counted(result.n, 'pair', 'pairs')})"


def _cautions(outcome: Outcome, alpha: float, found: bool) -> list[str]:
    """What has to be said where figures of one outcome seem to contradict each other."""
    told = []
    ends = [one.result.interval for one in outcome.comparisons]
    two = len(outcome.cells) == 2
    if not found:
        text = "That is no proof that there is none"
        if any(one is not None for one in ends):
            text += (
                ": the interval of the difference says how large it may still be"
                if two
                else ": the intervals of the differences say how large they may still be"
            )
        told.append(f"{text}.")
        least = outcome.comparisons[0].result.least_p
        if two and not rejects(least, alpha):
            told.append(
                "So few values that differ could not have shown any: their smallest p is "
                f"{p_value(least, alpha)}."
            )
        if two and ends[0] is not None and not ends[0].holds(0.0):
            told.append(
                "The interval of the mean difference does not include 0. The test that decides "
                "goes by ranks, and it does not reject."
            )
        if not two and any(rejects(_judged(one), alpha) for one in outcome.comparisons):
            told.append("Single pairs below are not judged, since the test of all finds nothing.")
        return told
    if two:
        one = outcome.comparisons[0]
        told += _contrary(outcome, one)
        if not told and one.result.mean == 0.0:
            told.append("The mean difference is 0: the ranks of the values differ, their mean not.")
        elif not told and ends[0] is not None and ends[0].holds(0.0):
            told.append(
                "The interval of the mean difference includes 0. The test that decides goes by "
                "ranks, and it rejects."
            )
        return told
    if not any(rejects(_judged(one), alpha) for one in outcome.comparisons):
        told.append("Which of them differ cannot be told: no single pair does after correction.")
    for one in outcome.comparisons:
        if rejects(_judged(one), alpha):
            told += _contrary(outcome, one)
    return told


def _judged(one: Comparison) -> float:
    return one.p if one.holm is None else one.holm


def _contrary(outcome: Outcome, one: Comparison) -> list[str]:
    """That the mean points the other way than the test that decides, and what turns it."""
    if not one.contrary:
        return []
    unit, second = outcome.measure.unit, _cell_title(outcome, one.second)
    first, result = _cell_title(outcome, one.first), one.result

    def told(mean: float) -> str:
        size = f"{number(abs(mean))}{unit_told(unit)}"
        return f"{size} {comparative(mean, unit)} with {second}"

    text = (
        f"{outcome.measure.title}: the mean points the other way than the ranks do, "
        f"{told(result.mean)} than with {first}."
    )
    turning = one.turning
    if turning is None:
        return [f"{text} It is not one value alone that turns it."]
    value = f"{number(turning.value)}{unit_told(unit)}"
    which = (
        f"The pair of participant {turning.participant} (difference {value}) turns it"
        if isinstance(result, Paired)
        else f"The value of participant {turning.participant} ({value}) turns it"
    )
    return [f"{text} {which}: without it the mean is {told(turning.mean)}."]


def _cell_title(outcome: Outcome, condition: str) -> str:
    return next(cell.title for cell in outcome.cells if cell.condition == condition)


def _sentence(outcome: Outcome, one: Comparison, alpha: float) -> str:
    result = one.result
    first, second = (_cell_title(outcome, name) for name in (one.first, one.second))
    known = (
        "no interval" if result.interval is None else f"95 % interval {interval(result.interval)}"
    )
    text = (
        f"{second} minus {first}: mean difference {number(result.mean)}"
        f"{unit_told(outcome.measure.unit)} ({known}), "
    )
    exact = ", exact" if result.exact else ""
    if isinstance(result, Paired):
        n = f"n = {result.changed}"
        if equal := result.n - result.changed:
            n += f" ({counted(equal, 'more pair is', 'more pairs are')} equal)"
        text += f"Wilcoxon {p_told(one.p, alpha)}{exact}, {n}, W = {result.w:g}, "
        text += f"matched rank-biserial {number(result.rank_biserial)}, "
        text += f"sign test {p_told(result.sign_p, alpha)}"
    else:
        text += f"Mann-Whitney {p_told(one.p, alpha)}{exact}, n = {result.n[0]} and {result.n[1]}, "
        text += f"U = {result.u:g}, Cliff's delta {number(result.delta)}"
    return text + (f", Holm {p_told(one.holm, alpha)}." if one.holm is not None else ".")


def _words(page: Page, analysis: Analysis) -> None:
    """Which words of the tables other programs lose."""
    for column, words in analysis.misread.items():
        told = ", ".join(words)
        page.paragraph(
            f"Warning: in the column {column} of the tables pandas reads {told} as missing, and R "
            f"reads NA so, quoted or not. This report does not; elsewhere {CURE}."
        )


def _people(page: Page, analysis: Analysis) -> None:
    page.heading("Participants")
    met = "all conditions" if analysis.design == "within" else "one condition"
    trials = len(analysis.trials)
    count = counted(len(analysis.counted), "participant counts", "participants count")
    repeated = counted(len(analysis.repeated), "trial was", "trials were")
    page.paragraph(
        f"{count} of {analysis.planned} planned; each was to meet {met}. "
        f"{trials - len(analysis.lost)} of {counted(trials, 'trial is', 'trials are')} complete; "
        f"{repeated if analysis.repeated else 'no trial was'} repeated."
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
    if not analysis.counted:
        return
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


def _known(outcome: Outcome) -> bool:
    """Whether anybody has a value."""
    return any(cell.known for cell in outcome.cells)


def _named(measure: Measure) -> str:
    """A measure with its unit."""
    return with_unit(measure.title, measure.unit)


def _title(analysis: Analysis, condition: str) -> str:
    return dict(analysis.conditions).get(condition, condition)


def _primary(page: Page, analysis: Analysis) -> None:
    outcome = analysis.outcomes[0]
    page.heading(f"Primary outcome: {outcome.measure.title}")
    page.paragraph(outcome.measure.definition, "note")
    within = analysis.design == "within"
    joined = "; lines join the trials of one participant" if within else ""
    if _known(outcome):
        page.picture(
            plots.primary(outcome, within),
            f"Every participant{joined}. Diamonds: {_means(outcome)}.",
        )
    heads = (_named(outcome.measure), *_SUMMARY[1:])
    page.table(heads, [_summary_row(cell.title, cell.summary) for cell in outcome.cells], "numbers")
    if outcome.overall is not None:
        one = outcome.overall
        page.paragraph(
            f"{one.test}: {number(one.statistic)} with {one.freedom} degrees of freedom, "
            f"{p_told(one.p, analysis.alpha)}, effect {number(one.effect)}."
        )
    _tests(page, [outcome], analysis.alpha)


def _means(outcome: Outcome) -> str:
    """What diamonds show; few values have no interval."""
    summaries = [cell.summary for cell in outcome.cells]
    known = any(one is not None and one.interval is not None for one in summaries)
    return "means with 95 % intervals" if known else "means"


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


def _tests(page: Page, outcomes: Sequence[Outcome], alpha: float) -> None:
    """The table of all tests, if any could be made."""
    heads, rows = _test_table(outcomes, alpha)
    if rows:
        page.table(heads, rows, "numbers")


def _test_table(outcomes: Sequence[Outcome], alpha: float) -> tuple[list[str], list[list[str]]]:
    """All tests of all comparisons."""
    rows = []
    within = True
    for outcome in outcomes:
        for one in outcome.comparisons:
            result = one.result
            name = _named(outcome.measure)
            if len(outcome.cells) > 2:
                first, second = (_cell_title(outcome, at) for at in (one.first, one.second))
                name += f": {second} minus {first}"
            row = [name, number(result.mean), interval(result.interval)]
            if isinstance(result, Paired):
                effects = [number(result.rank_biserial), number(result.dz)]
                tests = [result.t_p, result.sign_p, result.permutation_p]
            else:
                within = False
                effects = [number(result.delta), number(result.d)]
                tests = [result.t_p, result.permutation_p]
            row += [p_value(one.p, alpha), p_value(one.holm, alpha), *effects]
            row += [p_value(p, alpha) for p in tests]
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
    known = [one for one in outcomes if _known(one)]
    if unknown := [one.measure.title for one in outcomes if not _known(one)]:
        page.paragraph(f"Without any value, and not below: {', '.join(unknown)}.", "note")
    if known:
        page.picture(plots.secondary(known, within), "Every participant, as above.")
    if len(analysis.conditions) == 2:
        intervals = [
            one.result.interval for outcome in analysis.outcomes for one in outcome.comparisons
        ]
        page.picture(
            plots.forest(analysis.outcomes),
            "All outcomes side by side: differences in standard deviations"
            + (", with 95 % intervals." if any(intervals) else "."),
        )
    rows = []
    for outcome in known:
        for cell in outcome.cells:
            rows.append(_summary_row(f"{_named(outcome.measure)}, {cell.title}", cell.summary))
    if rows:
        page.table(_SUMMARY, rows, "numbers")
    if len(analysis.conditions) > 2:
        page.table(
            ("All conditions", "Test", "p", "Holm p", "Effect"),
            [
                [
                    one.measure.title,
                    one.overall.test,
                    p_value(one.p, analysis.alpha),
                    p_value(one.holm, analysis.alpha),
                    number(one.overall.effect),
                ]
                for one in outcomes
                if one.overall is not None
            ],
            "numbers",
        )
    _tests(page, outcomes, analysis.alpha)
    for outcome in outcomes:
        for one in outcome.comparisons:
            if rejects(_judged(one), analysis.alpha):
                for text in _contrary(outcome, one):
                    page.paragraph(text, "note")


def _orders(page: Page, analysis: Analysis) -> None:
    if not analysis.orders:
        return
    page.heading("Order")
    effect = analysis.orders[0]
    page.picture(plots.order(analysis, effect), "Values by position. Bars: means of all.")
    two = len(effect.positions) == 2
    heads = ["Outcome", *(f"Mean of trial {at + 1}" for at in range(len(effect.positions)))]
    heads += ["Period p", "Carried over p"] if two else ["Position p"]
    rows = [_order_row(one, two, analysis.alpha) for one in analysis.orders]
    page.table(heads, rows, "numbers")
    tests = list(dict.fromkeys(one.test for one in analysis.orders if one.test))
    test = f"Test: {tests[0]}." if tests else "There are too few values for a test."
    page.paragraph(f"{test} {_balance(analysis, effect)}", "note")


def _balance(analysis: Analysis, effect: OrderEffect) -> str:
    """Whether a period effect can bias the comparison, by the orders of those who count."""
    carried = "What is carried over may."
    if effect.balanced:
        return (
            "A period effect, such as learning, does not bias the comparison of conditions, since "
            f"those who count met them in balanced orders. {carried}"
        )
    told = ", ".join(
        f"{' then '.join(_title(analysis, name) for name in order)}: {count}"
        for order, count in effect.orders
    )
    return (
        f"Orders are not balanced among those who count ({told}), so a period effect, such as "
        "learning, may bias the comparison of conditions, and so may what is carried over."
    )


def _order_row(one: OrderEffect, two: bool, alpha: float) -> list[str]:
    means = [NONE if at is None else number(at.mean) for at in one.positions]
    row = [_named(one.measure), *means, p_value(one.period_p, alpha)]
    return [*row, p_value(one.carry_p, alpha)] if two else row


def _preferences(page: Page, analysis: Analysis) -> None:
    if not analysis.preferences:
        return
    page.heading("Preference")
    page.picture(plots.preference(analysis), "One mark per participant.")
    for one in analysis.preferences:
        told = ", ".join(f"{title} {count}" for title, count in one.counts)
        test = "sign test" if len(one.counts) == 2 else "chi-squared test of equal shares"
        strength = "" if one.strength is None else f" Median strength {one.strength.median:g} of 5."
        tested = "" if one.p is None else f"; {test} {p_told(one.p, analysis.alpha)}"
        page.paragraph(f"{told}{tested}.{strength}")


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
        rows.append([_named(outcome.measure), *cells])
    page.table(("Measure", *(title for _, title in analysis.conditions)), rows, "numbers")


def _methods(page: Page, analysis: Analysis) -> None:
    page.heading("How this was computed")
    page.paragraph(
        f"Tests are two-sided, alpha = {analysis.alpha:g}. The primary outcome is not corrected; "
        "secondary outcomes are, by Holm. Rank tests of two conditions are exact for up to 50 "
        "values, ties included; Friedman's and Kruskal and Wallis's go by the chi-squared "
        "distribution. Two values, two differences, or a difference and zero, are equal if they "
        "differ by less than 1e-9 of the larger value measured. "
        "Intervals are bias-corrected and accelerated bootstrap intervals of the mean (9,999 "
        "samples, fixed seed). Missing values are left out pair by pair, never replaced. "
        f"List of assignments: SHA-256 {analysis.allocation}."
    )
    page.table(
        ("Measure", "Definition", "Source"),
        [
            [_named(one.measure), one.measure.definition, one.measure.source]
            for one in (*analysis.outcomes, *analysis.described)
        ],
        "words",
    )


def results(analysis: Analysis) -> str:
    """All figures of the report as CSV, one row per comparison."""
    heads = (
        *("measure", "role", "unit", "first", "second", "n_first", "n_second", "mean_first"),
        *("mean_second", "median_first", "median_second", "difference", "low", "high", "p"),
        *("holm_p", "effect", "standardised", "n_scripted"),
    )
    rows: list[list[Cellular]] = []
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
                    len(analysis.scripted),
                ]
            )
    return csv_text(heads, rows)
