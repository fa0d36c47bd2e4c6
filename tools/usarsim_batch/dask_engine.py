"""Runs on a Dask cluster: each worker of it keeps a process of ours, which a run may kill."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Generator, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

from usarsim_batch.errors import BatchError
from usarsim_batch.tasks import Played, Run, T, failed
from usarsim_batch.worker import Limits, Worker
from usarsim_server.extras import missing

_PATIENCE = 20.0
"""s for the scheduler to answer, and for a worker to be there."""
_AHEAD = 1000
"""Runs that the scheduler knows of at a time."""
_KEPT = threading.local()


class Dask:
    """A scheduler that runs somewhere, with workers that have the same version of this package."""

    def __init__(self, address: str, limits: Limits) -> None:
        """Connect.

        Args:
            address: host and port of the scheduler. limits: of each run.

        Raises:
            BatchError: it cannot be reached, or `distributed` is not installed.
        """
        self._limits, self._place = limits, f"--cluster: dask://{address}"
        try:
            self._dask: Any = import_module("distributed")
        except ImportError:
            raise BatchError(f"{self._place}: {missing('distributed', 'cluster')}") from None
        for name in ("distributed", "distributed.client"):  # what they tell is told here
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = self._dask.Client(
                f"tcp://{address}", timeout=_PATIENCE, set_as_default=False
            )
        except (OSError, ValueError, TimeoutError) as error:
            cure = "cure: start `dask scheduler` there, and `dask worker HOST:PORT` for each worker"
            told = f"{type(error).__name__}: {error}".splitlines()[0]
            raise BatchError(f"{self._place}: cannot be reached: {told} ({cure})") from None

    def play(self, run: Run[T], tasks: Sequence[T]) -> Generator[tuple[T, Played], None, None]:
        """See `Engine.play`; runs of a worker that dies are done again by others."""
        try:
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except OSError:  # a timeout is one, too
            self._client.close(timeout=1)
            cure = "cure: start `dask worker HOST:PORT`"
            raise BatchError(f"{self._place}: has no workers ({cure})") from None
        left = iter(tasks)
        given: dict[Any, T] = {}
        ended = self._dask.as_completed(loop=self._client.loop)

        def give() -> None:
            task = next(left, None)
            if task is not None:
                future = self._client.submit(
                    _play, run, task, self._limits, os.getcwd(), pure=False, key=_key(task.key)
                )
                given[future] = task
                ended.add(future)

        try:
            for _ in range(_AHEAD):
                give()
            for future in ended:
                task = given.pop(future)
                yield task, self._outcome(future, task)
                give()
        finally:
            with suppress(Exception):  # the scheduler may be gone
                self._client.cancel(list(given), force=True)
            self._client.close()

    def _outcome(self, future: Any, task: T) -> Played:
        try:
            played: Played = future.result(timeout=_PATIENCE)
            return played
        except Exception as error:  # of Dask: workers died again and again, the scheduler is gone
            text = " ".join(f"{type(error).__name__}: {error}".split())
            return failed(task, f"lost by the cluster: {text[:300]}")


def _key(name: str) -> str:
    return f"usarsim-{name}-{os.urandom(8).hex()}"


def _play(run: Run[T], task: T, limits: Limits, folder: str) -> Played:
    """On a worker of the cluster, in one of its threads."""
    worker: Worker | None = getattr(_KEPT, "worker", None)
    if worker is None:
        worker = _KEPT.worker = Worker(limits)
    worker.limits = limits
    return worker.play(run, task, folder)
