"""`usarsim explore`: multi-robot exploration; each subcommand is a module of `commands`."""

from __future__ import annotations

import pkgutil
from importlib import import_module

from usarsim_exploration import commands
from usarsim_server.cli.common import Subparsers


def add_parser(subparsers: Subparsers) -> None:
    """Add `explore` with its subcommands."""
    help = "multi-robot exploration under limited radio, as a benchmark on a grid"
    parser = subparsers.add_parser(
        "explore", help=help, description=help.capitalize() + ".", allow_abbrev=False
    )
    below = parser.add_subparsers(metavar="COMMAND", required=True)
    for module in pkgutil.iter_modules(commands.__path__, f"{commands.__name__}."):
        import_module(module.name).add_parser(below)
