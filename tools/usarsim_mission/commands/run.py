"""`usarsim mission run`: missions with teams, each in a folder of its own."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "MISSION is a file or the name of a shipped mission. A team is a TOML file: a program that is "
    "started (command), robots that drive by themselves (policy), people at the console (console), "
    "or controllers that you start yourself (wait). Several teams or seeds are a batch: each run "
    "has a process and a folder TEAM-SEED of its own, one that fails does not keep the others "
    "back, and the same command again plays what is missing. Ends with Ctrl-C; what was logged "
    "until then can be scored. Exit code 1 if a run was not played to its end."
)
_MOST_SEEDS = 10000
_MOST_JOBS = 256


def add_parser(subparsers: Subparsers) -> None:
    """Add `run`."""
    text = "run a mission with teams, judged by the referee"
    parser = add_command(subparsers, "run", text, run, epilog=_EPILOG)

    def repeated(flag: str, metavar: str, kind: Callable[[str], object], help: str) -> None:
        parser.add_argument(
            flag, metavar=metavar, type=kind, action="append", default=[], help=help
        )

    parser.add_argument("mission", metavar="MISSION", help="file, or name of a shipped mission")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder of the runs")
    repeated("--team", "FILE", Path, "may be repeated")
    parser.add_argument(
        "--demo", action="store_true", help="a team whose robots explore by themselves"
    )
    repeated("--seed", "N", int, "instead of the mission's; may be repeated")
    repeated("--seeds", "LIST", seeds_of, "several of them, such as 1-20 or 1-5,8; a batch")
    parser.add_argument(
        "--jobs", metavar="N", type=_jobs, default=1, help="runs of a batch at once (default 1)"
    )
    parser.add_argument(
        "--speed",
        metavar="FACTOR|max",
        help="simulated seconds per second (default 1; max for --demo)",
    )
    parser.add_argument(
        "--time-limit", metavar="S", type=float, help="of the trial, instead of the mission's"
    )
    parser.add_argument(
        "--console-port",
        metavar="N",
        type=int,
        default=0,
        help="port of the pages of a team of people; 0: any free one (default 0)",
    )
    repeated("--robots", "DIR", Path, "folder with further robot files; may be repeated")


def run(arguments: argparse.Namespace) -> int:
    """Run one mission, or a batch; returns the exit code.

    Raises:
        UsarsimError: a file cannot be used, or a run cannot begin.
    """
    from usarsim_mission.match.playing import play

    return play(arguments)


def seeds_of(text: str) -> tuple[int, ...]:
    """Seeds of a list such as `1-20` or `1-5,8`.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    found: list[int] = []
    for part in text.split(","):
        span = re.fullmatch(r"\s*(\d{1,10})(?:\s*-\s*(\d{1,10}))?\s*", part, re.ASCII)
        first, last = (int(span[1]), int(span[2] or span[1])) if span else (1, 0)
        if last < first or last - first >= _MOST_SEEDS:
            raise argparse.ArgumentTypeError(f"{part!r} is no seed and no span (write 1-5,8)")
        found += range(first, last + 1)
    return tuple(found)


def _jobs(text: str) -> int:
    if not 1 <= (count := int(text)) <= _MOST_JOBS:
        raise argparse.ArgumentTypeError(f"must be from 1 to {_MOST_JOBS}, not {count}")
    return count
