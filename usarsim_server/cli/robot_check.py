"""`usarsim robots --check FILE`: what a robot file makes, before any client meets it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_server import files as atomic
from usarsim_server import logs
from usarsim_server.cli.common import facts, number, numbers, table
from usarsim_server.cli.robots import details
from usarsim_server.data import data_directory
from usarsim_server.errors import RobotDescriptionError, UsarsimError, at
from usarsim_server.protocol.values import Dialect

if TYPE_CHECKING:
    from usarsim_server.robots.catalog import RobotFile
    from usarsim_server.testing.test_drive import Rest, TestDrive


WIDTH, HEIGHT = 960, 720
"""Of the picture, pixels."""
LONGEST = 240
"""Characters of a line that are shown; scans are longer."""
_TYPE = re.compile(r"\{Type (\w+)\}")


def check(path: Path, folders: Sequence[Path], picture: Path | None) -> int:
    """Print everything about the class of a robot file; returns the exit code.

    Args:
        path: the file; what it extends is looked for beside it, in the folders, and among the
            shipped robots.
        folders: of further robot files.
        picture: PNG file to draw the robot into, or None.

    Raises:
        RobotDescriptionError: if the file or one that it extends cannot be used.
        UsarsimError: if the robot does not stand and drive as it should.
    """
    from usarsim_server.testing.test_drive import TestDrive

    logs.configure("error")
    file = _load(path, folders)
    robot = file.description
    with TestDrive(robot) as drive:
        # Whatever is wrong with the file has been found before anything is printed.
        told = {dialect: [*drive.lines(dialect), *drive.reports(dialect)] for dialect in Dialect}
        for block in details(robot):
            print(block, end="\n\n")
        for dialect, lines in told.items():
            print(f"Clients of the dialect {dialect.value} are told:")
            print(*map(_shortened, lines), sep="\n", end="\n\n")
        rest = drive.rest()
        print(facts(_names(file, drive, told)), end="\n\n")
        if drive.vehicle.sensors:
            print(table(("SENSOR", "SEN TYPE", *_eras()), _sensors(drive)), end="\n\n")
        if picture is not None:
            save(picture, drive, WIDTH, HEIGHT)
        speed = drive.top_speed()
        problems = drive.problems(rest, speed)
    print(facts(_behaviour(rest, speed)))
    for problem in problems:
        print(f"WRONG: {problem.text}")
    if problems:
        first = problems[0]
        raise RobotDescriptionError(at(path, first.text, first.cure))
    return 0


def save(path: Path, drive: TestDrive, width: int, height: int) -> None:
    """Draw a robot into a PNG file.

    Raises:
        UsarsimError: if the file cannot be written.
    """
    from PIL import Image

    try:
        portrait = Image.fromarray(drive.portrait(width, height))
        with atomic.replacing(path) as file:
            portrait.save(file, format="PNG")
    except OSError as error:
        raise UsarsimError(
            f"{path}: cannot be written: {error.strerror} (name a file in a folder that exists)"
        ) from error


def _load(path: Path, folders: Sequence[Path]) -> RobotFile:
    from usarsim_server.robots.catalog import Library

    shipped = data_directory("robots")
    layers = [shipped, *folders]
    if path.parent.resolve() not in [folder.resolve() for folder in layers]:
        layers.append(path.parent)
    here = [folder.resolve() for folder in layers].index(path.parent.resolve())
    return Library(layers).load(layers[here] / path.name, here)


def _shortened(line: str) -> str:
    return line if len(line) <= LONGEST else f"{line[:LONGEST]}... ({len(line)} characters)"


def _names(
    file: RobotFile, drive: TestDrive, told: Mapping[Dialect, Sequence[str]]
) -> Iterator[tuple[str, str]]:
    names = (*file.aliases, *file.alias_patterns, *file.exact_aliases)
    yield "also called", ", ".join(names) or "nothing else"
    for dialect, lines in told.items():
        found = _TYPE.search(next((line for line in lines if line.startswith("STA")), ""))
        yield f"STA in {dialect.value}", f"Type {found[1]}" if found else "without a Type"
    size = drive.size()
    yield "size", f"{number(size[0])} x {number(size[1])} x {number(size[2])} m at rest"


def _eras() -> list[str]:
    return [f"EVERY ({dialect.value})" for dialect in Dialect]


def _sensors(drive: TestDrive) -> Iterator[tuple[str, ...]]:
    for sensor in drive.vehicle.sensors:
        periods = [sensor.interval(dialect) for dialect in Dialect]
        times = [f"{period:g} s" if period > 0.0 else "on demand" for period in periods]
        yield sensor.name, sensor.wire_type, *times


def _behaviour(rest: Rest, speed: float | None) -> Iterator[tuple[str, str]]:
    yield "stands at", f"{number(rest.height, 4)} m"
    yield "leans by", f"{number(math.degrees(rest.tilt))} degrees"
    yield "drifts by", f"{number(1000.0 * rest.drift, 3)} mm/s"
    yield "sinks in by", f"{number(1000.0 * rest.depth, 2)} mm"
    yield "top speed", "it does not drive" if speed is None else f"{numbers([speed], 3)} m/s"
