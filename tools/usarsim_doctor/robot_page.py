"""`usarsim robots --page FILE`: a page with a picture and the figures of every robot class."""

from __future__ import annotations

import itertools
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usarsim_server import logs
from usarsim_server.cli.common import number
from usarsim_server.errors import UsarsimError
from usarsim_server.files import data_directory, replacing, write_text
from usarsim_server.toml import read_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from usarsim_server.robots.catalog import RobotFile
    from usarsim_server.robots.description import RobotDescription


WIDTH, HEIGHT = 240, 180
"""Of a picture, pixels."""
_FINER = 3
"""A picture is drawn so many times larger, then made smaller, so that edges are smooth."""
_COLORS = 96
PICTURES = Path("images", "robots")
"""Beside the page."""

_INTRODUCTION = """# Robots

All {count} classes that ship with the server. Made by `usarsim robots --page docs/robots.md` from \
the robot files in `robots/`, and by trying each robot out on level ground: change those files and \
make the page anew.

Class names are matched in any case, with or without `USARBot.` before them. Top speed is what the \
robot reached at full speed ahead on concrete; size is that of everything that can be seen of it. \
The words above each table are those at the head of the robot file. A "starting value" was chosen \
here, because none has come down: if you know better, write a file that \
[extends](robot-files.md#variants) the class. "Robots reference" is the \
collection of sources that this project was built from.
"""
_KINDS = {
    "skid_steer": "four or more wheels, skid steered",
    "differential": "two driven wheels and casters",
    "ackerman": "car with steered wheels",
    "omni": "wheels driven and steered one by one",
    "tracked": "tracks",
    "aerial": "aircraft",
    "underwater": "submarine",
    "legged": "legs",
    "static": "fixed platform",
}
_DRIVES = {
    "skid_steer": "`Left`, `Right`",
    "differential": "`Left`, `Right`",
    "tracked": "`Left`, `Right`",
    "ackerman": "`Speed`, `FrontSteer`, `RearSteer`",
    "omni": "`WheelNumber`, `WheelSpeed`, `WheelSteer`",
    "aerial": "`LinearVelocity`, `LateralVelocity`, `AltitudeVelocity`, `RotationalVelocity`",
    "underwater": "`Propeller`, `Rudder`, `SternPlane`",
    "legged": "joints only: `MULTIDRIVE`, `DRIVE {Name ...}`, `SET {Type Joint}`",
    "static": "-",
}
_ERAS = {"ut2004": "UT2004", "udk": "UDK"}
_FRAME = re.compile(r"Frame of this file:.*?kilograms\.\s*|Frame of this file:.*?radians\.\s*")


def write(path: Path, folders: Sequence[Path]) -> int:
    """Write the page and its pictures; returns the exit code.

    Args:
        path: the Markdown file; pictures go into `images/robots` beside it.
        folders: of further robot files.

    Raises:
        UsarsimError: if a robot file cannot be used or a file cannot be written.
    """
    logs.configure("error")
    files = read_files(folders)
    pictures = path.parent / PICTURES
    sections = []
    try:
        pictures.mkdir(parents=True, exist_ok=True)
        for file in files:
            print(file.description.name, file=sys.stderr, flush=True)
            sections.append(_section(file, pictures))
        parts = [_INTRODUCTION.format(count=len(files)), _index(files), *sections]
        write_text(path, "\n".join(parts))
    except OSError as error:
        raise UsarsimError(
            f"{error.filename or path}: cannot be written: {error.strerror} (name a file in a "
            "folder that exists and may be written to)"
        ) from error
    return 0


def read_files(folders: Sequence[Path]) -> list[RobotFile]:
    """The files of all classes by name, where several folders have one the last."""
    from usarsim_server.robots.catalog import Library

    layers = Library([data_directory("robots"), *folders]).layers()
    by_name = {file.description.name.lower(): file for layer in layers for file in layer}
    return [by_name[name] for name in sorted(by_name)]


def _index(files: Sequence[RobotFile]) -> str:
    """A table of all classes."""
    lines = ["| Class | Era | Kind | Description |", "|---|---|---|---|"]
    for file in files:
        robot = file.description
        era, kind = _ERAS[robot.dialect.value], _kind(robot)
        link = f"[{robot.name}](#{robot.name.lower()})"
        lines.append(f"| {link} | {era} | {kind} | {robot.description} |")
    return "\n".join(lines) + "\n"


def _kind(robot: RobotDescription) -> str:
    return _KINDS.get(robot.kind, robot.kind)


def _section(file: RobotFile, pictures: Path) -> str:
    """Everything about one class; draws its picture."""
    from usarsim_doctor.test_drive import TestDrive

    robot = file.description
    with TestDrive(robot) as drive:
        drive.rest()
        size, visible = drive.size(), drive.visible()
        picture = pictures / f"{robot.name}.png"
        if visible:
            _save(drive.portrait(_FINER * WIDTH, _FINER * HEIGHT), picture)
        speed = drive.top_speed()
    rows = list(_rows(file, size, speed))
    lines = [f"## {robot.name}", ""]
    if visible:
        lines += [f"![{robot.name}]({(PICTURES / picture.name).as_posix()})", ""]
    lines += [head_comment(robot.source), "", "| | |", "|---|---|"]
    lines += [f"| {name} | {value} |" for name, value in rows if value]
    return "\n".join(lines) + "\n"


def _rows(
    file: RobotFile, size: tuple[float, float, float], speed: float | None
) -> Iterator[tuple[str, str]]:
    robot = file.description
    names = [*file.aliases, *file.alias_patterns, *file.exact_aliases]
    yield "Also called", ", ".join(f"`{name}`" for name in names)
    yield "Era", f"{_ERAS[robot.dialect.value]} (dialect `{robot.dialect.value}` at first)"
    yield "Kind", f"`{robot.kind}`: {_kind(robot)}"
    yield "DRIVE", _DRIVES.get(robot.kind, "")
    if any(size):
        yield "Size", " x ".join(number(side) for side in size) + " m"
    if robot.kind != "static":
        yield "Mass", f"{number(robot.report.mass, 1)} kg"
    if robot.wheels:
        wheels = [wheel for wheel in robot.driven_wheels if wheel.collides]
        base = robot.report.wheel_base
        yield "Wheel radius", f"{number(wheels[0].radius, 4)} m" if wheels else ""
        yield "Track", f"{number(robot.report.track_width, 4)} m"
        yield "Wheel base", f"{number(base, 4)} m" if base else ""
    if speed is not None:
        yield "Top speed", f"{number(speed)} m/s"
    yield from _carried(robot)
    if robot.battery is not None:
        yield "Battery", f"{robot.battery.life:g} s"


def _carried(robot: RobotDescription) -> Iterator[tuple[str, str]]:
    kinds: dict[str, list[str]] = {}
    for item in robot.items:
        kinds.setdefault(item.type, []).append(item.name)
    yield "Sensors", "; ".join(f"{kind} {_names(names)}" for kind, names in kinds.items())
    yield "Cameras", _names([camera.name for camera in robot.cameras])
    packages = [one for one in robot.actuators if one.package]
    yield (
        "Mission packages",
        ", ".join(f"`{one.name}` ({_joints(len(one.links))})" for one in packages),
    )
    bare = [link.joint for one in robot.actuators if not one.package for link in one.links]
    yield "Other joints", _names(bare)
    hands = [f"`{one.name}` ({one.item.type})" for one in robot.effectors]
    yield "Effectors", ", ".join(hands)


def _joints(count: int) -> str:
    return "1 joint" if count == 1 else f"{count} joints"


def _names(names: Sequence[str]) -> str:
    """Names, or the first and last of many."""
    shown = [f"`{name}`" for name in names]
    if len(shown) > 8:
        return f"{shown[0]} ... {shown[-1]} ({len(shown)})"
    return ", ".join(shown)


def head_comment(path: Path) -> str:
    """The comment at the head of a robot file, without its mark and without the frame."""
    text = read_text(path, UsarsimError)
    lines = itertools.takewhile(lambda line: line.startswith("#"), text.splitlines())
    blocks = "\n".join(line.removeprefix("#").strip() for line in lines).split("\n\n")
    paragraphs = [_FRAME.sub("", " ".join(block.split())).strip() for block in blocks]
    return "\n\n".join(paragraph for paragraph in paragraphs if paragraph)


def _save(picture: NDArray[Any], path: Path) -> None:
    from PIL import Image

    small = Image.fromarray(picture).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
    few = small.quantize(_COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    with replacing(path) as file:
        few.save(file, format="PNG", optimize=True)
