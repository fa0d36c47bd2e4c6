"""`usarsim explore check`: whether a strategy knows only what its robot may know."""

from __future__ import annotations

import argparse

from usarsim_server.cli.common import Subparsers, add_command

_EPILOG = (
    "STRATEGY is a name, or FILE.py:CLASS. It is run in a small world, then in others that differ "
    "where no robot has looked; it may not read the true world or a clock, draw from a global "
    "generator, talk to other robots but by radio, keep anything where these could read it, or "
    "change its view. Exit code 1 if it does."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `check`."""
    text = "find out whether a strategy knows what it may not know"
    parser = add_command(subparsers, "check", text, run, epilog=_EPILOG)
    parser.add_argument("strategy", metavar="STRATEGY")


def run(arguments: argparse.Namespace) -> int:
    """Print a line per breach, or one that says that there is none."""
    from usarsim_exploration.contract import check
    from usarsim_exploration.errors import ExplorationError
    from usarsim_exploration.strategy import create_strategy
    from usarsim_exploration.strategy_file import load_strategy, split
    from usarsim_server.base.tables import Table

    table = Table({}, "STRATEGY", ExplorationError)
    file = split(arguments.strategy)
    if file is None:
        strategy = create_strategy(arguments.strategy, table, "STRATEGY")
    else:
        strategy = table.read(load_strategy(*file))
    found = check(strategy)
    for one in found:
        print(f"{arguments.strategy}: {one}")
    if not found:
        print(f"{arguments.strategy}: keeps to its view")
    return 1 if found else 0
