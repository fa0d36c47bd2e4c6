"""Plays what is left of a batch and keeps what comes of it: one loop for all commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from usarsim_batch.engines import SLURM, Engine, Here, find_engine
from usarsim_batch.errors import BatchError
from usarsim_batch.folder import Folder
from usarsim_batch.progress import Progress
from usarsim_batch.slurm import MOST, part_of, write_script
from usarsim_batch.tasks import Played, Run, T, failed
from usarsim_batch.worker import Limits
from usarsim_server.base.errors import at
from usarsim_server.base.files import held, reason


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of all commands that play batches."""
    parser.add_argument(
        "--jobs", metavar="N", type=int,
        help="workers; default: all cores; 0: in this process, without limits",
    )  # fmt: skip
    parser.add_argument(
        "--cluster", metavar="dask://HOST:PORT|slurm://",
        help="play on this Dask cluster (extra cluster); or write a script for SLURM, --jobs "
        "tasks of an array, and collect what came of it",
    )  # fmt: skip
    parser.add_argument("--part", metavar="K/N", help="play part K (from 0) of N, as SLURM does")
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
    if arguments.cluster == SLURM:
        return Here()  # never asked
    limits = Limits(arguments.time_limit, int(arguments.memory_limit * (1 << 20)))
    return find_engine(arguments.cluster, arguments.jobs, limits)


class Outcome:
    """What came of all runs; what is kept in files is read again and not held in memory.

    Attributes:
        whole: everything has been played; else there is nothing to collect yet.
        code: exit code of the command: 1 if a run has failed.
    """

    def __init__(self, folder: Folder, tasks: Sequence[Any], lost: Mapping[str, Played]) -> None:
        """Of tasks. lost: what could not be kept, by key."""
        self.whole, self.code = True, 0
        self._folder, self._tasks, self._lost = folder, tasks, lost

    def __iter__(self) -> Iterator[Played]:
        """Of each task, in their order."""
        return map(self.of, self._tasks)

    def of(self, task: Any) -> Played:
        """What came of a run."""
        found = self._lost.get(task.key) or self._folder.find(task)
        return found or failed(task, "what was kept of it is gone")


def carry_out(
    run: Run[T],
    tasks: Sequence[T],
    folder: Folder,
    engine: Engine,
    arguments: argparse.Namespace,
    command: Sequence[str],
) -> Outcome:
    """Play what is left; runs that failed before are tried again.

    Args:
        run: plays one. tasks: all of the batch. folder: of results. engine: plays them.
        arguments: see `add_options`, and `out`. command: words that begin the same one.

    Raises:
        BatchError: there is nobody who plays.
    """
    number, parts = part_of(arguments.part) if arguments.part else (0, 1)
    mine = tasks[number::parts]
    slurm = arguments.cluster == SLURM
    left, bad = [], 0
    for place, one in enumerate(mine):
        kept = folder.find(one)
        bad += kept is not None and bool(kept.error)
        if kept is None or (kept.error and not slurm):
            left.append(place)
    over = len(mine) - len(left)
    if over:
        print(f"{folder.folder}: {over} of {len(mine)} runs are there", file=sys.stderr)
    lost: dict[str, Played] = {}
    outcome = Outcome(folder, tasks, lost)
    outcome.whole = parts == 1
    if slurm:
        outcome.code = 1 if bad else 0
        if left:
            outcome.whole, outcome.code = False, 0
            many = min(len(tasks), MOST if arguments.jobs is None else arguments.jobs)
            words = [*command, "--out", str(arguments.out), *_limits(arguments)]
            path = write_script(folder, words, many, sorted({place % many for place in left}))
            print(f"{path}: plays {len(left)} runs: sbatch {path}; then this command collects")
        return outcome
    if not left:
        return outcome
    progress = Progress(len(mine), over, arguments.watch)
    try:
        with (
            _alone(folder.folder) if parts == 1 else nullcontext(),
            closing(engine.play(run, [mine[place] for place in left])) as all_played,
        ):
            for task, played in all_played:
                try:
                    folder.keep(task, played)
                except BatchError as error:  # a full disk; the next one may find room
                    played = failed(task, str(error))
                    lost[task.key] = played
                outcome.code |= bool(played.error)
                over += 1
                progress.tell(played.error, task.key, str(played.about.get("log", "")))
    except KeyboardInterrupt:
        progress.clear()
        text = f"{over} of {len(mine)} runs are kept; the same command goes on from there"
        print(f"interrupted: {text}")
        raise
    progress.clear()
    return outcome


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the folder, so that no other command plays the same runs into the same files.

    Raises:
        BatchError: another command holds it.
    """
    try:
        with held(folder) as ours:
            if not ours:
                cure = "wait for that one, or name another folder"
                raise BatchError(at(folder, "another command plays these runs", cure))
            yield
    except OSError as error:
        cure = "give a folder that can be written to"
        raise BatchError(at(folder, f"cannot be held: {reason(error)}", cure)) from error


def _limits(arguments: argparse.Namespace) -> list[str]:
    seconds, memory = arguments.time_limit, arguments.memory_limit
    return [f"--time-limit={seconds:g}", f"--memory-limit={memory:g}"]


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value
