"""`usarsim study report`: one HTML file that tells what a study found."""

from __future__ import annotations

import argparse
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command
from usarsim_server.errors import UsarsimError, at
from usarsim_server.extras import need
from usarsim_server.files import is_regular
from usarsim_study.commands.export import export
from usarsim_study.folder import StudyFolder
from usarsim_study.study_file import FILE
from usarsim_study.tables import PACKAGE, read


def add_parser(subparsers: Subparsers) -> None:
    """Add `report`."""
    text = "write report.html, report.md and results.csv of a study"
    epilog = "DIR may also be a folder of exported tables: the report needs nothing else."
    parser = add_command(subparsers, "report", text, run, epilog=epilog)
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of the study")


def run(arguments: argparse.Namespace) -> int:
    """Export, judge, write.

    Raises:
        UsarsimError: the study is damaged, or what judges it is not installed.
    """
    return write_reports(arguments.folder)


def write_reports(folder: Path) -> int:
    """Export, judge, write; the exit code.

    Raises:
        UsarsimError: the study is damaged, or what judges it is not installed.
    """
    need("scipy", "matplotlib", extra="study", asker="the report")
    from usarsim_study import report

    data = folder
    if is_regular(folder / FILE) or not is_regular(folder / PACKAGE):
        export(StudyFolder(folder))
        data = folder / "data"
    try:
        written = report.write(read(data), folder)
    except OSError as error:
        cure = "name a folder that can be written"
        raise UsarsimError(at(folder, f"cannot be written: {error.strerror}", cure)) from None
    for path in written:
        print(path)
    return 0
