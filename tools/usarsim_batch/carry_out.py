"""Plays what is left of a batch and keeps what comes of it: one loop for all commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Any

from usarsim_batch.engines import Engine, find_engine
from usarsim_batch.errors import BatchError
from usarsim_batch.folder import Folder
from usarsim_batch.progress import Progress
from usarsim_batch.tasks import Played, Run, T, failed
from usarsim_batch.worker import Limits


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of all commands that play batches."""
    parser.add_argument(
        "--jobs", metavar="N", type=int,
        help="workers; default: all cores; 0: in this process, without limits",
    )  # fmt: skip
    parser.add_argument(
        "--cluster", metavar="dask://HOST:PORT", help="play on this Dask cluster (extra cluster)"
    )
    parser.add_argument(
        "--time-limit", metavar="S", type=_positive, default=Limits.seconds,
        help="wall time after which a run is ended; default %(default)g",
    )  # fmt: skip
    parser.add_argument(
        "--memory-limit", metavar="MIB", type=_positive, default=Limits.memory >> 20,
        help="memory above which a run is ended; default %(default)g",
    )  # fmt: skip
    parser.add_argument(
        "--watch", nargs="?", choices=("terminal", "json"), const="terminal", default="auto",
        help="show progress, rate and expected end, also where there is no terminal; json: as "
        "JSON lines on standard output",
    )  # fmt: skip


def engine_of(arguments: argparse.Namespace) -> Engine:
    """Whom these options ask for.

    Raises:
        BatchError: there is no such engine.
    """
    limits = Limits(arguments.time_limit, int(arguments.memory_limit * (1 << 20)))
    return find_engine(arguments.cluster, arguments.jobs, limits)


class Outcome:
    """What came of all runs; what is kept in files is read again and not held in memory.

    Attributes:
        failed: how many failed.
    """

    def __init__(self, folder: Folder, tasks: Sequence[Any]) -> None:
        self.failed = 0
        self._folder, self._tasks = folder, tasks
        self.lost: dict[str, Played] = {}

    def __iter__(self) -> Iterator[Played]:
        """Of each task, in their order."""
        for task in self._tasks:
            yield self.of(task)

    def of(self, task: Any) -> Played:
        """What came of a run."""
        found = self.lost.get(task.key) or self._folder.find(task)
        return found or failed(task, "what was kept of it is gone")


def carry_out(
    run: Run[T],
    tasks: Sequence[T],
    folder: Folder,
    engine: Engine,
    arguments: argparse.Namespace,
) -> Outcome:
    """Play what is left; runs that failed before are tried again.

    Args:
        run: plays one. tasks: all of the batch. folder: of results.
        engine: plays them. arguments: see `add_options`.

    Raises:
        BatchError: there is nobody who plays.
    """
    outcome = Outcome(folder, tasks)
    left = [one for one in tasks if (kept := folder.find(one)) is None or kept.error]
    over = len(tasks) - len(left)
    if over:
        print(f"{folder.folder}: {over} of {len(tasks)} runs are there", file=sys.stderr)
    if not left:
        return outcome
    progress = Progress(len(tasks), over, arguments.watch)
    try:
        with closing(engine.play(run, left)) as all_played:
            for task, played in all_played:
                try:
                    folder.keep(task, played)
                except BatchError as error:  # a full disk; the next one may find room
                    played = failed(task, str(error))
                    outcome.lost[task.key] = played
                outcome.failed += bool(played.error)
                over += 1
                progress.tell(played.error, task.key, str(played.about.get("log", "")))
    except KeyboardInterrupt:
        progress.clear()
        text = f"{over} of {len(tasks)} runs are kept; the same command goes on from there"
        print(f"interrupted: {text}")
        raise
    progress.clear()
    return outcome


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value
