"""What pictures show of a step: everything that is drawn, and nothing that goes on changing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.cycle import BASE, Body, Cycle
from usarsim_exploration.environment import Cell
from usarsim_exploration.history import History, cells
from usarsim_exploration.known_map import FREE, WALL
from usarsim_exploration.radio import Radio
from usarsim_exploration.rendezvous import Meeting, candidates, ranked, reaching, sampled
from usarsim_exploration.running import Result
from usarsim_exploration.scenario import Scenario
from usarsim_exploration.strategy import Role

Cells = NDArray[np.int64]
"""(n, 2) columns and rows."""


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """Out of what an explorer chose where to meet its relay.

    Attributes:
        goal: frontier that it visits before. candidates: junctions and other cells of the skeleton.
        finalists: the nearest ones to the goal, one of which was taken.
        samples: cells that were considered for the relay; none where both come to one place.
        heard: those from which it expects to be heard at the meeting point.
    """

    goal: Cell
    candidates: Cells
    finalists: tuple[Cell, ...]
    samples: Cells
    heard: Cells


@dataclass(frozen=True, slots=True)
class Belief:
    """Where a robot thinks that another one is, and since when."""

    number: int
    cell: Cell
    heard: int


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """One robot, or the base.

    Attributes:
        name, role, state, cell, heading, works: as in a `History`. parent: number, or None.
        reach: of its radio, cells. own: free cells that it has to bring to the base itself.
        goal, path: where it wants to go, and the cells that are left of the way.
        meeting: what it agreed upon. selection: out of what, if it chose. beliefs: of teammates.
    """

    name: str
    role: Role
    state: str
    cell: Cell
    heading: float
    works: bool
    parent: int | None
    reach: float
    own: int
    goal: Cell | None
    path: NDArray[np.int32]
    meeting: Meeting | None
    selection: Selection | None
    beliefs: tuple[Belief, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A step of a run.

    Attributes:
        title: of the run. step: which. figures: the base first. links: (n, 2) who hears whom.
        layers: (1 + bodies, rows, columns) the true walls (1), and what each knows (bits).
        driven: by step and body the (n, 2) cells that it drove to; the start first.
        team, base: shares of the reachable cells that they know, percent.
        radio: of all. cell: width of one, m.
    """

    title: str
    step: int
    figures: tuple[Figure, ...]
    links: Cells
    layers: NDArray[np.uint8]
    driven: Sequence[Sequence[Cells]]
    team: float
    base: float
    radio: Radio
    cell: float

    @property
    def walls(self) -> NDArray[np.uint8]:
        """The true ones, (rows, columns)."""
        found: NDArray[np.uint8] = self.layers[0]
        return found

    def trail(self, number: int) -> Cells:
        """(n, 2) all cells that a body drove through so far."""
        return np.concatenate([row[number] for row in self.driven])

    def known(self, robot: int | None) -> NDArray[np.uint8]:
        """Bits of what a robot knows; None: of what anybody knows, free where anybody saw it so."""
        if robot is not None:
            found: NDArray[np.uint8] = self.layers[1 + robot]
            return found
        union: NDArray[np.uint8] = np.bitwise_or.reduce(self.layers[1:])
        union[union & FREE != 0] &= ~np.uint8(WALL)
        return union


def scene_of(result: Result) -> Scene:
    """How a run ended."""
    cycle, history = result.cycle, result.history
    return Scene(
        title_of(result.scenario),
        cycle.step,
        tuple(figure_of(body, None) for body in cycle.bodies),
        links_of(cycle),
        layers_of(cycle),
        [driven_in(history, step) for step in range(history.steps + 1)],
        100 * int(history.known_team[-1]) / int(history.reachable[-1]),
        100 * int(history.known_base[-1]) / int(history.reachable[-1]),
        result.scenario.radio,
        cycle.environment.cell,
    )


def title_of(scenario: Scenario) -> str:
    """A scenario in few words."""
    name = scenario.world.environment.name
    return f"{name}, {scenario.strategy_name}, seed {scenario.basics.seed}"


def figure_of(body: Body, selection: Selection | None) -> Figure:
    """How a body is drawn now."""
    view = body.view
    mates = sorted(view.teammates.items())
    return Figure(
        view.name, view.role, body.state, view.cell, view.heading, body.works, view.parent,
        body.member.radio_range if body.works else 0.0, view.known.undelivered, body.goal,
        np.array(view.path, np.int32).reshape(-1, 2), meeting_of(body), selection,
        tuple(Belief(one, mate.cell, mate.heard) for one, mate in mates if mate.heard >= 0),
    )  # fmt: skip


def layers_of(cycle: Cycle) -> NDArray[np.uint8]:
    """Walls and maps as they are now."""
    maps = [body.view.known.bits for body in cycle.bodies]
    return np.stack([(cycle.environment.walls != 0).astype(np.uint8), *maps])


def driven_by(body: Body, step: int) -> Cells:
    """Cells that a body drove to in a step; at the start, where it stands."""
    moves = body.moves if body.works else []
    if step == 0:
        moves = [body.view.cell]
    elif moves and moves[-1] != body.view.cell:
        moves = moves[:-1]  # in vain
    return np.array(moves, np.int64).reshape(-1, 2)


def driven_in(history: History, step: int) -> list[Cells]:
    """The same of all, out of a history."""
    if step == 0:
        return list(history.cell[0][:, None])
    found = []
    for number, text in enumerate(history.moves[step]):
        column, row = history.cell[step - 1, number].tolist()
        moves = cells((column, row), str(text))
        found.append(np.array(moves[:-1] if "x" in text else moves, np.int64).reshape(-1, 2))
    return found


def links_of(cycle: Cycle) -> Cells:
    """Who hears whom, the smaller number first."""
    return np.argwhere(np.triu(cycle.links.direct, 1))


def meeting_of(body: Body) -> Meeting | None:
    """What a robot of a role-based strategy has agreed upon."""
    found = getattr(body.strategy, "meeting", None)
    return found if isinstance(found, Meeting) else None


def selection_of(body: Body) -> Selection | None:
    """Out of what a robot chose where to meet, by its map as it is now; None: it did not choose."""
    view, meeting = body.view, meeting_of(body)
    goal = getattr(body.strategy, "aim", None)
    if meeting is None or goal is None or view.role != "explorer" or view.parent in (BASE, None):
        return None
    density = getattr(body.strategy, "density", None)
    places, _ = candidates(view)
    samples = np.empty((0, 2), np.int64) if density is None else sampled(view, density)
    heard = samples[reaching(view, samples, meeting.place)] if len(samples) else samples
    return Selection(goal, places, tuple(ranked(view, goal)), samples, heard)
