"""`usarsim mission`: all that is done with missions; each subcommand is a module of `commands`."""

from __future__ import annotations

from types import ModuleType

from usarsim_mission.commands import check, league, listing, replay, run, score
from usarsim_server.cli.common import Subparsers

SUBCOMMANDS: tuple[ModuleType, ...] = (
    check,
    listing,
    replay,
    run,
    score,
    league,
)  # fmt: skip
"""Modules with `add_parser(subparsers)`, in the order of `--help`; one a line."""


def add_parser(subparsers: Subparsers) -> None:
    """Add `mission` with its subcommands."""
    help = "check, run and score missions with zones and victims"
    parser = subparsers.add_parser(
        "mission", help=help, description=help.capitalize() + ".", allow_abbrev=False
    )
    below = parser.add_subparsers(metavar="COMMAND", required=True)
    for module in SUBCOMMANDS:
        module.add_parser(below)
