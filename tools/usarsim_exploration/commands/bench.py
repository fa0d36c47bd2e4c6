"""`usarsim explore bench`: a batch of runs on all cores."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from usarsim_batch.carry_out import add_options
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
    add_options(parser)
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
        UsarsimError: the batch cannot be used, the folder not be written, or the cluster not be
            reached.
    """
    from usarsim_batch.carry_out import carry_out, engine_of
    from usarsim_batch.folder import RESULT, Folder, write
    from usarsim_exploration.batches.batch_file import Job, find_batch
    from usarsim_exploration.batches.batch_folder import FORMAT, TIMING, timing_csv
    from usarsim_exploration.batches.playing import play
    from usarsim_exploration.batches.summary import alike, summary

    batch = find_batch(arguments.batch)
    if arguments.strategy:
        batch = batch.only(arguments.strategy)
    engine = engine_of(arguments)
    folder = Folder(arguments.out, FORMAT, batch.resolved())
    jobs = batch.jobs()
    command = [
        "explore",
        "bench",
        arguments.batch,
        *(f"--strategy={x}" for x in arguments.strategy or ()),
    ]
    outcome = carry_out(play, jobs, folder, engine, arguments, command)
    if not outcome.whole:
        return outcome.code
    inorder = sorted(jobs, key=lambda job: job.order)
    spent = 0.0

    def timed() -> Iterator[tuple[Job, Mapping[str, float]]]:
        nonlocal spent
        for job in inorder:
            timing = outcome.of(job).timing
            spent += sum(timing.values()) - timing.get("steps", 0)
            yield job, timing

    write(arguments.out / TIMING, [timing_csv(timed())])
    folder.finish(outcome.of(job).row for job in inorder)
    bad = sum(bool(one.error) for one in outcome)
    told = sys.stderr if arguments.watch == "json" else sys.stdout
    print(summary(one.row for one in outcome), file=told)
    for line in alike(outcome.of(job).row for job in inorder):
        print(line, file=told)
    print(
        f"{arguments.out / RESULT}: {len(jobs)} runs, {bad} failed, "
        f"{spent / 60:.1f} min of processor", file=told,
    )  # fmt: skip
    return outcome.code
