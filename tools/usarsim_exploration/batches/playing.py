"""One run of a batch, as a row of its results; and which numbers of two rows differ."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from usarsim_exploration.batches.batch_file import Job
from usarsim_exploration.history import Counts, History
from usarsim_exploration.log_files import agents_csv, steps_csv
from usarsim_exploration.measures import measure
from usarsim_exploration.run_folder import rounded
from usarsim_exploration.running import Run
from usarsim_exploration.timing import PHASES, Watch
from usarsim_server.errors import UsarsimError

EVERY = 5
"""Steps between two points of a curve."""
_DIGITS = 5
Row = dict[str, Any]


class Played(NamedTuple):
    """What came of a run. row: of results, the same wherever and whenever it runs.

    Attributes:
        timing: processor seconds by phase, and steps; no result.
    """

    row: Row
    timing: dict[str, float]


def play(job: Job) -> Played:
    """Run a job; whatever goes wrong is in the row."""
    watch = Watch()
    try:
        one = Run(job.scenario(), watch.begin)
        while one.step():
            pass
        result = one.result()
        history = result.history
        row = job.facts() | {
            "ended": {"reason": result.ended, "step": history.steps},
            "measures": rounded(measure(history)),
            "curves": curves(history),
            "digest": digest(history),
        }
    except Exception as error:  # a batch goes on
        return Played(failed(job, _told(error)), {})
    watch.begin(PHASES[-1])
    return Played(row, {"steps": history.steps, **watch.processor()})


def failed(job: Job, text: str) -> Row:
    """The row of a run that came to no end."""
    return job.facts() | {"error": text}


def curves(history: History) -> dict[str, object]:
    """Parts of the reachable free cells that are known, and cells driven by all robots together.

    The last point is that of the end.
    """
    steps = np.arange(0, history.steps + EVERY, EVERY)
    rows = np.minimum(steps, history.steps)

    def share(cells: Counts) -> list[float]:
        found: list[float] = np.round(cells[rows] / history.reachable, _DIGITS).tolist()
        return found

    return {
        "steps": steps.tolist(), "team": share(history.free_team), "base": share(history.free_base),
        "distance": history.distance[rows, 1:].sum(axis=1).round(1).tolist(),
    }  # fmt: skip


def digest(history: History) -> str:
    """SHA-256 of both logs, `steps.csv` and then `agents.csv` as `explore run` writes them."""
    return hashlib.sha256((steps_csv(history) + agents_csv(history)).encode()).hexdigest()


def differences(
    one: object, other: object, place: str = ""
) -> Iterator[tuple[str, object, object]]:
    """Where two rows differ: place, and both values."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys([*one, *other]):
            inner = f"{place}.{key}" if place else str(key)
            yield from differences(one.get(key), other.get(key), inner)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for number, pair in enumerate(zip(one, other, strict=True)):
            yield from differences(*pair, f"{place}[{number}]")
    elif one != other or type(one) is not type(other):
        yield place, one, other


def _told(error: Exception) -> str:
    return str(error) if isinstance(error, UsarsimError) else f"{type(error).__name__}: {error}"
