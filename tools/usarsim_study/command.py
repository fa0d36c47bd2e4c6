"""`usarsim study`: list, check, run, evaluate and export studies of operators."""

from __future__ import annotations

import argparse
import importlib

from usarsim_server.cli.common import Subparsers, add_command

COMMANDS = ("check", "list", "run", "simulate", "power", "export", "report", "forget")
"""Files of `commands`, in the order of the help: each defines `add_parser(subparsers)`."""

_EPILOG = (
    "See docs/studies.md. `report` and `power` need the extra: pip install usarsim-server[study]"
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `study` with its own subcommands."""
    text = "check, run, evaluate and export studies of operators"
    parser = add_command(subparsers, "study", text, _no_command, epilog=_EPILOG)
    parser.set_defaults(parser=parser)
    inner = parser.add_subparsers(title="commands", metavar="COMMAND")
    for name in COMMANDS:
        importlib.import_module(f"usarsim_study.commands.{name}").add_parser(inner)


def _no_command(arguments: argparse.Namespace) -> int:
    arguments.parser.print_help()
    return 0
