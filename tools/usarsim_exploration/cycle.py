"""The cycle of a run: decide, move and scan, link, exchange, count; the same for every strategy.

All robots decide on what they knew at the end of the last step, and messages are written before any
is read, so the order of robots changes nothing (exploration reference 4 and 16).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.exchange import Exchange
from usarsim_exploration.kernels import count_first
from usarsim_exploration.known_map import KnownMap
from usarsim_exploration.messages import letter_size
from usarsim_exploration.noise import disturb
from usarsim_exploration.planning import Planner
from usarsim_exploration.radio import Links, Radio, RadioEstimate, find_links
from usarsim_exploration.sensing import Scanner
from usarsim_exploration.strategy import BASE as BASE
from usarsim_exploration.strategy import Letter, Plan, Role, Strategy, Teammate, View


@dataclass(frozen=True, slots=True)
class Member:
    """One robot of a team, or its base (number 0, first in the list).

    Attributes:
        name, role: who. cell, heading: start, rad clockwise from the right.
        speed: cells per step. reach: of the scanner, cells; 0: it has none.
        view: angle of the scanner, rad. noise: standard deviation of its readings, cells.
        radio_range: cells. parent, child: numbers, or None.
    """

    name: str
    role: Role
    cell: Cell
    heading: float = 0.0
    speed: float = 3.0
    reach: int = 100
    view: float = math.pi
    radio_range: float = 200.0
    parent: int | None = BASE
    child: int | None = None
    noise: float = 0.0


@dataclass(slots=True)
class Body:
    """A robot in the world, and what is counted of it.

    Attributes:
        random: of the noise of its scanner. distance: driven, cells.
        found: cells that this step's scans found.
        first: how many of these nobody knew. base_step: newest step of the base that it has heard
            of. works: it has not failed. state, goal, home: of its plan. moves: cells that it drove
            to in this step, and the one that it tried in vain.
    """

    member: Member
    view: View
    strategy: Strategy | None
    scanner: Scanner | None
    random: np.random.Generator
    distance: float = 0.0
    found: int = 0
    first: int = 0
    base_step: int = 0
    works: bool = True
    state: str = "start"
    goal: Cell | None = None
    home: bool = False
    saved: float = 0.0
    moves: list[Cell] = field(default_factory=list)

    def entry(self, step: int, letter: Letter) -> Teammate:
        """What its messages say of it."""
        view = self.view
        return Teammate(
            view.number, view.name, view.role, view.speed, view.cell, self.state, self.goal, step,
            letter, letter_size(letter),
        )  # fmt: skip


@dataclass(slots=True)
class Cycle:
    """A run.

    Attributes:
        environment: true. bodies: the base first. radio: of all.
        links_before: links are those of before the moves (MRESim), not after.
        links: of the last step. step: how many were made.
        team_free: how many cells anybody knows to be free, and are.
        messages: what is told, and how much.
        begin: told what begins, `plan`, `sense` or `communicate`, for whoever takes times.
    """

    environment: Environment
    bodies: list[Body]
    radio: Radio
    messages: Exchange
    links_before: bool = False
    step: int = 0
    team_free: int = 0
    begin: Callable[[str], None] = lambda phase: None
    links: Links = field(init=False)
    _team: NDArray[np.uint8] = field(init=False)

    def __post_init__(self) -> None:
        self._team = np.zeros(self.environment.walls.size, np.uint8)
        self.links = self._find_links()
        for body in self.bodies:
            self._scan(body, [body.view.cell], [body.view.heading], False)
        self._exchange()

    @property
    def cells_sent(self) -> int:
        """Entries of maps in all messages so far."""
        return self.messages.cells_sent

    @property
    def bytes_sent(self) -> int:
        """Size of all messages so far."""
        return self.messages.bytes_sent

    def advance(self) -> None:
        """One step."""
        self.step += 1
        if self.links_before:
            self.begin("communicate")
            self.links = self._find_links()
        for body in self.bodies:
            if body.works and body.strategy is not None:
                self._act(body, body.strategy)
        self.begin("communicate")
        if not self.links_before:
            self.links = self._find_links()
        self._exchange()

    # -- robots -------------------------------------------------------------------------------

    def _act(self, body: Body, strategy: Strategy) -> None:
        """Decide, drive as far as the speed allows, scan at every cell."""
        view = body.view
        view.step = self.step
        self.begin("plan")
        plan = strategy.decide(view)
        if plan is not None:
            self._adopt(body, plan)
        self.begin("sense")
        body.found = body.first = 0
        driven, headings, budget = [], list[float](), view.speed + body.saved
        blocked, felt, may_move = None, list[Cell](), self.environment.may_move
        while view.path:
            column, row = view.path[0]
            right, down = column - view.cell[0], row - view.cell[1]
            price = math.hypot(right, down)
            if price > budget + 1e-9:
                break
            if not may_move(view.cell, (column, row)):
                blocked = (column, row)
                felt = self._felt(view.cell, blocked)
                break
            budget -= price
            view.path.pop(0)
            view.cell, view.heading = (column, row), math.atan2(down, right)
            body.distance += price
            driven.append(view.cell)
            headings.append(view.heading)
        # who is slower than a diagonal saves for it; else nobody drives more than the speed
        body.saved = budget if view.path and not driven and blocked is None else 0.0
        view.blocked = blocked is not None
        body.moves = driven if blocked is None else [*driven, blocked]
        cells = driven or [view.cell]
        self._scan(body, cells, headings or [view.heading], bool(driven))
        if blocked is not None:
            for cell in felt:
                view.known.bump(self.step, cell)
            view.path.clear()
        view.planner.forget()

    def _adopt(self, body: Body, plan: Plan) -> None:
        body.view.path = list(plan.path)
        body.state, body.home = plan.state, plan.home
        body.goal = plan.goal or (plan.path[-1] if plan.path else None)

    def _felt(self, start: Cell, goal: Cell) -> list[Cell]:
        """The walls that keep a robot from a neighbour."""
        rows, columns = self.environment.shape
        return [
            (column, row)
            for column, row in dict.fromkeys((goal, (goal[0], start[1]), (start[0], goal[1])))
            if 0 <= column < columns
            and 0 <= row < rows
            and max(abs(column - start[0]), abs(row - start[1])) == 1
            and self.environment.walls[row, column]
        ]

    def _scan(
        self, body: Body, cells: Sequence[Cell], headings: Sequence[float], driven: bool
    ) -> None:
        if body.scanner is None:
            return
        known, member = body.view.known, body.member
        if member.noise:
            scans = body.scanner.scan(cells, headings)
            shape = self.environment.shape
            scans = disturb(scans, member.noise, member.reach, shape, body.random)
            found = known.take_in(self.step, scans, driven)
        else:
            found = known.look(self.step, body.scanner, cells, headings, driven)
        walls = self.environment.walls.reshape(-1)
        body.found = len(found)
        body.first, free = count_first(self._team, walls, known.bits.reshape(-1), found)
        self.team_free += free

    # -- radio --------------------------------------------------------------------------------

    def _find_links(self) -> Links:
        cells = [body.view.cell for body in self.bodies]
        ranges = [body.member.radio_range if body.works else 0.0 for body in self.bodies]
        return find_links(self.radio, self.environment, cells, ranges, self.step)

    def _exchange(self) -> None:
        self.messages.trade(self.step, self.bodies, self.links, self.environment)


def set_up(
    environment: Environment,
    team: Sequence[Member],
    strategy: Strategy,
    radio: Radio,
    seed: int,
    *,
    links_before: bool = False,
) -> Cycle:
    """A run at its start. strategy: a pattern, which each robot gets a copy of."""
    seeds = np.random.SeedSequence(seed).spawn(2 * len(team) + 1)
    thinking, losing, noise = seeds[: len(team)], seeds[len(team)], seeds[len(team) + 1 :]
    scanners: dict[tuple[int, float], Scanner] = {}
    bodies = []
    for number, member in enumerate(team):
        known = KnownMap(environment.shape)
        estimate = RadioEstimate(radio, known, member.radio_range, environment.cell)
        view = View(
            number, member.name, member.role, member.parent, member.child, member.speed,
            member.reach, team[BASE].cell, member.cell, member.heading, known, Planner(known),
            estimate, np.random.Generator(np.random.PCG64(thinking[number])),
        )  # fmt: skip
        for other, one in enumerate(team):
            if other != number:
                view.teammates[other] = Teammate(other, one.name, one.role, one.speed, one.cell)
        scanner = None
        if member.reach:
            key = member.reach, member.view
            if key not in scanners:
                scanners[key] = Scanner(environment, member.reach, view=member.view)
            scanner = scanners[key]
        mind = copy.deepcopy(strategy) if number != BASE else None
        random = np.random.Generator(np.random.PCG64(noise[number]))
        bodies.append(Body(member, view, mind, scanner, random))
    lost = np.random.Generator(np.random.PCG64(losing))
    messages = Exchange(radio, len(team), lost)
    return Cycle(environment, bodies, radio, messages, links_before)
