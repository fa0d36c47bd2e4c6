"""Value types that the wire speaks: dialects, segments, vectors. No behaviour beyond that."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

Vector = tuple[float, float, float]
"""Wire frame: x forward, y right, z down in metres, or roll, pitch, yaw in rad."""

Segment = tuple[str, str]
"""Key and already formatted value of one `{Key value}` pair; an empty value prints `{Key}`."""


class Dialect(Enum):
    """Shape of the server's output. `auto` is not a dialect but a way to choose one."""

    UT2004 = "ut2004"
    UDK = "udk"

    # Every line looks things up by the dialect; members are single, so identity will do.
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class Item:
    """A named item of a line (one sensor, one actuator) with its data segments in wire order."""

    name: str
    segments: tuple[Segment, ...] = ()
