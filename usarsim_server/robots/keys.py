"""What the keys of robot files have in common: limits, points, names, poses.

Files are in the wire frame (x forward, y right, z down); what is read here is in the simulation
frame.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from usarsim_server.base.tables import Table, suggest
from usarsim_server.protocol.values import Vector
from usarsim_server.simulation.frames import Pose, flip_point, pose_from_wire

Color = tuple[float, float, float, float]

# Beyond these a number is a slip of the pen, and MuJoCo would refuse it far from its origin.
LONGEST = 100.0  # m
SHORTEST = 1e-4  # m
HEAVIEST = 1e5  # kg
LIGHTEST = 1e-3  # kg, of anything that moves by itself
FASTEST = 1e4  # rad/s
STRONGEST = 1e6  # N m, N

GREY: Color = (0.5, 0.5, 0.5, 1.0)


def opaque(channels: Sequence[float]) -> Color:
    """A colour that may lack its alpha."""
    red, green, blue, alpha = (*channels, 1.0)[:4]
    return red, green, blue, alpha


# What declared fields have in common.
SIZE: dict[str, Any] = {"low": SHORTEST, "high": LONGEST, "unit": "m"}
POINT: dict[str, Any] = {"low": -LONGEST, "high": LONGEST, "unit": "m", "convert": flip_point}
MASS: dict[str, Any] = {"low": 0.0, "high": HEAVIEST, "unit": "kg"}
CHANNELS: dict[str, Any] = {"low": 0.0, "high": 1.0, "counts": (3, 4), "convert": opaque}
STRENGTH: dict[str, Any] = {"low": 1e-3, "high": STRONGEST}
RAMP: dict[str, Any] = {"low": 1e-3, "high": 1e6, "unit": "rad/s^2"}
ORIGIN: Vector = (0.0, 0.0, 0.0)

RESERVED_NAMES = frozenset({"base", "free"})
"""The chassis body and its joint; no wheel may take these names."""

PART_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
WORD = re.compile(r"[^\s{}]+")
"""Item names and types on the wire."""


def read_axis(table: Table, key: str) -> Vector:
    """A direction of a robot file as a unit vector."""
    axis = flip_point(table.vector(key, low=-LONGEST, high=LONGEST))
    length = math.hypot(*axis)
    if length < 1e-6:
        raise table.error(key, "has no direction", "write a vector such as [0, 0, 1]")
    x, y, z = (value / length + 0.0 for value in axis)
    return x, y, z


def part_name(table: Table) -> str:
    """The name of a wheel, a link or an actuator."""
    name = table.text("name")
    if not PART_NAME.fullmatch(name) or name.lower() in RESERVED_NAMES:
        cure = "use letters, digits and _, first a letter, not base or free"
        raise table.error("name", f"is {name!r}", cure)
    return name


def read_link(table: Table, links: Sequence[str]) -> str | None:
    """The link that carries something, as it is spelt where it is made; None: the chassis."""
    link = table.text("link", "")
    known = {known.lower(): known for known in links}
    if link and link.lower() not in known:
        raise table.error("link", f"no link {link!r}", suggest(link, links))
    return known[link.lower()] if link else None


def read_pose(table: Table) -> Pose:
    """The keys `position` and `rotation`, which are in the wire frame."""
    location = table.vector("position", (0.0, 0.0, 0.0), low=-LONGEST, high=LONGEST)
    rotation = table.vector("rotation", (0.0, 0.0, 0.0), low=-1000.0, high=1000.0)
    return pose_from_wire(location, rotation)
