"""`usarsim bench`: measure speed, latency and memory, or how truly the robots move."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path

from usarsim_bench.figures import Plan, Report
from usarsim_bench.hostile.attackers import ATTACKS
from usarsim_bench.report import as_json, as_markdown, as_text
from usarsim_bench.suite import ALL, LONG, MEASUREMENTS, QUICK, QUICK_SECONDS, take
from usarsim_server import __version__
from usarsim_server import files as atomic
from usarsim_server.cli.common import Subparsers, add_command
from usarsim_server.errors import UsarsimError

_EPILOG = (
    "Measurements start servers of their own, on free ports, and take the clients' side "
    "themselves. Let nothing else run meanwhile: what other programs used is part of the report. "
    "Options may stand before or after the measurement."
)
ATTACKED = "hostile"
"""The measurement that tries many attacks."""
_MOST_ROBOTS = 256
_MOST_SECONDS = 600.0
_MOST_MINUTES = 10000.0


def add_parser(subparsers: Subparsers) -> None:
    """Add `bench` with a subcommand for each measurement."""
    parser = add_command(
        subparsers, "bench", "measure speed, latency and memory", run, epilog=_EPILOG
    )
    _add_options(parser)
    kinds = parser.add_subparsers(title="measurements", metavar="MEASUREMENT")
    _add_measurement(
        kinds,
        "all",
        f"all of the following but {', '.join(LONG)}, peers and fidelity, some 50 minutes (the "
        "default)",
    )
    _add_measurement(
        kinds, "quick", f"the same but for largest, {QUICK_SECONDS:g} s each, some 6 minutes"
    )
    for name, (_, help_text) in MEASUREMENTS.items():
        _add_measurement(kinds, name, help_text)
    # No part of the wheel: only a checkout has the programs for other simulators.
    if importlib.util.find_spec("usarsim_bench.peers") is not None:
        peers = importlib.import_module("usarsim_bench.peers.command")
        peers.add_peers(kinds, lambda parser: _add_options(parser, world=False), _hand_out)
    # Without a prefix that could mark an option everything behind `fidelity` is taken as it is.
    fidelity = kinds.add_parser(
        "fidelity", help="the robots' motion against theory", add_help=False, prefix_chars="\0"
    )
    fidelity.add_argument("arguments", nargs="*")
    fidelity.set_defaults(run=_run_fidelity)


def run(arguments: argparse.Namespace) -> int:
    """Measure, print the report and write it to the files asked for.

    Raises:
        UsarsimError: if a measurement cannot be taken or a file cannot be written.
    """
    name = getattr(arguments, "measurement", "all")
    brief = name == "quick"
    plan = Plan(
        robots=getattr(arguments, "robots", None),
        seconds=getattr(arguments, "seconds", QUICK_SECONDS if brief else None),
        world=getattr(arguments, "world", "arena"),
        say=_say,
        brief=brief,
        attacks=tuple(getattr(arguments, "attack", ())),
    )
    names = {"all": ALL, "quick": QUICK}.get(name, (name,))
    report = take(names, plan, __version__)
    return _hand_out(report, arguments)


def _hand_out(report: Report, arguments: argparse.Namespace) -> int:
    print(as_text(report))
    _write(report, getattr(arguments, "json", None), as_json)
    _write(report, getattr(arguments, "markdown", None), as_markdown)
    if report.failed:
        raise UsarsimError(f"could not be measured: {', '.join(report.failed)} (reasons above)")
    return 0


def _add_measurement(kinds: Subparsers, name: str, help_text: str) -> None:
    parser = add_command(kinds, name, help_text, run)
    _add_options(parser)
    if name == ATTACKED:
        parser.add_argument(
            "--attack",
            metavar="NAME",
            nargs="+",
            choices=sorted(ATTACKS),
            default=argparse.SUPPRESS,
            help=f"try only these: {', '.join(ATTACKS)}",
        )
    if name in LONG:
        parser.add_argument(
            "--minutes",
            metavar="M",
            dest="seconds",
            type=_minutes,
            default=argparse.SUPPRESS,
            help="length of the measurement (default: 60)",
        )
    parser.set_defaults(measurement=name)


def _add_options(parser: argparse.ArgumentParser, world: bool = True) -> None:
    # No defaults here: those of a subparser would replace what stood before its name.
    def add(flag: str, metavar: str, kind: Callable[[str], object], help_text: str) -> None:
        parser.add_argument(
            flag, metavar=metavar, type=kind, default=argparse.SUPPRESS, help=help_text
        )

    add("--robots", "N", _robots, f"size of the team, 1 to {_MOST_ROBOTS} (default: its own)")
    add("--seconds", "S", _seconds, "length of each measurement (default: its own)")
    if world:
        add("--world", "NAME|PATH", str, "world to measure in (default arena)")
    add("--json", "FILE", Path, "write the report as JSON too")
    add("--markdown", "FILE", Path, "write the report as Markdown too")


def _run_fidelity(arguments: argparse.Namespace) -> int:
    from usarsim_bench.fidelity import fidelity

    return fidelity.main(arguments.arguments)


def _write(report: Report, file: Path | None, form: Callable[[Report], str]) -> None:
    if file is None:
        return
    try:
        atomic.write_text(file, form(report))
    except OSError as error:
        raise UsarsimError(
            f"{file}: cannot be written: {error.strerror} (name a file in a folder that exists)"
        ) from error


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _robots(text: str) -> int:
    number = int(text)
    if not 1 <= number <= _MOST_ROBOTS:
        raise argparse.ArgumentTypeError(f"must be from 1 to {_MOST_ROBOTS}, not {number}")
    return number


def _minutes(text: str) -> float:
    minutes = float(text)
    if not 0.0 < minutes <= _MOST_MINUTES:
        raise argparse.ArgumentTypeError(f"must be above 0 and at most {_MOST_MINUTES:g}")
    return 60.0 * minutes


def _seconds(text: str) -> float:
    number = float(text)
    if not 0.0 < number <= _MOST_SECONDS:
        raise argparse.ArgumentTypeError(f"must be above 0 and at most {_MOST_SECONDS:g}")
    return number
