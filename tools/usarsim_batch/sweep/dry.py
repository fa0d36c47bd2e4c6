"""How long a sweep would take, from a few of its runs."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path
from statistics import fmean, stdev

from usarsim_batch.engines import Engine, cores
from usarsim_batch.errors import BatchError
from usarsim_batch.progress import span
from usarsim_batch.sweep.plan import Plan, SweepTask
from usarsim_batch.tasks import Run


def estimate(run: Run[SweepTask], plan: Plan, engine: Engine, jobs: int | None) -> str:
    """Count of runs and hours of all, measured by a few that the plan draws.

    Args:
        run: plays one. plan: of all. engine: plays them, as many at a time as it would.
        jobs: workers; None: all cores.

    Raises:
        BatchError: a run of the sample fails.
    """
    workers = max(jobs if jobs is not None else cores(), 1)
    with tempfile.TemporaryDirectory(prefix="usarsim-dry-") as folder:
        tasks = plan.tasks(Path(folder))
        sample = random.Random(1).sample(tasks, min(len(tasks), max(3, 2 * workers)))
        seconds = []
        for task, played in engine.play(run, sample):
            if played.error:
                cure = "cure: mend it, then try again"
                raise BatchError(f"{plan.path}: run {task.key}: {played.error} ({cure})")
            seconds.append(played.timing["wall_s"])
    mean, count = fmean(seconds), len(tasks)
    spread = stdev(seconds) / len(seconds) ** 0.5 / mean if len(seconds) > 1 else 0.0
    total = mean * max(count / workers, 1)
    return (
        f"{plan.path}: {count} runs, about {total / 3600:.3g} h ({span(total)}) on {workers} "
        f"workers; {len(seconds)} of them took {mean:.3g} s each, standard error "
        f"{100 * spread:.0f} %"
    )
