"""`usarsim mission score`: a run scored again from its logs."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from usarsim_server.cli.common import Subparsers, add_command, facts, number, table

_EPILOG = (
    "Reads only the logs in DIR, feeds them to a new referee and compares with score.json and the "
    "verdicts in the log. Exit code 1 if they differ."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `score`."""
    parser = add_command(
        subparsers, "score", "score a run again from its logs", run, epilog=_EPILOG
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of a run")
    parser.add_argument("--json", action="store_true", help="print what score.json has to be")
    parser.add_argument(
        "--write",
        action="store_true",
        help="write all anew that is derived from the logs, and run.zip; close a run that was cut "
        "off",
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the score, and where it differs from the live one."""
    from usarsim_mission.deriving import derive
    from usarsim_mission.league.gathering import flaw_of
    from usarsim_mission.live import score_json, write_score
    from usarsim_mission.match.archive import write_archive
    from usarsim_mission.match.report import write_report
    from usarsim_mission.mending import close_run
    from usarsim_mission.rescoring import rescore

    found = rescore(arguments.folder)
    if arguments.write and (found.damage or found.result["ended"]["why"] is None):
        close_run(arguments.folder)
        found = rescore(arguments.folder)
    elif arguments.write:
        write_score(arguments.folder, found.result)
        derive(arguments.folder)
    if arguments.write:
        write_report(arguments.folder, found.result)
        write_archive(arguments.folder)
    if arguments.json:
        print(score_json(found.result), end="")
    else:
        print(summary(found.result))
    if flaw := flaw_of(found.result):
        print(f"{arguments.folder}: not whole: {flaw}", file=sys.stderr)
    for line in found.damage:
        print(f"{arguments.folder}: {line}", file=sys.stderr)
    for line in found.differences:
        print(f"{arguments.folder}: {line}", file=sys.stderr)
    if not arguments.json:
        verdict = "differs from what was told live" if found.differences else "equals score.json"
        if found.live is None and not found.differences:
            verdict = "there is no score.json to compare with"
        print(verdict)
    return 1 if found.differences else 0


def summary(result: Mapping[str, Any]) -> str:
    """A result in words."""
    values, ended = result["values"], result["ended"]
    top = facts(
        [
            ("mission", result["mission"] or "-"),
            ("rules", result["rules"]),
            ("points", number(result["total"], 4)),
            ("found", f"{values['VF']} of {values['V']}, credited {number(values['VC'])}"),
            ("ended", "cut off" if ended["why"] is None else f"{ended['why']}, {_span(ended)}"),
            ("area", f"{result['area']['team']:.1%}, {result['area']['base']:.1%} at the base"),
            ("values", json.dumps(values)),
        ]
    )
    rows = [
        (one["name"], "-" if one["t_sim"] is None else number(one["t_sim"], 1), one["why"])
        for one in result["victims"]
    ]
    return f"{top}\n\n{table(('VICTIM', 'FOUND AT', 'CREDIT'), rows)}\n"


def _span(ended: Mapping[str, Any]) -> str:
    if ended["began"] is None:
        return "before it began"
    return f"after {number(ended['t_sim'] - ended['began'], 2)} s"
