"""`usarsim explore bench`: a batch of runs on all cores."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean, stdev

from usarsim_batch.carry_out import add_options
from usarsim_batch.tasks import Row
from usarsim_server.cli.common import Subparsers, add_command, table

_EPILOG = (
    "BATCH is a TOML file with lists of environments, teams, strategies, radios and seeds, or one "
    "that comes along: full, quick, orders, stuck; see docs/exploration.md. The same command goes "
    "on after an interruption. DIR gets result.json, the same bytes however many workers there "
    "are, timing.csv, and a file for each run. A run that fails is stored with what went wrong, "
    "the others go on, and the exit code is 1."
)
SHOWN = ("team_t90", "base_t90", "team_area", "base_share", "distance")
"""Measures that are printed; the report tells all."""


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
    print(_summary(one.row for one in outcome), file=told)
    for line in _alike(outcome.of(job).row for job in inorder):
        print(line, file=told)
    print(
        f"{arguments.out / RESULT}: {len(jobs)} runs, {bad} failed, "
        f"{spent / 60:.1f} min of processor", file=told,
    )  # fmt: skip
    return outcome.code


def _summary(rows: Iterable[Row]) -> str:
    """One line for each strategy, `mean ± standard deviation (of so many runs)` by measure.

    A time is that of the runs that came so far; a run that did not has none.
    """
    found: dict[str, list[list[float | None] | None]] = {}
    for row in rows:
        measures = None if "error" in row else [row["measures"][name] for name in SHOWN]
        found.setdefault(row["strategy"], []).append(measures)
    lines = []
    for strategy, ran in found.items():
        well = [one for one in ran if one is not None]
        columns = zip(*well, strict=True) if well else [()] * len(SHOWN)
        cells = (_cell([one for one in column if one is not None]) for column in columns)
        lines.append((strategy, len(ran), len(ran) - len(well), *cells))
    return table(("STRATEGY", "RUNS", "FAILED", *SHOWN), lines)


def _alike(rows: Iterable[Row]) -> list[str]:
    """What to say of groups of runs, equal but for the seed, that all came to the same logs.

    Nothing in such runs was drawn by the seed, so they are one sample, not many.
    """
    found: dict[str, list[str]] = {}
    for row in rows:
        if "error" not in row:
            parts = (row["environment"], row.get("team", row["robots"]), row["strategy"])
            key = "/".join(map(str, (*parts, row["radio"])))
            found.setdefault(key, []).append(row["digest"])
    return [
        f"{key}: {len(ones)} seeds gave the same run, so they are one sample "
        '(let the seed draw starts, with [team] base = "drawn" and no start of a robot)'
        for key, ones in found.items()
        if len(ones) > 1 and len(set(ones)) == 1
    ]


def _cell(values: Sequence[float]) -> str:
    if not values:
        return "-"
    spread = stdev(values) if len(values) > 1 else 0.0
    return f"{fmean(values):.4g} ± {spread:.3g} ({len(values)})"
