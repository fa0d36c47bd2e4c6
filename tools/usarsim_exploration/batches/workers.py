"""Plays jobs in processes of their own; which of them plays what changes nothing."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from usarsim_exploration.batches.batch_file import Job
from usarsim_exploration.batches.playing import Played, failed, play


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def play_all(jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, Played]]:
    """What comes of each job, as they come to their ends.

    Args:
        jobs: in the order in which they begin. workers: processes; one worker is this process.
    """
    if min(workers, len(jobs)) <= 1:
        yield from ((job, play(job)) for job in jobs)
        return
    left = list(reversed(jobs))
    processes: dict[Connection, BaseProcess] = {}
    busy: dict[Connection, Job] = {}

    def give(pipe: Connection) -> None:
        if left:
            busy[pipe] = left.pop()
            with suppress(OSError):  # it has died; its end is read next
                pipe.send(busy[pipe])

    def start() -> None:
        pipe, theirs = multiprocessing.Pipe()
        context = multiprocessing.get_context("spawn")
        process = context.Process(target=_work, args=(theirs,), daemon=True)
        process.start()
        theirs.close()  # so that its end is noticed
        processes[pipe] = process
        give(pipe)

    try:
        for _ in range(min(workers, len(jobs))):
            start()
        while busy:
            for pipe in wait(list(busy)):
                assert isinstance(pipe, Connection)
                job = busy.pop(pipe)
                try:
                    played = pipe.recv()
                except (EOFError, OSError):
                    process = processes.pop(pipe)
                    process.join()
                    text = f"its process ended with code {process.exitcode}"
                    yield job, Played(failed(job, text), {})
                    if left:
                        start()
                    continue
                give(pipe)
                yield job, played
    finally:  # also when somebody has interrupted
        for process in processes.values():
            process.terminate()
        for process in processes.values():
            process.join()


def _work(pipe: Connection) -> None:
    """A worker: Ctrl-C is for the process that gives it its jobs."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        try:
            pipe.send(play(pipe.recv()))
        except (EOFError, OSError):
            return
