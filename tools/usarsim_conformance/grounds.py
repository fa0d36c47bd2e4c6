"""Open floor away from the start poses, for robots that need room and checks that build there: lots
that GETOBS has looked over, and lanes out of sight of everybody."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from collections.abc import AsyncIterator
from statistics import fmean

from usarsim_conformance.case import Case
from usarsim_conformance.clock import Stalled
from usarsim_conformance.lines import number
from usarsim_conformance.places import LEAVES, Place
from usarsim_conformance.registry import Inconclusive, NotApplicable
from usarsim_conformance.side_lines import LineClient

YAW = 0.6
"""rad; robots face neither axis of the world, so that exchanged or mirrored axes show."""

_SIDE = 26.0
"""m from lot to lot."""
_REACH = 9.0
"""m that must be free on each side of the middle."""
_STEP = 4.5
_RINGS = 12
_AT_WORK = 8
"""Robots on open floor at a time; each costs the server what one at a start place costs."""
_COUNT = re.compile(r"\{ObstCount ([^{}]*)\}$")

_FAR = 120.0
"""m from the origin of the world to the nearest open floor; beyond every sensor's range of the
start poses, and of each other."""
_LANES = 12
APART = 90.0
"""m between two lanes: cars drive for seconds, and scanners of others reach 20 m and more."""


def lane(case: Case) -> Place:
    """A place of one's own, far from everybody; whether there is floor, who goes there finds."""
    row, column = divmod(next(case.run.lanes) % (_LANES * _LANES), _LANES)
    high = case.survey.places[0].location[2]
    return Place(None, (_FAR + APART * row, APART * (column - _LANES / 2), high))


class _Lots:
    """Hands out lots; looks for the next one when it is wanted."""

    def __init__(self, middle: Place) -> None:
        self.middle = middle
        self.turns = asyncio.Semaphore(_AT_WORK)
        self.free: list[Place] = []
        self.tried = 0
        self.looking = asyncio.Lock()
        self.resting: set[asyncio.Task[None]] = set()  # asyncio itself keeps no task alive
        self.candidates = [
            (i, j)
            for ring in range(1, _RINGS)
            for i in range(-ring, ring + 1)
            for j in range(-ring, ring + 1)
            if max(abs(i), abs(j)) == ring
        ]

    async def take(self, case: Case) -> Place:
        async with self.looking:
            if self.free:
                return self.free.pop()
            client = await LineClient.open(case, "groundtruth")
            try:
                while self.tried < len(self.candidates):
                    i, j = self.candidates[self.tried]
                    self.tried += 1
                    x, y, z = self.middle.location
                    lot = Place(None, (x + _SIDE * i, y + _SIDE * j, z), (0.0, 0.0, YAW))
                    if await _is_open(client, lot):
                        return lot
            finally:
                client.wire.close()
        raise NotApplicable(f"no open floor of {2 * _REACH:g} m beside the start poses")

    async def give_back(self, case: Case, lot: Place) -> None:
        with contextlib.suppress(Stalled):
            await case.clock.sleep(LEAVES)
        self.free.append(lot)


@contextlib.asynccontextmanager
async def open_floor(case: Case) -> AsyncIterator[Place]:
    """The middle of a level, empty piece of floor, 9 m to each side, while inside.

    GETOBS tells what stands there. Start poses stay free for others.

    Raises:
        NotApplicable: if there is none, or no port of ground truth was named.
    """
    if "groundtruth" not in case.target.ports:
        raise NotApplicable("open floor is found by GETOBS, but no port of groundtruth was named")
    places = [place for place in case.run.places.all if any(place.location)]
    if not places:
        raise NotApplicable("the server lists no start poses to look for open floor by")
    try:
        lots = await case.shared("open floor", _lots, dialect="")
    except Inconclusive as error:
        raise NotApplicable(str(error)) from None
    async with lots.turns:
        lot = await lots.take(case)
        try:
            yield lot
        finally:
            task = asyncio.create_task(lots.give_back(case, lot))
            lots.resting.add(task)
            task.add_done_callback(lots.resting.discard)


async def _lots(case: Case) -> _Lots:
    starts = [place.location for place in case.run.places.all]
    x, y = (fmean(start[axis] for start in starts) for axis in (0, 1))
    return _Lots(Place(None, (x, y, starts[0][2])))


async def _is_open(client: LineClient, lot: Place) -> bool:
    offsets = [n * _STEP for n in range(-2, 3)]
    for right in offsets:
        for up in (0.1, 1.0):
            ends = [lot.moved(ahead, right, -up) for ahead in (-_REACH, _REACH)]
            if await _obstacles(client, *ends):
                return False
        for ahead in offsets[::2]:
            if not await _obstacles(
                client, lot.moved(ahead, right, -0.1), lot.moved(ahead, right, 0.8)
            ):
                return False
    return True


async def _obstacles(client: LineClient, start: Place, end: Place) -> float:
    ends = [",".join(f"{value:.4f}" for value in place.location) for place in (start, end)]
    found = _COUNT.search(await client.ask(f"GETOBS {{Start {ends[0]}}} {{End {ends[1]}}}"))
    count = number(found[1]) if found else math.nan
    return count if count >= 0.0 else math.inf
