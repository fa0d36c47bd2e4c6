"""`usarsim mission list`: the missions that come along."""

from __future__ import annotations

import argparse

from usarsim_server.cli.common import Subparsers, add_command, table


def add_parser(subparsers: Subparsers) -> None:
    """Add `list` to the command line."""
    add_command(subparsers, "list", "list the shipped missions", run)


def run(arguments: argparse.Namespace) -> int:
    """Print one line per mission."""
    from usarsim_mission.scenario.reader import read_scenario, shipped_missions

    rows = [
        (one.name, one.world, len(one.robots), len(one.victims), one.title)
        for one in map(read_scenario, shipped_missions())
    ]
    print(table(("NAME", "WORLD", "ROBOTS", "VICTIMS", "TITLE"), rows))
    return 0
