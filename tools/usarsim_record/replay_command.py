"""`usarsim replay`: play the controller's side of a recording, and judge the server's answers."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Sequence
from pathlib import Path

from usarsim_record.digest import Tolerance
from usarsim_record.player import Outcome, play
from usarsim_record.recording import Link, RecordError, Recording, read
from usarsim_server.base.addresses import bare_host
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command, table

_EPILOG = (
    "Exit code 0 if the server said the same as the one that was recorded, but for times and "
    "numbers within the tolerance; 1 if not; 2 for errors."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `replay`."""
    parser = add_command(
        subparsers, "replay", "play a recorded session against a server", run, epilog=_EPILOG
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="recording of `usarsim record`")
    parser.add_argument(
        "--host",
        metavar="ADDR",
        type=bare_host,
        help="server to play against (default: the recorded one)",
    )
    parser.add_argument(
        "--port",
        metavar="[PORT=]PORT",
        action="append",
        default=[],
        help="port of the server, of the first one recorded; or, with two numbers, that of the "
        "server instead of a recorded one; may be repeated",
    )
    parser.add_argument(
        "--speed",
        metavar="X",
        type=_positive,
        default=1.0,
        help="times as fast, where no simulated time is told (default 1)",
    )
    parser.add_argument(
        "--patience",
        metavar="S",
        type=_positive,
        default=20.0,
        help="simulated seconds to wait for an answer that the controller had (default 20)",
    )
    defaults = Tolerance()
    for name, help_text in (
        ("relative", "part by which numbers may differ"),
        ("absolute", "what numbers may differ by in any case"),
        ("rate", "part by which lines per simulated second may differ"),
    ):
        default = getattr(defaults, name)
        parser.add_argument(
            f"--{name}",
            metavar="X",
            type=_positive,
            default=default,
            help=f"{help_text} (default {default:g})",
        )


def run(arguments: argparse.Namespace) -> int:
    """Play and print the table of verdicts.

    Raises:
        UsarsimError: if the file is no recording or the server cannot be reached.
    """
    try:
        recording = read(arguments.file)
        if not recording.events:
            raise RecordError(f"{arguments.file}: nothing was recorded")
        links = _links(recording, arguments.host, arguments.port)
        tolerance = Tolerance(
            relative=arguments.relative, absolute=arguments.absolute, rate=arguments.rate
        )
        outcome = asyncio.run(
            play(
                recording,
                dict(enumerate(links)),
                speed=arguments.speed,
                patience=arguments.patience,
                tolerance=tolerance,
            )
        )
    except RecordError as error:
        raise UsarsimError(str(error)) from None
    print(_report(recording, outcome))
    return 0 if outcome.passed else 1


def _report(recording: Recording, outcome: Outcome) -> str:
    ports = {number: recording.links[link].port for number, link in recording.connections.items()}
    rows = [
        (
            row.connection,
            ports[row.connection],
            row.kind,
            row.recorded,
            row.replayed,
            "same" if row.passed else "DIFFERS",
            row.difference,
        )
        for row in outcome.rows
    ]
    heads = ("connection", "port", "what", "then", "now", "verdict", "difference")
    wrong = sum(not row.passed for row in outcome.rows)
    last = f"{wrong} of {len(rows)} differ" if wrong else f"all {len(rows)} the same"
    late = f", {outcome.late:.1f} s longer now" if outcome.late >= 0.05 else ""
    return f"{table(heads, rows)}\n\n{last}; {recording.seconds:.1f} s recorded{late}"


def _links(recording: Recording, host: str | None, ports: Sequence[str]) -> list[Link]:
    """Where to connect, by link.

    Raises:
        UsarsimError: for ports that are none or were not recorded.
    """
    found = [Link(link.listen, host or link.host, link.port) for link in recording.links]
    for text in ports:
        old, equals, new = text.rpartition("=")
        if not new.isdecimal() or not 0 < int(new) < 65536 or (equals and not old.isdecimal()):
            raise UsarsimError(f"--port: {text!r} is neither PORT nor PORT=PORT")
        fits = [
            index
            for index, link in enumerate(recording.links)
            if (not equals and index == 0) or (equals and int(old) in (link.port, link.listen))
        ]
        if not fits:
            known = ", ".join(str(link.port) for link in recording.links)
            raise UsarsimError(f"--port: {old} was not recorded (recorded are {known})")
        for index in fits:
            found[index] = Link(found[index].listen, found[index].host, int(new))
    return found


def _positive(text: str) -> float:
    number = float(text)
    if not 0.0 < number < 1e6:
        raise argparse.ArgumentTypeError("must be above 0")
    return number
