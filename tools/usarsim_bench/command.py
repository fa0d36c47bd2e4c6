"""`usarsim bench`: how many robots, cameras and INITs this machine holds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from usarsim_bench.capacity import measure_cameras, measure_inits, measure_robots
from usarsim_bench.figures import Plan, Report, Section, describe_machine
from usarsim_bench.report import as_json, as_markdown, as_text
from usarsim_bench.server import BenchError
from usarsim_server import __version__
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command, written

MEASUREMENTS: dict[str, Callable[[Plan], Section]] = {
    "robots": measure_robots,
    "cameras": measure_cameras,
    "inits": measure_inits,
}
_EPILOG = (
    "Each measurement starts servers of its own, on free ports, and takes the clients' side "
    "itself. Let nothing else run meanwhile. All three take some four minutes."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `bench`."""
    parser = add_command(
        subparsers,
        "bench",
        "how many robots, cameras and INITs this machine holds",
        run,
        epilog=_EPILOG,
    )
    parser.add_argument(
        "measurements",
        metavar="MEASUREMENT",
        nargs="*",
        help=f"{', '.join(MEASUREMENTS)} (default: all)",
    )
    parser.add_argument(
        "--robots", metavar="N", type=between(1, 256), help="only this size (default: several)"
    )
    parser.add_argument(
        "--seconds",
        metavar="S",
        type=between(0.5, 600),
        help="wall time of each size (default 10)",
    )
    parser.add_argument(
        "--world", metavar="NAME|PATH", default="arena", help="world to measure in (default arena)"
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the report as JSON too")
    parser.add_argument("--markdown", metavar="FILE", type=Path, help="and as Markdown")


def between(least: float, most: float) -> Callable[[str], float]:
    """A reader of numbers from one to another; whole ones where the least is whole."""

    def read(text: str) -> float:
        number = int(text) if isinstance(least, int) else float(text)
        if not least <= number <= most:
            raise argparse.ArgumentTypeError(f"must be from {least:g} to {most:g}, not {number:g}")
        return number

    return read


def run(arguments: argparse.Namespace) -> int:
    """Measure, print the report and write it to the files asked for.

    Raises:
        UsarsimError: if a name is unknown, a measurement cannot be taken or a file not be written.
    """
    names = arguments.measurements or list(MEASUREMENTS)
    if unknown := [name for name in names if name not in MEASUREMENTS]:
        raise UsarsimError(
            f"no measurement {unknown[0]!r} (known: {', '.join(MEASUREMENTS)}; measurements for "
            "developers: make bench, in a checkout)"
        )
    plan = Plan(arguments.robots, arguments.seconds, arguments.world, say=say)
    machine, now = describe_machine(__version__), datetime.now(UTC)
    return hand_out(Report(machine, now, tuple(_take(name, plan) for name in names)), arguments)


def hand_out(report: Report, arguments: argparse.Namespace) -> int:
    """Print a report and write it to the files of `--json` and `--markdown`; returns 0.

    Raises:
        UsarsimError: if a file cannot be written, or a measurement could not be taken.
    """
    print(as_text(report))
    for name, form in (("json", as_json), ("markdown", as_markdown)):
        if (file := getattr(arguments, name, None)) is not None:
            with written(file) as page:
                page.write(form(report).encode())
    if report.failed:
        raise UsarsimError(f"could not be measured: {', '.join(report.failed)} (reasons above)")
    return 0


def _take(name: str, plan: Plan) -> Section:
    try:
        return MEASUREMENTS[name](plan)
    except BenchError as error:
        return Section(name, name.capitalize(), "", (), str(error))


def say(text: str) -> None:
    """Print a line of progress to standard error."""
    print(text, file=sys.stderr, flush=True)
