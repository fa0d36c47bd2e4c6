"""Where robots can be put, each place for one check at a time."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_conformance.clock import SimulatedClock, Stalled
from usarsim_conformance.lines import Line, number, numbers

APART = 1.5
"""m between two places, so that robots can drive a little."""
LEAVES = 1.0
"""s of simulated time in which the robot of a closed connection leaves (protocol reference 6.1,
no. 13)."""


@dataclass(frozen=True, slots=True)
class Place:
    """A start pose."""

    tag: str | None  # of the map; None for coordinates
    location: tuple[float, ...] = (0.0, 0.0, 0.0)  # m, wire frame
    rotation: tuple[float, ...] = (0.0, 0.0, 0.0)  # roll, pitch, yaw, rad

    @property
    def segments(self) -> str:
        """Segments of INIT that lead there."""
        return f"{{Start {self.tag}}}" if self.tag is not None else self.coordinates

    @property
    def coordinates(self) -> str:
        """Segments of INIT that lead there by coordinates."""
        location, rotation = (
            ",".join(f"{value:.4f}" for value in values)
            for values in (self.location, self.rotation)
        )
        return f"{{Location {location}}} {{Rotation {rotation}}}"

    @property
    def is_tilted(self) -> bool:
        """Whether it has a roll or a pitch of more than 0.01 rad."""
        turns = [angle for angle in self.rotation[:2] if math.isfinite(angle)]
        return any(abs(math.remainder(angle, math.tau)) > 0.01 for angle in turns)

    def moved(self, forward: float = 0.0, right: float = 0.0, down: float = 0.0) -> Place:
        """A place beside this one, m in the directions of its yaw, facing the same way."""
        x, y, z = self.location
        cos, sin = math.cos(self.rotation[2]), math.sin(self.rotation[2])
        x, y = x + cos * forward - sin * right, y + sin * forward + cos * right
        return Place(None, (x, y, z + down), self.rotation)


class Places:
    """Hands out places and takes them back; a place rests until its robot must be gone."""

    def __init__(self, places: Sequence[Place], clock: SimulatedClock) -> None:
        self.all = tuple(places)
        self._clock = clock
        self._resting: set[asyncio.Task[None]] = set()
        self._free = deque(places)
        self._changed = asyncio.Condition()

    async def take(self, last: bool) -> Place:
        """The next free place; waits for one.

        Checks that each have a place and wait for a second one would wait for ever if they had all:
        the last free place is not for those that have none, unless it is the only one there is.

        Args:
            last: whether it may be the last free one.
        """
        kept = 0 if last or len(self.all) == 1 else 1
        async with self._changed:
            await self._changed.wait_for(lambda: len(self._free) > kept)
            return self._free.popleft()

    def give_back(self, place: Place) -> None:
        """Take a place back when its connection has been closed."""
        rests = asyncio.create_task(self._rest(place))
        self._resting.add(rests)
        rests.add_done_callback(self._resting.discard)

    async def _rest(self, place: Place) -> None:
        with contextlib.suppress(Stalled):
            await self._clock.sleep(LEAVES)
        async with self._changed:
            self._free.append(place)
            self._changed.notify_all()


def read_start_poses(line: Line) -> list[Place]:
    """Places of a reply to GETSTARTPOSES, in any of the known forms (protocol reference 4.2)."""
    words = " ".join(f"{name} {value}" for name, value in line.segments[1:]).split()
    words = [word for word in words if word not in ("Name", "Location", "Orientation")]
    return [
        Place(tag, numbers(location), numbers(rotation))
        for tag, location, rotation in zip(words[0::3], words[1::3], words[2::3], strict=False)
        if len(numbers(location)) == 3 and len(numbers(rotation)) == 3
    ]


def spaced(places: Sequence[Place], apart: float = APART) -> list[Place]:
    """Those that keep clear of all before them, and of poses that are no numbers."""
    kept: list[Place] = []
    for place in places:
        if all(map(math.isfinite, place.location + place.rotation)) and all(
            math.dist(place.location[:2], other.location[:2]) >= apart for other in kept
        ):
            kept.append(place)
    return kept


def place_from(text: str) -> Place:
    """What a user names: the tag of a start pose, or `x,y,z` with or without a yaw behind.

    Raises:
        ValueError: for coordinates that are none.
    """
    if "," not in text:
        return Place(text.strip())
    values = [number(part.strip()) for part in text.split(",")]
    if len(values) not in (3, 4) or not all(map(math.isfinite, values)):
        raise ValueError(f"{text!r} is neither a start pose nor x,y,z")
    return Place(None, tuple(values[:3]), (0.0, 0.0, values[3] if len(values) == 4 else 0.0))
