"""`make bench`: measure speed, latency and memory."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from hostile.attackers import ATTACKS

from benchmarks.console import ITEMS
from benchmarks.plan import Plan
from benchmarks.reports import as_markdown
from benchmarks.suite import ALL, LONG, MEASUREMENTS, QUICK, QUICK_SECONDS, take
from usarsim_bench.capacity import say
from usarsim_bench.command import between, hand_out
from usarsim_bench.figures import Report
from usarsim_server import __version__
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command, written

_EPILOG = (
    "Measurements start servers of their own, on free ports, and take the clients' side "
    "themselves. Let nothing else run meanwhile: what other programs used is part of the report. "
    "Options may stand before or after the measurement."
)
_PEERS = "the same work done by other simulators"
_PEERS_EPILOG = (
    "Each of them is installed by pip into an environment of its own, which needs the network. "
    "What cannot be installed here is left out, and the report says why."
)
ATTACKED = "hostile"
"""The measurement that tries many attacks."""
CONSOLE = "console"
"""The measurement of many checks of the operator console."""
HOURS = ("soak",)
"""What is told its length in minutes."""
_MOST_ROBOTS = 256
_MOST_SECONDS = 600.0
_MOST_MINUTES = 10000.0


def main(words: Sequence[str] | None = None) -> int:
    """Take the measurements that a command line names; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="make bench ARGS=...", description="Measure speed, latency and memory.", epilog=_EPILOG
    )
    _add_options(parser)
    parser.set_defaults(run=run)
    kinds = parser.add_subparsers(title="measurements", metavar="MEASUREMENT")
    _add_measurement(
        kinds,
        "all",
        f"all of the following but {', '.join(LONG)} and peers, some 50 minutes (the default)",
    )
    _add_measurement(
        kinds, "quick", f"the same but for largest, {QUICK_SECONDS:g} s each, some 6 minutes"
    )
    for name, (_, help_text) in MEASUREMENTS.items():
        _add_measurement(kinds, name, help_text)
    _add_peers(kinds)
    arguments = parser.parse_args(words)
    try:
        status: int = arguments.run(arguments)
    except UsarsimError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return status


def run(arguments: argparse.Namespace) -> int:
    """Measure, print the report and write it to the files asked for.

    Raises:
        UsarsimError: if a measurement cannot be taken or a file cannot be written.
    """
    name = getattr(arguments, "measurement", "all")
    brief = name == "quick" or getattr(arguments, "quick", False)
    plan = Plan(
        robots=getattr(arguments, "robots", None),
        seconds=getattr(arguments, "seconds", QUICK_SECONDS if name == "quick" else None),
        world=getattr(arguments, "world", "arena"),
        say=say,
        brief=brief,
        only=tuple(getattr(arguments, "only", ())),
    )
    names = {"all": ALL, "quick": QUICK}.get(name, (name,))
    report = take(names, plan, __version__)
    return _hand_out(report, arguments)


def _hand_out(report: Report, arguments: argparse.Namespace) -> int:
    if (file := getattr(arguments, "markdown", None)) is not None:
        with written(file) as page:
            page.write(as_markdown(report).encode())
    return hand_out(report, getattr(arguments, "json", None))


def _add_measurement(kinds: Subparsers, name: str, help_text: str) -> None:
    parser = add_command(kinds, name, help_text, run)
    _add_options(parser)
    if name == ATTACKED:
        parser.add_argument(
            "--attack",
            dest="only",
            metavar="NAME",
            nargs="+",
            choices=sorted(ATTACKS),
            default=argparse.SUPPRESS,
            help=f"try only these: {', '.join(ATTACKS)}",
        )
    if name == CONSOLE:
        listed = ", ".join(f"{key} ({what})" for key, what in ITEMS.items())
        parser.add_argument(
            "only",
            metavar="ITEM",
            nargs="*",
            type=_item,
            default=argparse.SUPPRESS,
            help=f"measure only these: {listed}",
        )
        parser.add_argument(
            "--quick", action="store_true", help="everything briefly, some 6 minutes instead of 30"
        )
    if name in HOURS:
        parser.add_argument(
            "--minutes",
            metavar="M",
            dest="seconds",
            type=_above_zero(_MOST_MINUTES, 60.0),
            default=argparse.SUPPRESS,
            help="length of the measurement (default: 60)",
        )
    parser.set_defaults(measurement=name)


def _add_peers(kinds: Subparsers) -> None:
    parser = add_command(kinds, "peers", _PEERS, _run_peers, epilog=_PEERS_EPILOG)
    _add_options(parser, world=False)
    parser.add_argument(
        "--only", metavar="NAME", action="append", help="compare with this one; may be repeated"
    )
    parser.add_argument(
        "--keep",
        metavar="DIR",
        type=Path,
        help="keep their environments there and use them again (default: thrown away)",
    )


def _run_peers(arguments: argparse.Namespace) -> int:
    from benchmarks.peers import comparing

    if hasattr(arguments, "world"):
        raise UsarsimError("--world: all simulators get the same hall (leave the option out)")
    plan = Plan(
        robots=getattr(arguments, "robots", None),
        seconds=getattr(arguments, "seconds", None),
        say=say,
    )
    only = tuple(arguments.only or ())
    return _hand_out(comparing.compare(plan, __version__, only, arguments.keep), arguments)


def _add_options(parser: argparse.ArgumentParser, world: bool = True) -> None:
    # No defaults here: those of a subparser would replace what stood before its name.
    def add(flag: str, metavar: str, kind: Callable[[str], object], help_text: str) -> None:
        parser.add_argument(
            flag, metavar=metavar, type=kind, default=argparse.SUPPRESS, help=help_text
        )

    add(
        "--robots",
        "N",
        between(1, _MOST_ROBOTS),
        f"size of the team, 1 to {_MOST_ROBOTS} (default: its own)",
    )
    add(
        "--seconds",
        "S",
        _above_zero(_MOST_SECONDS),
        "length of each measurement (default: its own)",
    )
    if world:
        add("--world", "NAME|PATH", str, "world to measure in (default arena)")
    add("--json", "FILE", Path, "write the report as JSON too")
    add("--markdown", "FILE", Path, "write the report as Markdown too")


def _item(text: str) -> str:
    if text.lower() not in ITEMS:
        raise argparse.ArgumentTypeError(f"no item {text} (choose from {', '.join(ITEMS)})")
    return text.lower()


def _above_zero(most: float, unit: float = 1.0) -> Callable[[str], float]:
    """What reads a number of units, s each, that is at most so much; returns s."""

    def read(text: str) -> float:
        number = float(text)
        if not 0.0 < number <= most:
            raise argparse.ArgumentTypeError(f"must be above 0 and at most {most:g}")
        return unit * number

    return read


if __name__ == "__main__":
    sys.exit(main())
