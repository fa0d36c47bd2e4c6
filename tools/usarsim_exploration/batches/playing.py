"""One run of a batch, as a row of its results."""

from __future__ import annotations

import hashlib

import numpy as np

from usarsim_batch.tasks import Played, failed, provenance
from usarsim_exploration.batches.batch_file import Job
from usarsim_exploration.history import Counts, History
from usarsim_exploration.log_files import agents_csv, steps_csv
from usarsim_exploration.measures import measure
from usarsim_exploration.run_folder import rounded
from usarsim_exploration.running import Run
from usarsim_exploration.timing import PHASES, Watch
from usarsim_server.base.errors import UsarsimError

EVERY = 5
"""Steps between two points of a curve."""
_DIGITS = 5


def play(job: Job) -> Played:
    """Run a job; whatever goes wrong is in the row."""
    watch = Watch()
    try:
        with Run(job.scenario(), watch.begin) as one:
            while one.step():
                pass
            result, simulator = one.result(), one.close()
        history = result.history
        row = job.facts() | {
            "ended": {"reason": result.ended, "step": history.steps},
            "measures": rounded(measure(history)),
            "curves": curves(history),
            "digest": digest(history),
        }
    except Exception as error:  # a batch goes on
        return failed(job, _told(error))
    watch.begin(PHASES[-1])
    timing = {"steps": history.steps, **watch.processor()}
    return Played(row, timing | ({"simulator": simulator} if simulator else {}), provenance())


def curves(history: History) -> dict[str, object]:
    """Parts of the reachable free cells that are known, and cells driven by all robots together.

    The last point is that of the end.
    """
    steps = np.arange(0, history.steps + EVERY, EVERY)
    rows = np.minimum(steps, history.steps)

    def share(cells: Counts) -> list[float]:
        found: list[float] = np.round(cells[rows] / history.reachable[rows], _DIGITS).tolist()
        return found

    return {
        "steps": steps.tolist(),
        "team": share(history.known_team),
        "base": share(history.known_base),
        "distance": history.distance[rows, 1:].sum(axis=1).round(1).tolist(),
    }


def digest(history: History) -> str:
    """SHA-256 of both logs, `steps.csv` and then `agents.csv` as `explore run` writes them."""
    return hashlib.sha256((steps_csv(history) + agents_csv(history)).encode()).hexdigest()


def _told(error: Exception) -> str:
    return str(error) if isinstance(error, UsarsimError) else f"{type(error).__name__}: {error}"
