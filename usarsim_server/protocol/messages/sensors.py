"""SEN, GEO and CONF of sensors (protocol reference 4.5, 4.7 and 4.8).

CONF of cameras (protocol reference 4.8, side channels reference 2.10).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.messages.text import (
    count,
    label,
    line,
    listing,
    number,
    segment,
    time_segment,
    triple,
)
from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Item, Vector


class SensorMount(NamedTuple):
    """Where one sensor sits; a plain tuple of the first four does as well."""

    name: str  # item name
    location: Vector  # m, wire frame of the carrier
    rotation: Vector  # roll, pitch, yaw, rad
    mount: str  # `HARD` or the carrying part in `ut2004`; robot class or actuator name in `udk`
    mount_link: int | None = None
    """Link of the actuator that carries the sensor, from 1; `udk` only."""


def sensor_line(
    dialect: Dialect,
    wire_type: str,
    items: Sequence[Item],
    time: float | None = None,
    time_digits: int = 4,
    multi_pair: bool = False,
) -> str:
    """SEN line of one sensor, or of all sensors of a batched type.

    Args:
        dialect: `udk` knows no multi-pair segments, there `multi_pair` is of no effect.
        wire_type: Type, canonical spelling.
        items: what is reported, in mount order; nothing gives an empty text. An item with an
            empty name has no Name segment.
        time: simulated s, None for types without Time.
        time_digits: digits of Time after the point.
        multi_pair: one `{Name n key value ...}` segment per item instead of one per key.
    """
    if not items:
        return ""
    if multi_pair and FACETS[dialect].multi_pair:
        body = [_multi_pair(item) for item in items]
    else:
        body = _separate(items)
    return " ".join([_head(wire_type, time, time_digits), *body])


def reading_line(
    wire_type: str, item: Item, time: float | None = None, time_digits: int = 4
) -> str:
    """SEN line of one sensor that shares it with no other: as `sensor_line`, but faster, for that
    is what nearly all lines are."""
    name, segments = item
    body = [_head(wire_type, time, time_digits)]
    if name:
        body.append(label("Name", name))
    for key, value in segments:
        body.append(segment(key, value))
    return " ".join(body)


@lru_cache(maxsize=256)
def _head(wire_type: str, time: float | None, digits: int) -> str:
    """How a line begins; remembered, because all robots have the same ones at one instant."""
    stamp = () if time is None else (time_segment(time, digits),)
    return line("SEN", *stamp, segment("Type", wire_type))


def sensor_geometry(
    dialect: Dialect,
    wire_type: str,
    mounts: Sequence[SensorMount | tuple[str, Vector, Vector, str]],
) -> str:
    """GEO line of all sensors asked for; nothing gives an empty text."""
    facets = FACETS[dialect]
    body: list[str] = []
    for mount in (SensorMount(*entry) for entry in mounts):
        if facets.batched_geometry:
            location = vector(mount.location, facets.geometry_digits)
            rotation = vector(mount.rotation, facets.geometry_digits)
            pose = f"Location {location} Orientation {rotation}"
            body.append(segment("Name", f"{mount.name} {pose} Mount {mount.mount}"))
        else:
            body += (
                segment("Name", mount.name),
                triple("Location", mount.location, facets.geometry_digits),
                triple("Orientation", mount.rotation, facets.geometry_digits),
                *carrier(mount.mount, mount.mount_link),
            )
    return listing("GEO", wire_type, body)


def configuration(wire_type: str, items: Sequence[Item]) -> str:
    """CONF line of all items asked for, sensors and effectors; nothing gives an empty text."""
    if not items:
        return ""
    return line("CONF", segment("Type", wire_type), *_separate(items))


def carrier(mount: str, mount_link: int | None) -> tuple[str, ...]:
    """Mount, and MountLink where the carrier is a moving link."""
    link = () if mount_link is None else (count("MountLink", mount_link),)
    return (segment("Mount", mount), *link)


def _separate(items: Sequence[Item]) -> list[str]:
    body: list[str] = []
    for name, segments in items:
        if name:
            body.append(label("Name", name))
        for key, value in segments:
            body.append(segment(key, value))
    return body


def _multi_pair(item: Item) -> str:
    words = [f"{key} {value}" if value else key for key, value in item.segments]
    return segment("Name", " ".join((item.name, *words)))


_DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraItem:
    """A camera and the tile of the full picture that it fills."""

    name: str  # item name
    offset: tuple[int, int] = (0, 0)
    """x and y of the tile's upper left corner, pixels; zeros if it has none."""
    resolution: tuple[int, int] = (320, 240)  # width and height of the tile, pixels
    default_fov: float = 1.3963  # horizontal field of view, rad; the last one is the present one
    min_fov: float = 0.3491
    max_fov: float = 2.0944
    fov: float = 1.3963


def camera_configuration(dialect: Dialect, wire_type: str, cameras: Sequence[CameraItem]) -> str:
    """CONF line of all cameras asked for; nothing gives an empty text.

    In `udk` it tells the tiles too, in degrees, and the segments of a camera stand without blanks
    between them as in the original: the one exception to the rule of single blanks, because that
    is the text that programs of that generation cut their pictures by.

    Args:
        dialect: decides on unit, tiles and blanks.
        wire_type: Type as the client spelled it, which `udk` echoed.
        cameras: in mount order.
    """
    degrees = FACETS[dialect].camera_in_degrees
    body = [_tiled(camera) if degrees else _plain(camera) for camera in cameras]
    return listing("CONF", wire_type, body)


def _tiled(camera: CameraItem) -> str:
    (x, y), (width, height) = camera.offset, camera.resolution
    return "".join(
        (
            segment("Name", camera.name),
            count("TextureOffsetX", x),
            count("TextureOffsetY", y),
            count("TextureResolutionX", width),
            count("TextureResolutionY", height),
            *_lens(camera, math.degrees(1.0)),
        )
    )


def _plain(camera: CameraItem) -> str:
    return " ".join((segment("Name", camera.name), *_lens(camera, 1.0)))


def _lens(camera: CameraItem, unit: float) -> tuple[str, ...]:
    return (
        number("CameraDefFov", camera.default_fov * unit, _DIGITS),
        number("CameraMinFov", camera.min_fov * unit, _DIGITS),
        number("CameraMaxFov", camera.max_fov * unit, _DIGITS),
        number("CameraFov", camera.fov * unit, _DIGITS),
    )
