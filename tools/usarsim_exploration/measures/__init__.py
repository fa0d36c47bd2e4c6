"""What a run is judged by, from its history alone: `MEASURES` says how, `measure` computes.

To add a measure, declare it in one of these files. Missing is None, never 0 or the last step: a
goal that was not reached has no time.
"""

from __future__ import annotations

from usarsim_exploration.history import History
from usarsim_exploration.measures import coverage, reality, talk, work
from usarsim_exploration.measures.base import DECLARED, Measure

__all__ = ["MEASURES", "Measure", "markdown", "measure"]

_FILES = [one.__name__ for one in (coverage, work, talk, reality)]
MEASURES = dict(
    sorted(
        DECLARED.items(),
        key=lambda one: _FILES.index(
            getattr(one[1].function, "func", one[1].function).__module__,
        ),
    )
)
"""All measures by name, in the order of tables."""


def measure(history: History) -> dict[str, object]:
    """All measures by name, and beside them `steps` and the names of robots that were `lost`.

    Those of reality only where the history tells of it, and newer ones not by older rules.
    """
    lost = [name for name, works in zip(history.names, history.works[-1], strict=True) if not works]
    values = {name: one.function(history) for name, one in MEASURES.items() if one.holds(history)}
    return {"steps": history.steps, **values, "lost": lost}


def markdown() -> str:
    """The table of all measures for a page."""
    rows = ["| Measure | Unit | Definition | Better | Source |", "|---|---|---|---|---|"]
    for one in MEASURES.values():
        text = f"{one.definition} Only on a server." if one.real else one.definition
        rows.append(f"| `{one.name}` | {one.unit} | {text} | {one.better} | {one.source} |")
    return "\n".join(rows) + "\n"
