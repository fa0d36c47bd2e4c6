"""Where and when an explorer and its relay meet next (exploration reference 12.4).

A good place is near where the explorer goes next, and where many ways lead: junctions of the
skeleton of known free space. De Hoog, Cameron and Visser, "Selection of rendezvous points for
multi-robot exploration in dynamic environments".
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.errors import scipy
from usarsim_exploration.known_map import FREE, WALL
from usarsim_exploration.planning import degrees, key_cells, skeleton
from usarsim_exploration.strategy import Teammate, View

SPACING = 50.0
"""Cells between candidates along a skeleton."""
FARTHEST = 600.0
"""Cells in a straight line from the frontier to a candidate."""
FINALISTS = 4
"""Of so many that are near the frontier the way is measured."""
PATIENCE = 60
"""Steps that robots wait for each other, and the least time until they meet."""
AT_FRONTIER = 75
"""Steps that an explorer is granted at its frontier."""

Cells = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Meeting:
    """What two robots have agreed upon.

    Attributes:
        place: of the explorer. relay_place: where the relay hears it. time: step.
        backup, backup_time: where and when next, if one of them does not come.
    """

    place: Cell
    relay_place: Cell
    time: int
    backup: Cell | None = None
    backup_time: int = 0

    def told(self) -> dict[str, Any]:
        """As a letter has it."""
        return asdict(self)

    @classmethod
    def heard(cls, letter: Mapping[str, Any]) -> Meeting | None:
        """That of a letter, if there is one."""
        told = letter.get("meeting")
        return cls(**told) if told else None

    def missed(self) -> Meeting | None:
        """What holds when somebody did not come."""
        if self.backup is None:
            return None
        return Meeting(self.backup, self.backup, self.backup_time)


def candidates(view: View) -> tuple[Cells, NDArray[np.int64]]:
    """Cells of the skeleton where one could meet, and how many ways lead from each."""
    bits = view.known.bits & (FREE | WALL)
    return _candidates(bits.tobytes(), bits.shape)


@lru_cache(maxsize=4)
def _candidates(known: bytes, shape: tuple[int, int]) -> tuple[Cells, NDArray[np.int64]]:
    """Of a map; explorers that hear each other know the same, and ask for it one by one."""
    bits = np.frombuffer(known, np.uint8).reshape(shape)
    bones = skeleton((bits == FREE).astype(np.uint8))
    cells = key_cells(bones, bits & WALL != 0, spacing=SPACING)
    return cells, degrees(bones)[cells[:, 1], cells[:, 0]].astype(np.int64)


def ranked(view: View, goal: Cell) -> list[Cell]:
    """The best places to meet before or after a frontier is visited; the best first.

    Of the `FINALISTS` nearest in a straight line, by degree^2 x 10000 / way to the frontier.
    """
    cells, degree = candidates(view)
    away = np.hypot(*(cells - goal).T)
    order = np.argsort(away, kind="stable")
    order = order[away[order] <= FARTHEST][:FINALISTS]
    ways = view.planner.field(goal).distances(cells[order])
    values = degree[order] ** 2 * 1e4 / np.maximum(ways, 1.0)
    best = [index for index in np.argsort(-values, kind="stable") if np.isfinite(ways[index])]
    return [(int(c), int(r)) for c, r in cells[order][best]]


def single_point(view: View, relay: Teammate, goal: Cell) -> Meeting:
    """Both come to the same place.

    Args:
        view: of the explorer. relay: whom it meets. goal: the frontier that it visits before.
    """
    found = ranked(view, goal) or [view.cell]
    place = found[0]
    frontier, base = view.planner.field(goal), view.planner.field(view.base)
    shuttle = (base.distance(relay.cell) + base.distance(place)) / relay.speed
    visit = (frontier.distance(view.cell) + frontier.distance(place)) / view.speed
    time = view.step + _steps(max(PATIENCE, shuttle, visit + AT_FRONTIER))
    return with_backup(view, relay, Meeting(place, place, time), found[1:])


def sampled(view: View, density: float) -> Cells:
    """One cell of known free space per `density`, spread evenly by Sobol's sequence, and the base.

    Returns:
        (n, 2) columns and rows, the base last; the same for the same map.
    """
    bits = view.known.bits
    free = bits & (FREE | WALL) == FREE
    rows, columns = np.nonzero(free)
    wanted = int(len(rows) / density)
    found = np.empty((0, 2), np.int64)
    if wanted:
        corner = np.array([columns.min(), rows.min()])
        size = np.array([columns.max(), rows.max()]) + 1 - corner
        share = len(rows) / float(size.prod())
        # as many points at once as are likely to be enough; powers of two keep the sequence even
        power = math.ceil(math.log2(2 * wanted / share + 2))
        while len(found) < wanted:
            points = scipy("stats").qmc.Sobol(2, scramble=False).random_base2(power)
            cells = np.floor(points * size).astype(np.int64) + corner
            cells = cells[free[cells[:, 1], cells[:, 0]]]
            _, first = np.unique(cells, axis=0, return_index=True)
            found = cells[np.sort(first)][:wanted]
            power += 1
    return np.concatenate([found, np.array([view.base])])


def multi_point(view: View, relay: Teammate, goal: Cell, density: float) -> Meeting:
    """Each comes to a place of its own, from where they hear each other, through a wall perhaps.

    The explorer's is that of `single_point`. The relay's is, of the sampled cells that are expected
    to hear it, the one with the shortest way to where the base is heard.

    Args:
        view: of the explorer. relay: whom it meets. goal: the frontier that it visits before.
        density: free cells for each sampled one.
    """
    found = ranked(view, goal) or [view.cell]
    place = found[0]
    cells = sampled(view, density)
    zone = cells[reaching(view, cells, view.base)]
    zone_field = view.planner.field(*((int(c), int(r)) for c, r in zone))
    heard = cells[reaching(view, cells, place)]
    ways = zone_field.distances(heard)
    relay_place = place
    if len(heard) and np.isfinite(ways).any():
        column, row = heard[int(ways.argmin())]
        relay_place = int(column), int(row)
    # the relay tells the base from the zone cell that is nearest to its place, and comes back
    back = view.planner.field(relay_place).distances(zone)
    station = zone[int(back.argmin())]
    there = view.planner.field((int(station[0]), int(station[1])))
    frontier = view.planner.field(goal)
    shuttle = (there.distance(relay.cell) + there.distance(relay_place)) / relay.speed
    visit = (frontier.distance(view.cell) + frontier.distance(place)) / view.speed
    time = view.step + _steps(max(shuttle, visit + AT_FRONTIER))
    return with_backup(view, relay, Meeting(place, relay_place, time), found[1:])


def reaching(view: View, cells: Cells, place: Cell) -> NDArray[np.bool_]:
    """From which cells a robot expects to be heard at a place; there itself at least."""
    same: NDArray[np.bool_] = (cells == place).all(axis=1)
    return same | view.radio.reaches(cells, np.array([place]))[:, 0]


def with_backup(view: View, relay: Teammate, meeting: Meeting, places: list[Cell]) -> Meeting:
    """The next best place, as much later as both wait and drive there."""
    if not places:
        return meeting
    field = view.planner.field(places[0])
    way = max(
        field.distance(meeting.place) / view.speed,
        field.distance(meeting.relay_place) / relay.speed,
    )
    time = meeting.time + PATIENCE + _steps(way)
    return Meeting(meeting.place, meeting.relay_place, meeting.time, places[0], time)


def _steps(time: float) -> int:
    """A time in whole steps; what cannot be reached is not waited for longer than anything else."""
    return math.ceil(time) if math.isfinite(time) else PATIENCE + AT_FRONTIER
