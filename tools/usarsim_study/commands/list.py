"""`usarsim study list`: the studies that come along."""

from __future__ import annotations

import argparse

from usarsim_server.cli.common import Subparsers, add_command, table
from usarsim_study.study_file import read_study, shipped_studies


def add_parser(subparsers: Subparsers) -> None:
    """Add `list`."""
    add_command(subparsers, "list", "list the shipped studies", run)


def run(arguments: argparse.Namespace) -> int:
    """Print one line per study."""
    rows = []
    for path in shipped_studies():
        study = read_study(path)
        trials = len(study.orders[0])
        rows.append(
            (
                path.stem,
                len(study.condition),
                study.participants,
                trials,
                study.primary,
                study.title,
            )
        )
    heads = ("NAME", "CONDITIONS", "PARTICIPANTS", "TRIALS", "PRIMARY", "TITLE")
    print(table(heads, rows))
    return 0
