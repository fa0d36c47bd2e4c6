"""A run on the grid whose robots do what is said from outside; all environments share it.

The scenario is one of `usarsim explore`, as tables or as a file; its strategy, end and seed count
for nothing here. Places are drawn anew for each episode.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from usarsim_exploration.cycle import BASE, Cycle, set_up
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.events import Fate
from usarsim_exploration.gym.level import Rewards
from usarsim_exploration.gym.puppets import (
    FRONTIERS,
    HEADINGS,
    Choice,
    Puppet,
    behind,
    frontier_space,
    straight,
)
from usarsim_exploration.gym.seeing import Observation, Picture, map_spaces, surroundings, whole
from usarsim_exploration.radio import Radio
from usarsim_exploration.radio.families.ranges import Circle
from usarsim_exploration.scenario import Scenario, load, merge, read
from usarsim_exploration.showing.picture import draw
from usarsim_exploration.showing.scene import (
    Cells,
    Scene,
    driven_by,
    figure_of,
    layers_of,
    links_of,
)
from usarsim_exploration.worlds import World, draw_places

Action = Literal["heading", "frontier"]
Tables = Mapping[str, object]
DEFAULT: Tables = {"environment": {"name": "lab"}}


class Game:
    """The grid as a level.

    Attributes:
        cycle: of the present episode. gained: m2 of free space that its last step found.
        free: reachable free cells.
    """

    def __init__(
        self, scenario: Tables | str | Path, robots: int | None, action: Action, worlds: int,
        rewards: Rewards, trails: bool,
    ) -> None:  # fmt: skip
        """Read the scenario.

        Args:
            scenario: tables, or a file. robots: how many; None: as it says.
            action: what is told a robot. worlds: with a generator, so many are drawn, with seeds
                from the scenario's on, and each episode takes one of them.
            trails: remember them, for pictures.

        Raises:
            UsarsimError: something cannot be used; says what, and the cure.
        """
        if action not in ("heading", "frontier"):
            raise ExplorationError(f"action: {action!r} (write heading or frontier)")
        if worlds < 1:
            raise ExplorationError(f"worlds: {worlds} (write a number from 1)")
        options = () if robots is None else (f"team.robots={robots}",)
        self._path: Path | None = None
        if isinstance(scenario, str | Path):
            self._path = Path(scenario)
            first = load(self._path, options)
        else:
            first = read(merge(scenario, options))
        self._scenarios: dict[int, Scenario] = {0: first}
        self._content: Tables = first.content
        place = self._content["environment"]
        assert isinstance(place, Mapping)
        if worlds > 1 and "generator" not in place:
            problem = "only a generator draws several (write environment.generator)"
            raise ExplorationError(f"worlds: {worlds}: {problem}")
        self._first = int(place.get("seed", 1)) if worlds > 1 else 0
        self._worlds, self._action, self.rewards = worlds, action, rewards
        self._trails: list[Sequence[Cells]] | None = [] if trails else None
        self.robots = len(first.team) - 1
        self.action_space = spaces.Discrete(len(HEADINGS) if action == "heading" else FRONTIERS)
        self.observation_space = spaces.Dict(self._spaces(action))

    @staticmethod
    def _spaces(action: Action) -> dict[str, spaces.Space[Any]]:
        found = map_spaces()
        low = np.array([0.0, 0.0, -1.0, -1.0, 0.0], np.float32)
        found["pose"] = spaces.Box(low, np.ones(5, np.float32), dtype=np.float32)
        if action == "frontier":
            found["frontiers"] = frontier_space()
        return found

    # -- episodes -----------------------------------------------------------------------------

    def begin(self, random: np.random.Generator) -> None:
        """A new episode: draws its world, its places and its luck."""
        scenario = self._scenario(int(random.integers(self._worlds)))
        seed = int(random.integers(2**31))
        world = scenario.world
        drawn = draw_places(world.environment, world.title, "drawn", seed)
        environment = replace(world.environment, walls=_reachable(drawn))
        base, *robots = scenario.team
        team = [replace(base, cell=drawn.base)]
        starts = drawn.starts or (drawn.base,)  # a world of one cell has no other
        for number, robot in enumerate(robots):
            turn = math.atan2(*HEADINGS[int(random.integers(len(HEADINGS)))][::-1])
            cell = starts[number % len(starts)]
            team.append(replace(robot, cell=cell, heading=turn))
        radio: Radio = scenario.radio
        if self.robots == 1:  # nobody to talk to: links need not be found
            team, radio = [replace(one, radio_range=0.0) for one in team], Circle()
        before = scenario.basics.links == "before"
        self.cycle: Cycle = set_up(environment, team, Puppet(), radio, seed, links_before=before)
        self._title = f"{world.environment.name}, gym"
        self._fate = Fate(scenario.events)
        self.free = environment.free
        self.ended = self.cut = False
        self.gained = 0.0
        if self._trails is not None:
            self._trails.clear()
        self._look()

    def step(self, told: Mapping[int, Any]) -> None:
        """A step. told: actions by number of robot, of those that work."""
        cycle = self.cycle
        for number, action in told.items():
            body = cycle.bodies[number]
            puppet, view = body.strategy, body.view
            assert isinstance(puppet, Puppet)
            if self._action == "heading":
                puppet.plan, puppet.turn = straight(view, action)
            else:
                puppet.plan, puppet.turn = (
                    self._choices[number].plan(view, action),
                    behind(view),
                )
            self._vain[number] = self._action == "heading" and not puppet.plan.path
        before = cycle.team_free
        self._fate.strike(cycle)
        cycle.advance()
        self.gained = (cycle.team_free - before) * cycle.environment.cell**2
        self._look()
        self.cut = cycle.step >= self.rewards.steps

    def _scenario(self, number: int) -> Scenario:
        if number not in self._scenarios:
            content = merge(self._content, [f"environment.seed={self._first + number}"])
            where = "options" if self._path is None else self._path
            self._scenarios[number] = read(content, where)
        return self._scenarios[number]

    def _look(self) -> None:
        """Note what came of a step."""
        cycle, robots = self.cycle, self.cycle.bodies[1:]
        if cycle.step == 0:
            self._vain = dict.fromkeys(range(len(cycle.bodies)), False)
        if self._trails is not None:
            self._trails.append([driven_by(body, cycle.step) for body in cycle.bodies])
        at_work = [body for body in robots if body.works]
        self.ended = self.covered >= self.rewards.coverage or not at_work
        if self._action == "frontier":
            self._choices = {
                body.view.number: Choice(body.view, cycle.environment.cell) for body in at_work
            }
            self.ended = self.ended or not any(one.cells for one in self._choices.values())

    # -- what robots are told -----------------------------------------------------------------

    @property
    def covered(self) -> float:
        """Part of the reachable free cells that anybody knows."""
        return self.cycle.team_free / self.free

    def works(self, number: int) -> bool:
        """Whether a robot has not failed."""
        return self.cycle.bodies[number].works

    def observe(self, number: int) -> Observation:
        """What a robot sees; see docs/gym.md."""
        view = self.cycle.bodies[number].view
        bits, (column, row) = view.known.bits, view.cell
        rows, columns = bits.shape
        mates = [
            one.cell for one in view.teammates.values() if one.number != BASE and one.heard >= 0
        ]
        share = min(self.cycle.step / self.rewards.steps, 1.0)
        pose = [
            (column + 0.5) / columns, (row + 0.5) / rows, math.cos(view.heading),
            math.sin(view.heading), share,
        ]  # fmt: skip
        found: Observation = {
            "local": surroundings(bits, view.cell),
            "map": whole(bits, view.cell, mates),
            "pose": np.array(pose, np.float32),
        }
        if self._action == "frontier":
            choice = self._choices.get(number)
            table = np.zeros((FRONTIERS, 5), np.float32) if choice is None else choice.table.copy()
            found["frontiers"] = table
        return found

    def reward(self, number: int) -> float:
        """What the team found in the last step, less what the robot is charged, m2."""
        return self.gained - self.rewards.time - self.rewards.collision * self._collided(number)

    def _collided(self, number: int) -> bool:
        return self._vain[number] or self.cycle.bodies[number].view.blocked

    def facts(self, number: int) -> dict[str, Any]:
        """What goes beside an observation and is not for the learner, but for the mask."""
        body = self.cycle.bodies[number]
        found: dict[str, Any] = {
            "covered": self.covered,
            "distance": body.distance * self.cycle.environment.cell,
            "collided": self._collided(number),
            "linked": sorted(body.view.linked - {BASE}),
        }
        if self._action == "frontier":
            choice = self._choices.get(number)
            found["action_mask"] = np.zeros(FRONTIERS, np.int8) if choice is None else choice.mask
        return found

    def picture(self) -> Picture:
        """The team's map, as `usarsim explore show` draws it."""
        cycle = self.cycle
        share = 100 * self.covered
        scene = Scene(
            self._title, cycle.step, tuple(figure_of(body, None) for body in cycle.bodies),
            links_of(cycle), layers_of(cycle), self._trails or [[]], share, share, cycle.radio,
            cycle.environment.cell,
        )  # fmt: skip
        return draw(scene)


def _reachable(world: World) -> NDArray[np.uint8]:
    """The walls of a world in which everything is a wall that cannot be driven to."""
    found: NDArray[np.uint8] = (~world.environment.reachable(world.base)).astype(np.uint8)
    return found
