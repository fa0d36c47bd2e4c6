"""`usarsim bench`: how many robots, cameras and INITs this machine holds."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from usarsim_bench.capacity import measure_cameras, measure_inits, measure_robots
from usarsim_bench.figures import Report, Section, as_json, as_text, describe_machine
from usarsim_server import __version__
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command, written

MEASUREMENTS: dict[str, Callable[[str, int | None, float | None], Section]] = {
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
    help_text = "how many robots, cameras and INITs this machine holds"
    parser = add_command(subparsers, "bench", help_text, run, epilog=_EPILOG)
    add, known = parser.add_argument, ", ".join(MEASUREMENTS)
    add("measurements", metavar="MEASUREMENT", nargs="*", help=f"{known} (default: all)")
    robots, seconds = "only this size (default: several)", "wall time of each size (default 10)"
    add("--robots", metavar="N", type=between(1, 256), help=robots)
    add("--seconds", metavar="S", type=between(0.5, 600), help=seconds)
    world = "world to measure in (default arena)"
    add("--world", metavar="NAME|PATH", default="arena", help=world)
    add("--json", metavar="FILE", type=Path, help="write the report as JSON too")


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
    machine, now = describe_machine(__version__), datetime.now(UTC)
    sections = tuple(_take(name, arguments) for name in names)
    return hand_out(Report(machine, now, sections), getattr(arguments, "json", None))


def hand_out(report: Report, file: Path | None) -> int:
    """Print a report and write it to a file as JSON; returns 0.

    Raises:
        UsarsimError: if the file cannot be written, or a measurement could not be taken.
    """
    print(as_text(report))
    if file is not None:
        with written(file) as page:
            page.write(as_json(report).encode())
    if report.failed:
        raise UsarsimError(f"could not be measured: {', '.join(report.failed)} (reasons above)")
    return 0


def _take(name: str, arguments: argparse.Namespace) -> Section:
    try:
        return MEASUREMENTS[name](arguments.world, arguments.robots, arguments.seconds)
    except UsarsimError as error:
        return Section(name, name.capitalize(), "", (), str(error))
