"""`usarsim doctor`: can this machine run the server well, and if not, what mends it?"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TextIO

from usarsim_server.base import logs
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command, written
from usarsim_server.cli.serve import add_settings, settings_from
from usarsim_server.options import OPTIONS

_EPILOG = (
    "It takes the options of `usarsim serve`, and the same file, and looks whether a server with "
    "these would run. The exit code is 0 if so, warnings or not, 1 if something has to be mended "
    "first, and 2 for options that make no sense."
)
_WIDEST = 110
_STDOUT = "-"


def add_parser(subparsers: Subparsers) -> None:
    """Add `doctor` to the command line."""
    parser = add_command(
        subparsers,
        "doctor",
        "find out whether this machine can run the server well, and what mends it if not",
        run,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "--quick", action="store_true", help="changes nothing: rates are measured by usarsim bench"
    )
    parser.add_argument(
        "--json",
        metavar="FILE",
        help="write the report as JSON too; - writes only that, to standard output",
    )
    add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Examine this machine and print the report; returns the exit code.

    Raises:
        UsarsimError: if the settings are wrong or the report cannot be written.
    """
    from usarsim_doctor.examination import all_checks, examine
    from usarsim_doctor.printing import Printer, as_json, counted
    from usarsim_doctor.registry import Context, Mark

    settings = settings_from(arguments)
    logs.configure("error")  # what a log would warn of stands in the report
    context = Context(settings, _given(arguments))
    checks = all_checks()
    if arguments.json == _STDOUT:
        sections = examine(checks, context)
        sys.stdout.write(as_json(sections, datetime.now().astimezone()))
    else:
        width = min(_WIDEST, shutil.get_terminal_size((_WIDEST, 24)).columns)
        printer = Printer(sys.stdout, width, _colored(sys.stdout))
        sections = examine(checks, context, printer)
        printer.end(sections)
        if arguments.json is not None:
            with written(Path(arguments.json)) as file:
                file.write(as_json(sections, datetime.now().astimezone()).encode())
    return 1 if counted(sections, Mark.PROBLEM) else 0


def _given(arguments: argparse.Namespace) -> tuple[tuple[str, str], ...]:
    """The options of the server that were given, flag and text."""
    found = [("--config", arguments.config)] if arguments.config is not None else []
    for option in OPTIONS:
        given = getattr(arguments, option.key, None)
        texts = given if isinstance(given, list) else [given]
        found += [(option.flag, text) for text in texts if text is not None]
    return tuple(found)


def _colored(stream: TextIO) -> bool:
    """Whether colours are seen and wanted (no-color.org)."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return stream.isatty() and not plain


def _alone(argv: Sequence[str]) -> int:
    """Run without the other commands, which need libraries that may be what is missing."""
    parser = argparse.ArgumentParser(prog="python -m usarsim_doctor.command")
    add_parser(parser.add_subparsers(required=True))
    arguments = parser.parse_args(["doctor", *argv])
    try:
        return int(arguments.run(arguments))
    except UsarsimError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(_alone(sys.argv[1:]))
