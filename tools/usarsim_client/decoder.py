"""From a line of the server to typed values, in both dialects; never raises, keeps nothing.

Values declare what they are made of (`declared`); here stands which lines become which. What nobody
knows comes as `Other` or `Unknown`, so nothing is lost and nobody crashes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from usarsim_client import readings, reports
from usarsim_client.declared import build
from usarsim_client.depth import DepthPicture
from usarsim_client.segments import Message, read, read_unbalanced
from usarsim_client.sensing import read_sensors

Value = readings.Reading | reports.Report | DepthPicture
"""Whatever a line can tell."""

VEHICLES = frozenset(
    {
        *("groundvehicle", "aerialvehicle", "nauticvehicle", "leggedrobot", "leggedvehicle"),
        *("basemachine", "staticplatform", ""),
    }
)
"""Types of vehicles in CONF and GEO, lower case; UDK left it out of some."""


def decode(line: bytes, now: float = math.nan) -> list[Value]:
    """All that a line tells.

    Args:
        line: without its end.
        now: simulated s, for what tells no time.

    Returns:
        A value for each sensor of a batch; otherwise one; none for a blank line.
    """
    message = read(line)
    head = message.head
    if head == "SEN":
        return [*read_sensors(message, message.time(now))]
    if head == "STA" and not (message.first("time") or message.type):
        return [_objects(line)]
    if head in _READERS:
        return [_READERS[head](message, message.time(now))]
    return [_other(message)] if head or message.segments else []


def _other(message: Message) -> Value:
    return reports.Other(message.head, tuple(message.segments))


def _objects(line: bytes) -> Value:
    """Objects of a world controller, also those of UDK, whose braces do not match."""
    items = read_unbalanced(line).items()
    named = (build(reports.ObjectStatus, item, item.name) for item in items if item.name)
    return reports.ObjectList(tuple(named))


def _status(message: Message, time: float) -> Value:
    item = message.item
    if "walking" in item.fields:
        return build(reports.AvatarStatus, item, item.name, time)
    return build(reports.Status, item, time)


def _configuration(message: Message, time: float) -> Value:
    kind = message.type
    if kind.lower() in VEHICLES:
        return build(reports.VehicleConfiguration, message.item)
    items = [item for item in message.items() if item.name or item.segments]
    if kind.lower() == "camera":
        return reports.CameraConfigurations(tuple(map(reports.camera, items)))
    found = (build(reports.ItemConfiguration, item, item.name) for item in items)
    return reports.Configuration(kind, tuple(found))


def _geometry(message: Message, time: float) -> Value:
    kind = message.type
    if kind.lower() in VEHICLES:
        return build(reports.VehicleGeometry, message.item)
    items = [item for item in message.items() if item.name or item.segments]
    return reports.Geometry(
        kind, tuple(build(reports.ItemGeometry, item, item.name) for item in items)
    )


def _information(message: Message, time: float) -> Value:
    item, places = message.item, tuple(message.segments[1:])
    match item.fields:
        case {"startposes": _}:
            return reports.StartPoses(reports.start_poses(places))
        case {"pathnodes": _}:
            return reports.PathNodes(reports.start_poses(places))
        case {"pathnode": _}:
            return build(reports.ClosestNode, item)
        case {"status": status} if status.lower() == "tick":
            return reports.Tick(time)
        case {"status": _}:
            return build(reports.Event, item, item.name, time)
        case {"gametype": _} | {"level": _}:
            return build(reports.Greeting, item)
    return _other(message)


def _named(kind: type[Value]) -> Callable[[Message, float], Value]:
    """Reads lines of one item that tell its name and a time."""
    return lambda message, time: build(kind, message.items()[0], message.item.name, time)


_READERS: Mapping[str, Callable[[Message, float], Value]] = {
    "STA": _status,
    "MISSTA": _named(reports.MissionState),
    "ASTA": _named(reports.MissionState),
    "EFF": _named(reports.EffectorState),
    "BSTA": _named(reports.AvatarBones),
    "CONF": _configuration,
    "GEO": _geometry,
    "RES": lambda message, time: build(reports.Result, message.item, message.item.name, time),
    "NFO": _information,
    "DIE": lambda message, time: build(reports.Death, message.item),
}
"""What makes values of the lines of a head, beside SEN."""
