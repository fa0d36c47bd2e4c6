"""`usarsim explore bench`: a batch of runs on all cores."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "BATCH is a TOML file with lists of environments, teams, strategies, radios and seeds, or one "
    "that comes along: full, quick, orders, stuck; see docs/exploration.md. The same command goes "
    "on after an interruption. DIR gets result.json, the same bytes however many workers there "
    "are, timing.csv, and a file for each run. A run that fails is stored with what went wrong, "
    "the others go on, and the exit code is 1."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `bench`."""
    parser = add_command(subparsers, "bench", "run a batch on all cores", run, epilog=_EPILOG)
    parser.add_argument("batch", metavar="BATCH", help="TOML file, or full, quick, orders, stuck")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder of results")
    parser.add_argument("--jobs", metavar="N", type=int, help="workers; default: all cores")
    parser.add_argument(
        "--strategy",
        metavar="NAME",
        nargs="+",
        action="extend",
        help="instead of those of the batch: names, or FILE.py:CLASS",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run what is left of a batch, and write its results; returns the exit code.

    Raises:
        UsarsimError: the batch cannot be used, or the folder not be written.
    """
    from usarsim_exploration.batches.batch_file import find_batch
    from usarsim_exploration.batches.batch_folder import RESULT, BatchFolder
    from usarsim_exploration.batches.summary import summary
    from usarsim_exploration.batches.workers import play_all

    batch = find_batch(arguments.batch)
    if arguments.strategy:
        batch = batch.only(arguments.strategy)
    workers = workers_of(arguments.jobs)
    folder = BatchFolder(arguments.out, batch.resolved())
    jobs = batch.jobs()
    played = {job: kept for job in jobs if (kept := folder.find(job)) is not None}
    left = [job for job in jobs if job not in played]
    if played:
        print(f"{arguments.out}: {len(played)} of {len(jobs)} runs are there", file=sys.stderr)
    progress = Progress(len(jobs), len(played))
    try:
        for job, one in play_all(left, workers):
            folder.keep(job, one)
            played[job] = one
            progress.tell(one.row.get("error", ""), job.key)
    except KeyboardInterrupt:
        progress.clear()
        text = f"{len(played)} of {len(jobs)} runs are kept; the same command goes on from there"
        print(f"interrupted: {text}")
        raise
    progress.clear()
    folder.finish(played)
    rows = [played[job].row for job in jobs]
    print(summary(rows))
    failed = sum("error" in row for row in rows)
    spent = sum(sum(one.timing.values()) - one.timing.get("steps", 0) for one in played.values())
    print(
        f"{arguments.out / RESULT}: {len(rows)} runs, {failed} failed, "
        f"{spent / 60:.1f} min of processor"
    )
    return 1 if failed else 0


def workers_of(jobs: int | None) -> int:
    """How many workers an option asks for.

    Raises:
        SettingsError: no number of workers.
    """
    from usarsim_exploration.batches.workers import cores
    from usarsim_server.errors import SettingsError

    if jobs is not None and not 1 <= jobs <= 1024:
        raise SettingsError(f"--jobs: {jobs} is no number of workers (cure: write 1 to 1024)")
    return jobs or cores()


class Progress:
    """A line on the terminal: how many runs are over, and about how long the rest takes."""

    def __init__(self, count: int, done: int = 0) -> None:
        """count: of runs. done: those that were over before."""
        self._count, self._done, self._new = count, done, 0
        self._begun = time.monotonic()
        self._shown = sys.stderr.isatty()

    def tell(self, error: str, key: str) -> None:
        """One more is over; error: what went wrong."""
        self._new += 1
        over = self._done + self._new
        if error:
            self.clear()
            print(f"{key}: {error}", file=sys.stderr)
        if self._shown:
            rest = (time.monotonic() - self._begun) / self._new * (self._count - over)
            text = f"{over} of {self._count} runs, about {_span(rest)} to go"
            print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Take the line away."""
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def _span(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"
