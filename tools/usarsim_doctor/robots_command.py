"""`usarsim robots`: what robot classes there are, what one is, whether a robot file is good.

`--check FILE` shows what a robot file makes, before any client meets it.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_server.base import logs
from usarsim_server.base.errors import RobotDescriptionError, UsarsimError, at
from usarsim_server.base.files import data_directory
from usarsim_server.base.tables import nearest
from usarsim_server.cli.common import (
    Subparsers,
    add_command,
    facts,
    number,
    numbers,
    table,
    written,
)
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import (
    ActuatorDescription,
    CameraDescription,
    ItemDescription,
    RobotDescription,
)
from usarsim_server.simulation.frames import wire_from_pose

if TYPE_CHECKING:
    from usarsim_doctor.test_drive import Rest, TestDrive
    from usarsim_server.robots.catalog import RobotFile


_EPILOG = (
    "--check reads a robot file and what it extends, shows all that clients will be told, builds "
    "the robot, lets it down onto a floor and drives it at full speed; the exit code is 2 if "
    "anything is wrong. --page writes a Markdown page, and a picture of every class into "
    "images/robots beside it."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `robots` to the command line."""
    parser = add_command(
        subparsers, "robots", "list the robot classes, describe or check one", run, epilog=_EPILOG
    )
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument("name", metavar="NAME", nargs="?", help="class to describe")
    chosen.add_argument("--check", metavar="FILE", type=Path, help="try out a robot file")
    chosen.add_argument("--page", metavar="FILE", type=Path, help="write a page of all classes")
    parser.add_argument("--out", metavar="PNG", type=Path, help="with --check: draw the robot")
    parser.add_argument(
        "--robots",
        metavar="DIR",
        action="append",
        default=[],
        help="folder with further robot files; may be repeated",
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the list, or the details of one class, or what a robot file makes.

    Raises:
        UsarsimError: for a class or a file that cannot be used.
    """
    from usarsim_server.robots.catalog import load_catalog

    folders = [Path(folder) for folder in arguments.robots]
    if arguments.out is not None and arguments.check is None:
        raise UsarsimError("--out is the picture of --check FILE (cure: add --check FILE)")
    if arguments.check is not None:
        return check(arguments.check, folders, arguments.out)
    if arguments.page is not None:
        from usarsim_doctor.robot_page import write

        return write(arguments.page, folders)
    catalog = load_catalog(folders)
    if arguments.name is None:
        print(listing(catalog.descriptions()))
        return 0
    robot = catalog.find(arguments.name)
    if robot is None:
        raise RobotDescriptionError(_unknown(arguments.name, catalog.names()))
    print("\n\n".join(details(robot)))
    return 0


def listing(robots: Iterable[RobotDescription]) -> str:
    """One line per class."""
    rows = [
        (robot.name, robot.dialect.value, robot.kind, robot.description)
        for robot in sorted(robots, key=lambda robot: robot.name.lower())
    ]
    return table(("CLASS", "ERA", "KIND", "DESCRIPTION"), rows)


def details(robot: RobotDescription) -> Iterator[str]:
    """Blocks that describe a class."""
    yield f"{robot.name}: {robot.description}"
    yield facts(_facts(robot))
    if robot.actuators:
        rows = [row for actuator in robot.actuators for row in _links(actuator)]
        yield table(("ACTUATOR", "LINK", "JOINT", "MOVES", "LIMITS", "SPEED", "TORQUE"), rows)
    if robot.effectors:
        rows = [
            (one.name, one.item.type, "loose" if one.detached else one.item.link or "-")
            for one in robot.effectors
        ]
        yield table(("EFFECTOR", "TYPE", "LINK"), rows)
    if robot.items:
        yield "Sensors are mounted in the wire frame: x forward, y right, z down, in m and rad."
        rows = [_item(item) for item in robot.items]
        yield table(("SENSOR", "TYPE", "LINK", "LOCATION", "ROTATION", "PARAMETERS"), rows)
    if robot.cameras:
        rows = [_camera(camera) for camera in robot.cameras]
        yield table(("CAMERA", "LINK", "LOCATION", "ROTATION", "FOV", "ZOOM", "RATE"), rows)


def _facts(robot: RobotDescription) -> Iterator[tuple[str, object]]:
    report = robot.report
    yield "file", robot.source
    yield "era", robot.dialect.value
    yield "kind", robot.kind
    wheeled = report.wheel_radius > 0.0
    if wheeled:
        yield "wheel radius", f"{number(report.wheel_radius, 4)} m"
        yield "track width", f"{number(report.track_width, 4)} m"
        yield "wheel base", f"{number(report.wheel_base, 4)} m"
    yield "mass", f"{number(report.mass, 4)} kg"
    if wheeled:
        speed, driven = robot.drive.max_wheel_speed, robot.driven_wheels
        # Tracked robots may announce another radius than that of their sprockets.
        ground = number(speed * (driven[0].radius if driven else report.wheel_radius))
        yield "wheel speed", f"at most {number(speed, 4)} rad/s, {ground} m/s on the ground"
    yield "rest height", f"{number(robot.rest_height, 4)} m"
    yield "battery", f"{robot.battery.life:g} s" if robot.battery is not None else "none"


def _links(actuator: ActuatorDescription) -> Iterator[tuple[str, ...]]:
    for link in actuator.links:
        limits = "none" if link.limits is None else numbers(link.limits, 4)
        speed, torque = number(link.max_speed, 4), number(link.max_torque, 4)
        kind = link.type.value.lower()
        yield actuator.name, link.body, link.joint, kind, limits, speed, torque


def _item(item: ItemDescription) -> tuple[str, ...]:
    location, rotation = wire_from_pose(item.pose)
    parameters = " ".join(f"{key}={_parameter(value)}" for key, value in item.parameters.items())
    link = item.link or "-"
    return item.name, item.type, link, numbers(location, 4), numbers(rotation, 4), parameters


def _camera(camera: CameraDescription) -> tuple[str, ...]:
    location, rotation = wire_from_pose(camera.pose)
    place = (numbers(location, 4), numbers(rotation, 4))
    zoom = f"{number(camera.min_fov, 4)} to {number(camera.max_fov, 4)}"
    rate = "-" if camera.rate is None else f"{camera.rate:g}"
    return camera.name, camera.link or "-", *place, number(camera.fov, 4), zoom, rate


def _parameter(value: object) -> str:
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:g}"
    return str(value)


def _unknown(name: str, names: Sequence[str]) -> str:
    close = nearest(name.rpartition(".")[2], names)
    cure = f"did you mean {close}?" if close else f"known: {', '.join(names)}"
    return f"there is no robot class {name!r} ({cure})"


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
        UsarsimError: if the robot does not stand and drive as it should, or the picture cannot be
            written.
    """
    from usarsim_doctor.test_drive import TestDrive
    from usarsim_server.cameras.encoding import encode_png

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
            with written(picture) as png:
                png.write(encode_png(drive.portrait(WIDTH, HEIGHT)))
        speed = drive.top_speed()
        problems = drive.problems(rest, speed)
    print(facts(_behaviour(rest, speed)))
    for problem in problems:
        print(f"WRONG: {problem.text}")
    if problems:
        first = problems[0]
        raise RobotDescriptionError(at(path, first.text, first.cure))
    return 0


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
