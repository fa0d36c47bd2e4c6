"""Whole depth pictures of the strips in which RangeImager tells them; no sockets, no clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usarsim_client.readings import DepthStrip
from usarsim_client.segments import Array

MOST_STRIPS = 1024
"""Strips of a picture that is put together; a server that tells of more gets none."""
MOST_SENSORS = 16
"""Sensors whose strips are kept at a time."""


@dataclass(frozen=True, slots=True, eq=False)
class DepthPicture:
    """A depth picture.

    Attributes:
        name: of the sensor. time: simulated s of its last strip.
        rows: (height, width) m along the axis of view, from the top and from the left.
        fov: horizontal and vertical, rad, or one number.
    """

    name: str
    time: float
    rows: Array
    fov: tuple[float, ...]


class DepthPictures:
    """Puts strips together as they come; a picture that lacks one is forgotten."""

    def __init__(self) -> None:
        self._held: dict[str, list[DepthStrip]] = {}

    def feed(self, strip: DepthStrip) -> DepthPicture | None:
        """Take a strip; the picture, if it was the last one of it."""
        held = self._held.pop(strip.name.lower(), [])
        if strip.frame == 0:
            held = []
        whole = 1 <= strip.frames <= MOST_STRIPS and len(strip.ranges) > 0
        if not whole or strip.frame != len(held) or (held and _differ(held[-1], strip)):
            return None
        held.append(strip)
        if len(held) < strip.frames:
            if len(self._held) >= MOST_SENSORS:
                del self._held[next(iter(self._held))]
            self._held[strip.name.lower()] = held
            return None
        rows = np.concatenate([one.rows for one in held])
        rows.setflags(write=False)
        return DepthPicture(strip.name, strip.time, rows, strip.fov)


def _differ(one: DepthStrip, other: DepthStrip) -> bool:
    """Whether strips are of pictures of different sizes."""
    return one.frames != other.frames or one.rows.shape[1] != other.rows.shape[1]
