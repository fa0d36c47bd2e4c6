"""`usarsim explore verify`: whether the results of a batch are those of its runs."""

from __future__ import annotations

import argparse
import re
import secrets
from pathlib import Path

from usarsim_exploration.commands import add_run_code
from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "A part of the runs is drawn and run again; every number has to be the same. Tells what "
    "differs first in each run that does; the exit code is then 1. KEY is "
    "ENVIRONMENT/TEAM/STRATEGY/RADIO/SEED, as in office/4/frontier/path-loss/7."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `verify`."""
    text = "run a part of a batch again and compare"
    parser = add_command(subparsers, "verify", text, run, epilog=_EPILOG.replace("%", "%%"))
    parser.add_argument("result", metavar="RESULT", type=Path, help="result.json of a batch")
    parser.add_argument(
        "--part", metavar="P", type=_part, default=0.05, help="how much of all runs; default 5%%"
    )
    parser.add_argument("--seed", metavar="N", type=int, help="of the draw; default: a new one")
    parser.add_argument(
        "--run", dest="keys", metavar="KEY", action="append", default=[],
        help="this run, instead of a draw; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--files", metavar="DIR", type=Path, help="where maps and strategy files lie of the batch"
    )
    add_run_code(parser)
    parser.add_argument("--jobs", metavar="N", type=int, help="workers; default: all cores")


def _part(text: str) -> float:
    """`5%`, or the same as .05."""
    percent = re.fullmatch(r"\s*([0-9.]+)\s*%\s*", text)
    value = float(percent[1]) / 100 if percent else float(text)
    if not 0.0 < value <= 1.0:
        raise argparse.ArgumentTypeError("write more than 0% and at most 100%")
    return value


def run(arguments: argparse.Namespace) -> int:
    """Run again and compare; returns the exit code.

    Raises:
        UsarsimError: the file is no result, or what it names is not there.
    """
    from importlib.metadata import version

    from usarsim_batch.engines import find_engine
    from usarsim_batch.progress import Progress
    from usarsim_batch.worker import Limits
    from usarsim_exploration.batches.batch_folder import read_result
    from usarsim_exploration.batches.verifying import Verification

    path: Path = arguments.result
    content = read_result(path)
    engine = find_engine(None, arguments.jobs, Limits())
    if content.get("version") != version("usarsim-server"):
        print(f"{path}: is of version {content.get('version')}, this is another one")
    files, code = arguments.files or path.parent, arguments.run_code
    one = Verification(content, path, files, code=code)
    for key in one.missing:
        print(f"{key}: is missing")
    for key in one.strange:
        print(f"{key}: is no run of this batch, or there twice")
    if arguments.keys:
        jobs = one.named(arguments.keys)
    else:
        seed = arguments.seed if arguments.seed is not None else secrets.randbelow(10**6)
        jobs = one.draw(arguments.part, seed)
        print(f"{len(jobs)} of {len(one.jobs)} runs again, drawn by --seed {seed}", flush=True)
    missed = one.chance(len(jobs), 1)
    wrong = 0
    progress = Progress(len(jobs))
    for job, difference in one.rerun(jobs, engine):
        progress.tell(difference, job.key)
        wrong += bool(difference)
    progress.clear()
    print(f"{path}: {len(jobs) - wrong} equal, {wrong} not")
    if not arguments.keys and missed:
        few = next((n for n in range(1, len(one.jobs)) if one.chance(len(jobs), n) < 0.05), None)
        more = f"; of {few} forged ones all with less than 5 %" if few is not None else ""
        print(f"a run that is forged alone would be missed with a chance of {missed:.1%}{more}")
    return 1 if wrong or one.missing or one.strange else 0
