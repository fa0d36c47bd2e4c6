"""`usarsim mission check`: says what of a mission cannot be."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command, facts


def add_parser(subparsers: Subparsers) -> None:
    """Add `check` to the command line."""
    parser = add_command(subparsers, "check", "find what cannot be in a mission", run)
    parser.add_argument("mission", metavar="NAME|FILE", help="a shipped mission, or a file")
    parser.add_argument("--seed", type=int, metavar="N", help="instead of that of the file")
    parser.add_argument(
        "--world", metavar="NAME|PATH", help="world or map, instead of that of the file"
    )
    parser.add_argument(
        "--robots",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="folder with further robot files; may be repeated",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write the world folder that a server would serve"
    )
    parser.add_argument(
        "--allow-outside", action="store_true", help="let a map read files that lie elsewhere"
    )


def run(arguments: argparse.Namespace) -> int:
    """Print what is wrong, or what the mission is; returns the exit code."""
    from usarsim_mission.scenario.check import cautions
    from usarsim_mission.scenario.faults import FaultsError, faults
    from usarsim_mission.scenario.reader import find_mission
    from usarsim_mission.scenario.resolving import stage

    try:
        found, staged = faults(
            find_mission(arguments.mission),
            lambda scenario: stage(
                scenario,
                seed=arguments.seed,
                world=arguments.world,
                robots=tuple(arguments.robots),
                allow_outside=arguments.allow_outside,
            ),
        )
    except FaultsError as error:
        found = error.all
    for problem in found:
        print(f"error: {problem}", file=sys.stderr)
    if found:
        return 2
    scenario = staged.scenario
    if arguments.out is not None:
        staged.write_world(arguments.out)
    ways = [staged.reached.way_to(one.pose.position, 2.0) for one in staged.victims]
    bands = sum(zone.kind == "blue" for zone in staged.painted)
    print(f"{scenario.name}: {scenario.title}")
    print(
        facts(
            [
                ("world", staged.base.name),
                ("robots", ", ".join(f"{r.entry.name} ({r.entry.kind})" for r in staged.robots)),
                ("victims", f"{len(staged.victims)}, {min(ways):.0f} to {max(ways):.0f} m away"),
                ("zones", f"{len(staged.painted) - bands}, with {bands} bands"),
                ("time limit", f"{scenario.time_limit:g} s"),
                ("scoring", staged.rules.name),
                ("seed", staged.scenario.seed),
            ]
        )
    )
    for caution in cautions(scenario):
        print(f"note: {caution}")
    return 0
