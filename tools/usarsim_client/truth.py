"""Rows of the truth channel as typed values (docs/scene-port.md, "Truth").

MuJoCo's frame: x forward, y left, z up; metres, radians, seconds of simulated time, quaternions
w, x, y, z.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Point = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Contact:
    """Something that a robot has touched since the row before."""

    kind: str  # world, robot or victim
    name: str  # of the other one; empty if a part of the world has none
    time: float  # of the first touch, s


@dataclass(frozen=True, slots=True)
class TrueRobot:
    """A robot at one instant; velocities are in the frame of the world."""

    name: str
    pos: Point  # m
    quat: Quaternion
    linear: Point  # m/s
    angular: Point  # rad/s
    battery: float | None  # share that is left, 0 to 1; None: it has none
    contacts: tuple[Contact, ...]


@dataclass(frozen=True, slots=True)
class TrueVictim:
    """A victim at one instant."""

    name: str
    pos: Point  # of its reference point, as in the world file, m


@dataclass(frozen=True, slots=True)
class View:
    """A victim before a robot's camera."""

    robot: str
    victim: str
    angle: float  # off the axis of the camera, rad
    distance: float  # m
    clear: bool  # at least one part of the victim is in sight


@dataclass(frozen=True, slots=True)
class TruthRow:
    """What is true at one instant.

    Attributes:
        fields: the whole message, as it came.
        time: simulated s.
        state: digest of all coordinates and velocities of the world; equal worlds, equal digests.
        robots: in the order of their names. victims: in that of the world file.
        views: victims that are before a camera.
    """

    fields: Mapping[str, Any]
    time: float
    state: str
    robots: tuple[TrueRobot, ...]
    victims: tuple[TrueVictim, ...]
    views: tuple[View, ...]


def truth_row(fields: Mapping[str, Any]) -> TruthRow:
    """A row from its message, as the channel or a log of it has it.

    Raises:
        KeyError, TypeError, ValueError: if it is none.
    """
    robots = tuple(
        TrueRobot(
            str(one["name"]),
            _point(one["pos"]),
            _quaternion(one["quat"]),
            _point(one["linear"]),
            _point(one["angular"]),
            None if one["battery"] is None else float(one["battery"]),
            tuple(
                Contact(str(touch["with"]), str(touch["name"]), float(touch["time"]))
                for touch in one["contacts"]
            ),
        )
        for one in fields["robots"]
    )
    victims = tuple(TrueVictim(str(one["name"]), _point(one["pos"])) for one in fields["victims"])
    views = tuple(
        View(
            str(one["robot"]),
            str(one["victim"]),
            float(one["angle"]),
            float(one["distance"]),
            bool(one["clear"]),
        )
        for one in fields["views"]
    )
    time, state = float(fields["time"]), str(fields.get("state", ""))
    return TruthRow(fields, time, state, robots, victims, views)


def _point(values: Any) -> Point:
    x, y, z = map(float, values)
    return x, y, z


def _quaternion(values: Any) -> Quaternion:
    w, x, y, z = map(float, values)
    return w, x, y, z
