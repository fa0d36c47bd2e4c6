"""`usarsim study export`: writes all numbers of a study as tidy CSV with a dictionary."""

from __future__ import annotations

import argparse
from pathlib import Path

from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import write_bytes
from usarsim_server.cli.common import Subparsers, add_command
from usarsim_study.dataset import collect
from usarsim_study.folder import StudyFolder
from usarsim_study.tables import SUMMARY, write


def add_parser(subparsers: Subparsers) -> None:
    """Add `export`."""
    text = "write participants, trials, parts and answers of a study as CSV"
    parser = add_command(subparsers, "export", text, run)
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of the study")
    parser.add_argument("--out", metavar="DATA", type=Path, help="where to (default DIR/data)")


def run(arguments: argparse.Namespace) -> int:
    """Write the tables and name them.

    Raises:
        UsarsimError: the study is damaged or the folder cannot be written.
    """
    for path in export(StudyFolder(arguments.folder), arguments.out):
        print(path)
    return 0


def export(folder: StudyFolder, out: Path | None = None) -> list[Path]:
    """Write the tables, and `summary.csv` of all trials beside the study file.

    Raises:
        UsarsimError: the study is damaged or the folder cannot be written.
    """
    target = out or folder.path / "data"
    try:
        written = write(collect(folder), target)
        if out is None:
            summary = folder.path / SUMMARY
            write_bytes(summary, (target / "trials.csv").read_bytes(), private=True)
            written.append(summary)
    except OSError as error:
        cure = "name a folder that can be written"
        raise UsarsimError(at(target, f"cannot be written: {error.strerror}", cure)) from None
    return written
