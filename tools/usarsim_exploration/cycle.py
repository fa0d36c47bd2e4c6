"""The cycle of a run: decide, move and scan, link, exchange, count; the same for every strategy.

All robots decide on what they knew at the end of the last step, and messages are written before any
is read, so the order of robots changes nothing (exploration reference 4 and 16).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.exchange import Exchange, tell_links
from usarsim_exploration.kernels import count_first
from usarsim_exploration.known_map import FREE, WALL, KnownMap
from usarsim_exploration.levels.grid import GridLevel, Level
from usarsim_exploration.localisation.evidence import Evidence
from usarsim_exploration.messages import letter_size
from usarsim_exploration.planning import Floods, Planner
from usarsim_exploration.radio import Links, Radio, RadioEstimate
from usarsim_exploration.rules import TODAY, RunRules
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
        silent: its radio is out. heard_again: only for some time.
        evidence: what its scans say of walls, where they have noise.
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
    asleep: bool = False
    silent: bool = False
    heard_again: bool = False
    evidence: Evidence | None = None
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
        level: moves robots, makes scans, finds links.
        links: of the last step. step: how many were made.
        messages: what is told, and how much.
        rules: of the run. changes: how often walls moved.
        begin: told what begins, `plan`, `sense` or `communicate`, for whoever takes times.
    """

    environment: Environment
    bodies: list[Body]
    radio: Radio
    messages: Exchange
    links_before: bool = False
    level: Level = field(default_factory=GridLevel)
    rules: RunRules = TODAY
    step: int = 0
    changes: int = 0
    begin: Callable[[str], None] = lambda phase: None
    links: Links = field(init=False)
    _team: NDArray[np.uint8] = field(init=False)

    def __post_init__(self) -> None:
        self._team = np.zeros(self.environment.walls.size, np.uint8)
        self.links = self.level.links(self)
        self.level.look(self)
        self._exchange()

    @property
    def team_free(self) -> int:
        """How many cells somebody takes for free, and are; walls that were only supposed, too."""
        maps = np.stack([body.view.known.bits for body in self.bodies])
        known = ((maps & (FREE | WALL)) == FREE).any(axis=0)
        return int(np.count_nonzero(known & (self.environment.walls == 0)))

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
            self.links = self.level.links(self)
            if self.rules.mresim:  # its robots know of links before they decide
                tell_links(self.bodies, self.links.groups())
        self.level.move(self)
        self.begin("communicate")
        if not self.links_before:
            self.links = self.level.links(self)
        self._exchange()

    # -- robots -------------------------------------------------------------------------------

    def acting(self) -> list[Body]:
        """Robots that work; levels let each decide before it moves."""
        return [one for one in self.bodies if one.works and one.strategy is not None]

    def decide(self, body: Body) -> None:
        """Ask a robot's strategy what to do from now on."""
        assert body.strategy is not None
        body.view.step = self.step
        self.begin("plan")
        plan = body.strategy.decide(body.view)
        if plan is not None:
            self._adopt(body, plan)
        self.begin("sense")
        body.found = body.first = 0

    def _adopt(self, body: Body, plan: Plan) -> None:
        body.view.path = list(plan.path)
        body.state, body.home = plan.state, plan.home
        body.goal = plan.goal or (plan.path[-1] if plan.path else None)

    def count(self, body: Body, found: NDArray[np.int32]) -> None:
        """Note what scans of a step have found; cells that were unknown to the robot."""
        walls = self.environment.walls.reshape(-1)
        first, _ = count_first(self._team, walls, body.view.known.bits.reshape(-1), found)
        body.found += len(found)
        body.first += first

    # -- radio --------------------------------------------------------------------------------

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
    level: Level | None = None,
    late: Collection[int] = (),
    rules: RunRules = TODAY,
    scale: float = 1.0,
) -> Cycle:
    """A run at its start.

    Args:
        strategy: a pattern, which each robot gets a copy of. level: default the grid.
        late: numbers of robots that stand switched off at first. rules: of the run.
        scale: see `View`.
    """
    seeds = np.random.SeedSequence(seed).spawn(2 * len(team) + 1)
    thinking, losing, noise = seeds[: len(team)], seeds[len(team)], seeds[len(team) + 1 :]
    scanners: dict[tuple[int, float], Scanner] = {}
    bodies, floods = [], Floods()
    wary = any(member.noise for member in team)
    maps = np.zeros((len(team), *environment.shape), np.uint8)
    for number, member in enumerate(team):
        known = KnownMap(environment.shape, maps[number])
        estimate = RadioEstimate(radio, known, member.radio_range, environment.cell)
        view = View(
            number, member.name, member.role, member.parent, member.child, member.speed,
            member.reach, team[BASE].cell, member.cell, member.heading, known,
            Planner(known, floods=floods),
            estimate, np.random.Generator(np.random.PCG64(thinking[number])), rules=rules,
            area=environment.free if rules.mresim else 0, width=member.view, scale=scale,
        )  # fmt: skip
        for other, one in enumerate(team):
            if other != number:
                view.teammates[other] = Teammate(other, one.name, one.role, one.speed, one.cell)
        scanner = None
        if member.reach:
            key = member.reach, member.view
            if key not in scanners:
                scanners[key] = Scanner(
                    environment, member.reach, view=member.view, tight=rules.sight, wary=wary
                )
            scanner = scanners[key]
        mind = copy.deepcopy(strategy) if number != BASE else None
        random = np.random.Generator(np.random.PCG64(noise[number]))
        off = number in late
        bodies.append(Body(member, view, mind, scanner, random, works=not off, asleep=off))
        if member.noise and rules.sight:
            bodies[-1].evidence = Evidence(environment.shape, member.noise)
    lost = np.random.Generator(np.random.PCG64(losing))
    level = level or GridLevel()
    messages = Exchange(radio, maps, lost, level.carry, fair=rules.ends)
    return Cycle(environment, bodies, radio, messages, links_before, level, rules)
