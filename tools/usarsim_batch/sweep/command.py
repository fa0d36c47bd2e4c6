"""`usarsim sweep`: a matrix of parameters of servers and controllers, on all cores or a cluster."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from usarsim_batch.carry_out import add_options
from usarsim_server.cli.common import Subparsers, add_command

FORMAT = "usarsim-sweep/1"
FILES = "files"
_EPILOG = (
    "FILE is a TOML file with [serve], [[controller]] and [grid], [[list]] or [random]; see "
    "docs/cluster.md. The same command goes on after an interruption. `usarsim sweep diff A B` "
    "names the runs of two folders whose results differ. A run that fails is stored with what went "
    "wrong, the others go on, and the exit code is 1."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `sweep`."""
    text = "run servers and controllers with a matrix of parameters"
    parser = add_command(subparsers, "sweep", text, run, epilog=_EPILOG)
    parser.add_argument("what", metavar="FILE|diff", help="TOML file; or diff, of two folders")
    parser.add_argument("folders", metavar="DIR", nargs="*", type=Path, help="folders to compare")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of results")
    parser.add_argument(
        "--dry", action="store_true",
        help="play a few runs, and say how many there are and how long all would take",
    )  # fmt: skip
    add_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run what is left of a sweep, and write its results; returns the exit code.

    Raises:
        BatchError: the sweep cannot be used, the folder not be written, or the cluster not be
            reached.
    """
    from usarsim_batch.carry_out import carry_out, engine_of
    from usarsim_batch.errors import BatchError
    from usarsim_batch.folder import RESULT, Folder, write
    from usarsim_batch.sweep.dry import estimate
    from usarsim_batch.sweep.plan import read_plan
    from usarsim_batch.sweep.playing import play
    from usarsim_batch.sweep.results import RESULTS, compare, results_csv, summary

    if arguments.what == "diff":
        if len(arguments.folders) != 2:
            raise BatchError("sweep diff: wants two folders (cure: usarsim sweep diff A B)")
        return compare(*arguments.folders)
    if arguments.folders:
        raise BatchError(f"sweep: {arguments.folders[0]} is one too many (cure: write --out DIR)")
    plan = read_plan(Path(arguments.what))
    if arguments.dry:
        print(estimate(play, plan, engine_of(arguments), arguments.jobs))
        return 0
    if arguments.out is None:
        raise BatchError("sweep: where to? (cure: write --out DIR)")
    tasks = plan.tasks(arguments.out / FILES)
    engine = engine_of(arguments)
    folder = Folder(arguments.out, FORMAT, plan.resolved())
    outcome = carry_out(play, tasks, folder, engine, arguments, ["sweep", arguments.what])
    if not outcome.whole:
        return outcome.code
    folder.finish(one.row for one in outcome)
    write(arguments.out / RESULTS, results_csv(outcome))
    told = sys.stderr if arguments.watch == "json" else sys.stdout
    print(f"{arguments.out / RESULT}: {summary(outcome)}", file=told)
    return outcome.code
