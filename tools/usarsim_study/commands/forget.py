"""`usarsim study forget`: removes one participant everywhere."""

from __future__ import annotations

import argparse
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command
from usarsim_study.commands.export import export
from usarsim_study.folder import EXPORTS, REPORTS, StudyFolder


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
    """Export the others again if there was an export, and remove the participant last.

    A removal that was cut off is made again to its end.

    Raises:
        UsarsimError: there is no such participant.
    """
    folder = StudyFolder(arguments.folder)
    place = folder.forgetting(arguments.code)
    reports = folder.drop(REPORTS)
    for path in reports:
        print(f"removed {path}")
    if any((folder.path / name).exists() for name in EXPORTS):
        export(folder)
        print("exported the others again")
    folder.forgotten(place)
    print(f"removed {place}")
    if reports:
        print(f"the report is gone: usarsim study report {arguments.folder}")
    return 0
