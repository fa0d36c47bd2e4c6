"""`usarsim robots`: what robot classes there are, what one is, whether a robot file is good."""

from __future__ import annotations

import argparse
import difflib
import math
from collections.abc import Iterable, Iterator
from pathlib import Path

from usarsim_server.cli.common import Subparsers, add_command, facts, number, numbers, table
from usarsim_server.errors import RobotDescriptionError, UsarsimError
from usarsim_server.robots.description import (
    ActuatorDescription,
    CameraDescription,
    ItemDescription,
    RobotDescription,
)
from usarsim_server.simulation.frames import wire_from_pose

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
        from usarsim_server.cli.robot_check import check

        return check(arguments.check, folders, arguments.out)
    if arguments.page is not None:
        from usarsim_server.cli.robot_page import write

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


def _unknown(name: str, names: Iterable[str]) -> str:
    by_lower = {known.lower(): known for known in names}
    wanted = name.rpartition(".")[2].lower()
    close = difflib.get_close_matches(wanted, by_lower, n=1)
    cure = f"did you mean {by_lower[close[0]]}?" if close else f"known: {', '.join(names)}"
    return f"there is no robot class {name!r} ({cure})"
