"""Who plays the runs of a batch; whoever it is, the same comes of it."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Generator, Sequence
from typing import Protocol

from usarsim_batch.errors import BatchError
from usarsim_batch.tasks import Played, Run, T
from usarsim_batch.worker import Limits, Worker

MOST_JOBS = 1024
SLURM = "slurm://"


class Engine(Protocol):
    """Plays runs."""

    def play(self, run: Run[T], tasks: Sequence[T]) -> Generator[tuple[T, Played], None, None]:
        """What comes of each run, as they come to their ends.

        Closing the iterator ends what still runs.

        Args:
            run: plays one; can be pickled, and raises nothing.
            tasks: in the order in which they begin.

        Raises:
            BatchError: nobody is there who could play.
        """


class Here:
    """This very process, without limits: for debuggers, and for tests."""

    def play(self, run: Run[T], tasks: Sequence[T]) -> Generator[tuple[T, Played], None, None]:
        """See `Engine.play`."""
        for task in tasks:
            yield task, run(task)


class Local:
    """Processes of this machine."""

    def __init__(self, workers: int, limits: Limits) -> None:
        """workers: processes. limits: of each run."""
        self._workers, self._limits = workers, limits

    def play(self, run: Run[T], tasks: Sequence[T]) -> Generator[tuple[T, Played], None, None]:
        """See `Engine.play`."""
        workers = [Worker(self._limits) for _ in range(min(self._workers, len(tasks)))]
        left = iter(tasks)
        lock, over = threading.Lock(), threading.Event()
        done: queue.Queue[tuple[T, Played]] = queue.Queue()

        def work(worker: Worker) -> None:
            while not over.is_set():
                with lock:
                    task = next(left, None)
                if task is None:
                    break
                done.put((task, worker.play(run, task)))
            worker.close()

        threads = [threading.Thread(target=work, args=(one,), daemon=True) for one in workers]
        try:
            for thread in threads:
                thread.start()
            for _ in tasks:
                yield done.get()
        finally:  # also when somebody has interrupted
            over.set()
            for worker, thread in zip(workers, threads, strict=True):
                while thread.is_alive():
                    worker.end()
                    thread.join(0.1)


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def find_engine(cluster: str | None, jobs: int | None, limits: Limits) -> Engine:
    """The engine that options ask for.

    Args:
        cluster: `dask://HOST:PORT`; None: this machine.
        jobs: workers of this machine; None: as many as cores, 0: this process.
        limits: of each run.

    Raises:
        BatchError: there is no such engine, or it cannot be reached.
    """
    if cluster is not None:
        if not cluster.startswith("dask://") or cluster == "dask://":
            cure = f"cure: write dask://HOST:PORT of a Dask scheduler, or {SLURM}"
            raise BatchError(f"--cluster: {cluster!r} is no cluster known here ({cure})")
        from usarsim_batch.dask_engine import Dask

        return Dask(cluster.removeprefix("dask://"), limits)
    if jobs is not None and not 0 <= jobs <= MOST_JOBS:
        text = f"--jobs: {jobs} is no number of workers (cure: write 1 to {MOST_JOBS})"
        raise BatchError(text)
    return Here() if jobs == 0 else Local(jobs or cores(), limits)
