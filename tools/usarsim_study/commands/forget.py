"""`usarsim study forget`: removes one participant everywhere."""

from __future__ import annotations

import argparse
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command
from usarsim_study.commands.export import export
from usarsim_study.folder import StudyFolder


def add_parser(subparsers: Subparsers) -> None:
    """Add `forget`."""
    text = "remove a participant with all logs, forms and exported rows"
    epilog = (
        "Copies that were made elsewhere are yours to remove. The number is not given out again."
    )
    parser = add_command(subparsers, "forget", text, run, epilog=epilog)
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of the study")
    parser.add_argument("code", metavar="CODE", help="code of the participant")


def run(arguments: argparse.Namespace) -> int:
    """Remove, and export again what was exported.

    Raises:
        UsarsimError: there is no such participant.
    """
    folder = StudyFolder(arguments.folder)
    removed = folder.forget(arguments.code)
    for path in removed:
        print(f"removed {path}")
    if any(path.name in ("data", "summary.csv") for path in removed):
        export(folder)
        print("exported the others again")
    if any(path.name.startswith("report") for path in removed):
        print(f"the report is gone: usarsim study report {arguments.folder}")
    return 0
