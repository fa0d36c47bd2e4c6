"""`usarsim mission league`: ranks teams by many runs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command, number, table

_EPILOG = (
    "Each DIR is the folder of a run, or holds such folders at any depth; what a batch planned and "
    "has not played is missing. Runs that were cut off or ended by an error are told, and do not "
    "count. Exit code 1 if a run that was scored again gives other points than it had."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `league`."""
    parser = add_command(
        subparsers, "league", "rank teams by many runs", run, epilog=_EPILOG
    )  # fmt: skip
    parser.add_argument(
        "folders", metavar="DIR", type=Path, nargs="+", help="runs, or folders of runs"
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path,
        help="write league.html, league.json, league.csv and runs.csv there",
    )  # fmt: skip
    parser.add_argument(
        "--by",
        choices=("points", "places"),
        help="what decides: the mean of points, or of places in the matches (default points; "
        "places if missions have different rules)",
    )
    parser.add_argument(
        "--common", action="store_true", help="only matches count that every team has"
    )
    parser.add_argument(
        "--flawed", action="store_true", help="runs count that were cut off or ended by an error"
    )
    parser.add_argument("--again", action="store_true", help="score all runs again from their logs")


def run(arguments: argparse.Namespace) -> int:
    """Print the table, write the files; returns the exit code.

    Raises:
        MissionError: there is no run, or one cannot be read.
    """
    from usarsim_mission.league.gathering import gather
    from usarsim_mission.league.standings import rank
    from usarsim_mission.league.writing import write_league

    gathered = gather(arguments.folders, again=arguments.again)
    league = rank(gathered, by=arguments.by, common=arguments.common, flawed=arguments.flawed)
    of = len(league.matches)
    rows = [
        (
            "-" if row.rank is None else str(row.rank),
            row.team,
            "-" if row.score is None else number(row.score, 2),
            "-" if row.mean is None else number(row.mean, 2),
            str(row.won),
            f"{row.played} of {of}",
        )
        for row in league.standings
    ]
    score = "MEAN PLACE" if league.by == "places" else "SCORE"
    print(table(("RANK", "TEAM", score, "MEAN POINTS", "WON", "PLAYED"), rows))
    for row in league.standings:
        for match, entry in row.entries.items():
            for one in (*entry.counted, *entry.apart):
                if one.flaw:
                    print(f"{one.folder}: {row.team}, {match}: {one.flaw}", file=sys.stderr)
    for line in gathered.differences:
        print(line, file=sys.stderr)
    if arguments.out is not None:
        for path in write_league(league, arguments.out):
            print(path)
    return 1 if gathered.differences else 0
