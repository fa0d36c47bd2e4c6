"""Every measure of a trial: `MEASURES` has the declarations, `compute` the values.

A measure is a function of a `Trial` and of a `Part` of its people and robots; to add one, declare
it in one of these files. Missing is None, never 0: a trial that did not end as it should has no
value at all, and a measure whose records nobody logged has none either.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from usarsim_study.measures import answers, attention, driving, system, victims
from usarsim_study.measures.base import DECLARED, Level, Measure, Part
from usarsim_study.trial import Trial

__all__ = ["MEASURES", "Measure", "Part", "Value", "compute", "markdown", "names", "team"]

_FILES = [one.__name__ for one in (victims, attention, driving, system, answers)]
MEASURES = dict(sorted(DECLARED.items(), key=lambda one: _FILES.index(one[1].function.__module__)))
"""All measures by name, in the order of tables."""


@dataclass(frozen=True, slots=True)
class Value:
    """A value of a measure. who: name of the operator or robot; empty for the team."""

    measure: str
    level: Level
    who: str
    value: float | None


def names() -> tuple[str, ...]:
    """Names of all measures."""
    return tuple(MEASURES)


def compute(trial: Trial) -> Iterator[Value]:
    """All values of a trial: the team's, then those of each operator and robot."""
    for one in MEASURES.values():
        for level, who, part in _parts(trial, one):
            value = one.function(trial, part) if trial.complete else None
            yield Value(one.name, level, who, value)


def team(trial: Trial) -> dict[str, float | None]:
    """The team's values by measure."""
    return {one.measure: one.value for one in compute(trial) if one.level == "team"}


def _parts(trial: Trial, measure: Measure) -> Iterator[tuple[Level, str, Part]]:
    operators, robots = frozenset(trial.operators), frozenset(trial.robots)
    yield "team", "", Part(operators, robots)
    for level in measure.by:
        for who in trial.operators if level == "operator" else trial.robots:
            if level == "operator":
                yield level, who, Part(frozenset({who}), robots, whole=False)
            else:
                yield level, who, Part(operators, frozenset({who}))


def markdown() -> str:
    """The table of all measures for a page."""
    rows = ["| Measure | Unit | Definition | Also by | Source |", "|---|---|---|---|---|"]
    for one in MEASURES.values():
        by = ", ".join(one.by) + (" (adds up)" if one.by and one.adds else "")
        rows.append(f"| `{one.name}` | {one.unit} | {one.definition} | {by} | {one.source} |")
    return "\n".join(rows) + "\n"
