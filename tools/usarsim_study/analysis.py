"""What the tables of a study say: who counts, what is missing, differences, tests, order effects.

The primary outcome is tested as it is; secondary outcomes are corrected by Holm over all of them;
further measures are described and not tested. Two conditions are compared by Wilcoxon's test (by
Mann and Whitney's between participants), more by Friedman's (Kruskal and Wallis's), then in pairs,
corrected by Holm.

Order effects of a crossover follow M. Hills, P. Armitage, The two-period cross-over clinical trial,
British Journal of Clinical Pharmacology 8 (1979) 7-20: between the participants of the two orders,
differences tell of the period, sums of what is carried over.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import fmean, median

from scipy import stats

from usarsim_report.statistics import (
    Paired,
    Several,
    Summary,
    Unpaired,
    differences,
    holm,
    paired,
    rank_sum,
    several_paired,
    several_unpaired,
    summary,
    unpaired,
)
from usarsim_study.dataset import Dataset, ParticipantRow, TrialRow, misread_words
from usarsim_study.errors import StudyError
from usarsim_study.measures import MEASURES, Measure


@dataclass(frozen=True, slots=True)
class Cell:
    """One measure in one condition.

    Attributes:
        condition, title: its name, and what people read.
        values: by participant, None where it is missing.
    """

    condition: str
    title: str
    values: dict[str, float | None]
    summary: Summary | None

    @property
    def known(self) -> list[float]:
        """Values that are there."""
        return [one for one in self.values.values() if one is not None]

    @property
    def missing(self) -> int:
        """How many are not."""
        return len(self.values) - len(self.known)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Second less first condition.

    Attributes:
        p: of the test that decides. holm: corrected within the measure, or over measures.
        turning: where the mean points the other way than that test: the value without which it
            would not; None if there is no such value.
    """

    first: str
    second: str
    result: Paired | Unpaired
    p: float
    holm: float | None = None
    turning: Turning | None = None

    @property
    def contrary(self) -> bool:
        """Whether the mean points the other way than the ranks."""
        return self.result.mean * self.result.direction < 0.0


@dataclass(frozen=True, slots=True)
class Turning:
    """The value that turns the mean of a difference round.

    Attributes:
        participant: whose it is. value: the difference of the pair, or the value of one condition.
        mean: of the difference, without it.
    """

    participant: str
    value: float
    mean: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """A measure in all conditions.

    Attributes:
        role: `primary`, `secondary` or `described`.
        comparisons: of all pairs of conditions; none for a described measure.
        overall: of more than two conditions.
        p, holm: of the test that decides; corrected over secondary outcomes.
    """

    measure: Measure
    role: str
    cells: tuple[Cell, ...]
    comparisons: tuple[Comparison, ...] = ()
    overall: Several | None = None
    p: float | None = None
    holm: float | None = None


@dataclass(frozen=True, slots=True)
class OrderEffect:
    """Whether the position of a trial mattered.

    Attributes:
        test: which one; empty: none could be made.
        period_p, carry_p: None: cannot be computed.
        orders: participants who have all values, by the conditions in the order that they met.
        balanced: whether each condition stands in each position equally often among them.
    """

    measure: Measure
    test: str
    positions: tuple[Summary | None, ...]
    period_p: float | None
    carry_p: float | None
    orders: tuple[tuple[tuple[str, ...], int], ...]
    balanced: bool


@dataclass(frozen=True, slots=True)
class Preference:
    """The forced choice of one form. counts: by title of the condition."""

    form: str
    counts: tuple[tuple[str, int], ...]
    strength: Summary | None
    p: float | None


@dataclass(frozen=True, slots=True)
class Analysis:
    """Everything a report tells.

    Attributes:
        counted: participants who count, in order. excluded: the others, with reasons.
        lost: trials of those who count that have no values. repeated: that have more than one
            attempt.
        outcomes: the primary one, then secondary ones. described: all others that have values.
        misread: by column of the tables the words that pandas and R read as missing values.
        scripted: of those who count, who were made by code.
        inferred, untold: trials of those who count whose logs lack commands where operators let
            go, and of which nobody knows.
    """

    title: str
    design: str
    alpha: float
    planned: int
    allocation: str
    conditions: tuple[tuple[str, str], ...]
    counted: tuple[ParticipantRow, ...]
    excluded: tuple[ParticipantRow, ...]
    lost: tuple[TrialRow, ...]
    repeated: tuple[TrialRow, ...]
    trials: tuple[TrialRow, ...]
    outcomes: tuple[Outcome, ...]
    described: tuple[Outcome, ...]
    orders: tuple[OrderEffect, ...]
    preferences: tuple[Preference, ...]
    misread: dict[str, tuple[str, ...]]
    scripted: tuple[ParticipantRow, ...]
    inferred: tuple[TrialRow, ...]
    untold: tuple[TrialRow, ...]


def analyse(dataset: Dataset) -> Analysis:
    """Judge the tables of a study.

    Raises:
        StudyError: they name a measure that does not exist.
    """
    about = dataset.about
    names = [about["primary"], *about["secondary"]]
    for name in names:
        if name not in MEASURES:
            raise StudyError(f"outcome {name!r} is no measure (mend datapackage.json)")
    counted = tuple(one for one in dataset.participants if one.status == "complete")
    codes = {one.participant for one in counted}
    trials = tuple(one for one in dataset.trials if one.participant in codes)
    conditions = tuple((one["name"], one["title"]) for one in about["conditions"])
    within = about["design"] == "within"

    outcomes = [
        _outcome(MEASURES[name], conditions, trials, within, "secondary" if place else "primary")
        for place, name in enumerate(names)
    ]
    corrected = holm([one.p for one in outcomes[1:]])
    outcomes[1:] = [_corrected(one, p) for one, p in zip(outcomes[1:], corrected, strict=True)]
    described = [
        _outcome(one, conditions, trials, within, "described")
        for name, one in MEASURES.items()
        if name not in names and any(trial.values.get(name) is not None for trial in trials)
    ]
    return Analysis(
        title=str(about["title"]),
        design=str(about["design"]),
        alpha=float(about["alpha"]),
        planned=int(about["planned"]),
        allocation=str(about["allocation"]),
        conditions=conditions,
        counted=counted,
        excluded=tuple(one for one in dataset.participants if one.participant not in codes),
        lost=tuple(one for one in trials if one.status != "complete"),
        repeated=tuple(one for one in trials if one.attempt > 1),
        trials=trials,
        outcomes=tuple(outcomes),
        described=tuple(described),
        orders=tuple(
            found
            for one in outcomes
            for found in [_order_effect(one.measure, conditions, trials)]
            if found is not None
        )
        if within
        else (),
        preferences=_preferences(dataset, codes, conditions),
        misread=misread_words(dataset),
        scripted=tuple(one for one in counted if one.scripted),
        inferred=tuple(one for one in trials if one.inferred_stops),
        untold=tuple(
            one for one in trials if one.status == "complete" and one.inferred_stops is None
        ),
    )


def _outcome(
    measure: Measure,
    conditions: tuple[tuple[str, str], ...],
    trials: tuple[TrialRow, ...],
    within: bool,
    role: str,
) -> Outcome:
    cells = []
    for name, title in conditions:
        values: dict[str, list[float | None]] = {}
        for one in trials:
            if one.condition == name:
                values.setdefault(one.participant, []).append(one.values.get(measure.name))
        means = {code: _mean(found) for code, found in values.items()}
        known = [one for one in means.values() if one is not None]
        cells.append(Cell(name, title, means, summary(known)))
    outcome = Outcome(measure, role, tuple(cells))
    return outcome if role == "described" else _tested(outcome, within)


def _mean(values: list[float | None]) -> float | None:
    known = [one for one in values if one is not None]
    return fmean(known) if known else None


def _tested(outcome: Outcome, within: bool) -> Outcome:
    comparisons: list[Comparison] = []
    for one, other in combinations(outcome.cells, 2):
        if within:
            pairs = [
                (value, across)
                for code, value in one.values.items()
                if value is not None and (across := other.values.get(code)) is not None
            ]
            first, second = [value for value, _ in pairs], [across for _, across in pairs]
            result: Paired | Unpaired | None = paired(first, second)
        else:
            result = unpaired(one.known, other.known)
        if result is not None:
            p = result.wilcoxon_p if isinstance(result, Paired) else result.mann_whitney_p
            found = Comparison(one.condition, other.condition, result, p)
            if found.contrary:
                find = _turning_pair if within else _turning_value
                found = replace(found, turning=find(one, other, result.direction))
            comparisons.append(found)
    overall = None
    if len(outcome.cells) > 2:
        overall = _several(outcome.cells, within)
        inner = holm([one.p for one in comparisons])
        comparisons = [replace(one, holm=p) for one, p in zip(comparisons, inner, strict=True)]
        p_value = None if overall is None else overall.p
    else:
        p_value = comparisons[0].p if comparisons else None
    return replace(outcome, comparisons=tuple(comparisons), overall=overall, p=p_value)


def _turning_pair(first: Cell, second: Cell, direction: int) -> Turning | None:
    """Of the pairs without which the mean points in a direction, the one that differs most."""
    found = {
        code: across - value
        for code, value in first.values.items()
        if value is not None and (across := second.values.get(code)) is not None
    }
    means = {
        code: fmean(other for name, other in found.items() if name != code)
        for code in found
        if len(found) > 1
    }
    turning = [Turning(code, found[code], mean) for code, mean in means.items()]
    return _most_different(turning, direction, 0.0)


def _turning_value(first: Cell, second: Cell, direction: int) -> Turning | None:
    """The same of single values: the one that lies furthest from the median of all."""
    turning = []
    for cell in (first, second):
        for code, value in cell.values.items():
            if value is not None and len(cell.known) > 1:
                rest = [one for name, one in cell.values.items() if name != code]
                mean, other = _mean(rest), _mean([*(second if cell is first else first).known])
                if mean is not None and other is not None:
                    difference = other - mean if cell is first else mean - other
                    turning.append(Turning(code, value, difference))
    return _most_different(turning, direction, median([*first.known, *second.known]))


def _most_different(found: Sequence[Turning], direction: int, middle: float) -> Turning | None:
    turning = [one for one in found if one.mean * direction > 0.0]
    return max(turning, key=lambda one: abs(one.value - middle), default=None)


def _several(cells: tuple[Cell, ...], within: bool) -> Several | None:
    if not within:
        return several_unpaired([one.known for one in cells])
    rows = [[cell.values.get(code) for cell in cells] for code in cells[0].values]
    return several_paired(
        [[one for one in row if one is not None] for row in rows if None not in row]
    )


def _corrected(outcome: Outcome, p: float | None) -> Outcome:
    comparisons = outcome.comparisons
    if len(outcome.cells) == 2:
        comparisons = tuple(replace(one, holm=p) for one in comparisons)
    return replace(outcome, holm=p, comparisons=comparisons)


def _order_effect(
    measure: Measure, conditions: tuple[tuple[str, str], ...], trials: tuple[TrialRow, ...]
) -> OrderEffect | None:
    """Of one measure, of the participants who have all trials."""
    by_code: dict[str, dict[int, TrialRow]] = {}
    for one in trials:
        by_code.setdefault(one.participant, {})[one.trial] = one
    count = max((one.trial for one in trials), default=0)
    rows: list[tuple[tuple[str, ...], list[float]]] = []
    for mine in by_code.values():
        values = [mine[at].values.get(measure.name) for at in sorted(mine)]
        known = [one for one in values if one is not None]
        if len(known) == count:
            rows.append((tuple(mine[at].condition for at in sorted(mine)), known))
    if count < 2 or len(rows) < 2:
        return None
    orders = Counter(order for order, _ in rows)
    places = Counter((at, name) for order in orders.elements() for at, name in enumerate(order))
    names = [name for name, _ in conditions]
    often = {places[at, name] for at in range(count) for name in names}
    effect = OrderEffect(
        measure,
        "",
        tuple(summary([values[at] for _, values in rows]) for at in range(count)),
        None,
        None,
        tuple(sorted(orders.items(), key=lambda one: [names.index(name) for name in one[0]])),
        len(often) == 1,
    )
    if count > 2:
        found = several_paired([values for _, values in rows])
        if found is None:
            return effect
        return replace(effect, test="Friedman's test over positions", period_p=found.p)
    groups = [
        [values for order, values in rows if (order[0] == names[0]) is it] for it in (True, False)
    ]
    if not all(groups):
        return effect
    # Second less first condition: what comes second is the second condition in one group only.
    first = [*(a for a, _ in groups[0]), *(b for _, b in groups[1])]
    second = [*(b for _, b in groups[0]), *(a for a, _ in groups[1])]
    apart = differences(first, second)
    together = differences([-one for one in first], second)
    at = len(groups[0])
    return replace(
        effect,
        test="Mann and Whitney's test between orders",
        period_p=rank_sum(apart[:at], apart[at:])[1],
        carry_p=rank_sum(together[:at], together[at:])[1],
    )


def _preferences(
    dataset: Dataset, codes: set[str], conditions: tuple[tuple[str, str], ...]
) -> tuple[Preference, ...]:
    """Forced choices; with two conditions the sign test tells of them."""
    rows = [
        one for one in dataset.answers if one.form_kind == "preference" and one.participant in codes
    ]
    found = []
    for form in dict.fromkeys(one.form for one in rows):
        mine = [one for one in rows if one.form == form]
        chosen = Counter(one.answer for one in mine if one.item == "preferred")
        strengths = [
            one.number for one in mine if one.item == "strength" and one.number is not None
        ]
        total = sum(chosen.values())
        p = None
        if total and len(conditions) == 2:
            p = float(stats.binomtest(chosen[conditions[1][0]], total).pvalue)
        elif total:
            p = float(stats.chisquare([chosen[name] for name, _ in conditions]).pvalue)
        counts = tuple((title, chosen[name]) for name, title in conditions)
        found.append(Preference(form, counts, summary(strengths), p))
    return tuple(found)
