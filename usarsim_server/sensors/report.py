"""From sensors to lines: SEN of those that just measured, answers to GETGEO and GETCONF.

Functions; the readings are in the sensors. Which instances share a line, which lines carry
Time and how item names look follows from the classes and the dialect (protocol reference 4.5,
4.7, 4.8).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby

from usarsim_server.protocol.messages import (
    SensorMount,
    configuration,
    reading_line,
    sensor_geometry,
    sensor_line,
)
from usarsim_server.protocol.values import Dialect, Item
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.mounting import carried
from usarsim_server.sensors.base import Sensor
from usarsim_server.simulation.frames import wire_from_pose
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState


def sen_lines(sensors: Sequence[Sensor], time: float, dialect: Dialect) -> list[str]:
    """SEN lines of the sensors that have just measured something, without line ends.

    Args:
        sensors: in mount order; only those whose `measure` returned True.
        time: simulated s of the measurement.
        dialect: decides on batching, Time and names.

    Returns:
        One line per sensor, or one per type for batched types, where the first of them stands.
    """
    lines: list[str] = []
    done: set[str] = set()
    for sensor in sensors:
        kind = sensor.wire_type
        stamp = time if dialect in sensor.timed else None
        digits = sensor.time_digits[dialect]
        if dialect not in sensor.batched:
            lines.append(reading_line(kind, sensor.item(dialect), stamp, digits))
        elif kind not in done:
            done.add(kind)
            items = [one.item(dialect) for one in sensors if one.wire_type == kind]
            lines.append(sensor_line(dialect, kind, items, stamp, digits, multi_pair=True))
    return lines


def geo_line(
    sensors: Sequence[Sensor],
    wire_type: str,
    name: str | None,
    robot: RobotDescription,
    dialect: Dialect,
) -> str | None:
    """The answer to GETGEO: all sensors of a type, or the named one; None if there is none.

    Poses are those of the mount: relative to the body, whatever the robot's pose in the world, or
    relative to the link that carries the sensor.
    """
    found = find_sensors(sensors, wire_type, name, dialect)
    if not found:
        return None
    mounts = []
    for sensor in found:
        pose, mount, link = carried(sensor.mount, sensor.link, robot, dialect)
        location, rotation = wire_from_pose(pose)
        mounts.append(SensorMount(sensor.wire_name(dialect), location, rotation, mount, link))
    return sensor_geometry(dialect, found[0].wire_type, mounts)


def conf_line(
    sensors: Sequence[Sensor], wire_type: str, name: str | None, dialect: Dialect
) -> str | None:
    """The answer to GETCONF: all sensors of a type, or the named one; None if there is none."""
    found = find_sensors(sensors, wire_type, name, dialect)
    if not found:
        return None
    items = [Item(sensor.wire_name(dialect), sensor.configuration(dialect)) for sensor in found]
    return configuration(found[0].wire_type, items)


def find_sensors(
    sensors: Sequence[Sensor], wire_type: str, name: str | None, dialect: Dialect
) -> list[Sensor]:
    """Sensors of a type that clients of a dialect know, in mount order.

    With a name only those that bear it in any dialect. Types and names are compared without case. A
    nickname counts if no sensor bears the name.
    """
    wanted = wire_type.strip().lower()
    found = [
        sensor
        for sensor in sensors
        if (sensor.wire_type.lower() == wanted or wanted in sensor.aliases)
        and sensor.known_in(dialect)
    ]
    if name is None:
        return found
    asked = name.strip().lower()
    exact = [sensor for sensor in found if asked in _names(sensor)]
    return exact or [sensor for sensor in found if asked in sensor.nicknames]


def _names(sensor: Sensor) -> set[str]:
    return {sensor.name.lower(), *(sensor.wire_name(dialect).lower() for dialect in Dialect)}


class Readings:
    """Sensors of one robot that measure together, again and again."""

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        """Put sensors together, given in mount order."""
        self._groups = [tuple(alike) for _, alike in groupby(sensors, type)]

    def begin(
        self, state: RobotState, dialect: Dialect
    ) -> tuple[list[RayFan], Callable[[Sequence[RayHits]], list[str]]]:
        """Take readings: the rays they need now, and what makes SEN lines of the answers.

        Args:
            state: of their robot.
            dialect: of the lines.
        """
        begun = [alike[0].begin(alike, state) for alike in self._groups]

        def finish(hits: Sequence[RayHits]) -> list[str]:
            measured: list[Sensor] = []
            begin = 0
            for rays, measure in begun:
                end = begin + len(rays)
                measured += measure(hits[begin:end])
                begin = end
            return sen_lines(measured, state.time, dialect)

        return [fan for rays, _ in begun for fan in rays], finish
