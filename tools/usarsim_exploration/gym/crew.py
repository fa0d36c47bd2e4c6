"""The physics as a level: robots with range finders, each with a map of its own.

Reward is counted on the truth: cells that the beams of anybody's scan passed over, at the place
where the robot really was. Maps are what robots believe: drawn where they are told that they are,
and merged among those whose radios link them after a step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, NoReturn

import numpy as np
from gymnasium import spaces

from usarsim_exploration.cycle import Cycle, Member, set_up
from usarsim_exploration.environment import Cell
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.gym.chart import Bits, Chart, moved
from usarsim_exploration.gym.level import Rewards
from usarsim_exploration.gym.puppets import Puppet
from usarsim_exploration.gym.rover import TICK, Place, Stage
from usarsim_exploration.gym.seeing import Observation, Picture, map_spaces, surroundings, whole
from usarsim_exploration.known_map import FREE, KNOWN, SAFE, WALL
from usarsim_exploration.radio import Links, create_radio, find_links
from usarsim_exploration.showing.picture import draw
from usarsim_exploration.showing.scene import Cells, Figure, Scene
from usarsim_exploration.worlds import draw_places, find
from usarsim_server.base.errors import at
from usarsim_server.base.tables import Table

Localisation = Literal["truth", "odometry"]
Tables = Mapping[str, object]
SPIN = 0.5
"""Part of the speed of the wheels that a full turn takes."""
FASTEST = 10.0
"""m/s and rad/s that are told at the most."""
NOTHING = np.empty((0, 2), np.int64)


class Crew:
    """The physics as a level.

    Attributes:
        gained: m2 of free space that the last step found. free: reachable free cells.
        charts: of all; that of the base first. linked: whom each hears, over any chain.
        stage: where they drive.
    """

    def __init__(
        self, world: str, robots: int, robot: str, speed: float, reach: float, noise: float,
        localisation: Localisation, radio: Tables, radio_range: float, rewards: Rewards,
        trails: bool,
    ) -> None:  # fmt: skip
        """Compile the world, once.

        Args:
            world: what `usarsim explore` calls an environment, or a map file.
            robots: how many. robot: their class, skid-steered and with a range finder.
            speed: of their wheels, m/s. reach, noise: of the range finder; standard deviation of
                its echoes; m.
            localisation: whence the poses are that robots are told, where they draw their maps.
            radio: `[radio]` of a scenario; a step of it is one of 0.1 s. radio_range: m.
            trails: remember them, for pictures.

        Raises:
            UsarsimError: something cannot be used; says what, and the cure.
        """
        if localisation not in ("truth", "odometry"):
            raise ExplorationError(f"localisation: {localisation!r} (write truth or odometry)")
        if robots < 1:
            raise ExplorationError(f"robots: {robots} (write a number from 1)")
        table = Table(radio, "radio", ExplorationError)
        self._radio = create_radio(table)
        table.finish()
        self._world, self._localisation = find(world), localisation
        if not self._world.starts:
            problem = "there is no room for a robot beside the base"
            raise ExplorationError(at(world, problem, "give a map with more free cells"))
        self.robots, self.rewards = robots, rewards
        self.stage = Stage(self._world, robot, robots, speed, reach, noise)
        truth = self._world.environment
        self._range = radio_range / truth.cell
        self._open = truth.reachable(self._world.base).astype(np.uint8)
        self.free = int(np.count_nonzero(self._open))
        self._trails: list[list[Cells]] | None = [] if trails else None
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        low, fastest = np.array([0.0, 0.0, -1.0, -1.0, 0.0]), np.full(2, FASTEST, np.float32)
        self.observation_space = spaces.Dict(
            {
                **map_spaces(),
                "pose": spaces.Box(low.astype(np.float32), np.ones(5, np.float32)),
                "ranges": spaces.Box(0.0, float(reach), (self.stage.beams,), np.float32),
                "velocity": spaces.Box(-fastest, fastest),
            }
        )

    def __reduce__(self) -> NoReturn:
        """Raises: TypeError: what MuJoCo has compiled stays where it is."""
        cure = "make another environment with the same arguments and reset it with the same seed"
        raise TypeError(f"a world in MuJoCo cannot be copied or pickled ({cure})")

    # -- episodes -----------------------------------------------------------------------------

    def begin(self, random: np.random.Generator) -> None:
        """A new episode at another place, of the same compiled model."""
        truth = self._world.environment
        where = draw_places(truth, self._world.title, "drawn", int(random.integers(2**31)))
        self._base = where.base
        places = [
            (*_middle(where.starts[number % len(where.starts)], truth.shape[0], truth.cell),
             float(random.uniform(-math.pi, math.pi)))
            for number in range(self.robots)
        ]  # fmt: skip
        self.stage.begin(places, random)
        rovers = self.stage.rovers
        self._starts = [one.place for one in rovers]
        self.charts = [Chart(truth.shape, truth.cell) for _ in range(self.robots + 1)]
        self._scratch = Chart(truth.shape, truth.cell)
        self._found: Bits = np.zeros(truth.shape, np.uint8)
        self._count = self._steps = 0
        self._driven = [0.0] * self.robots
        self._heard: list[dict[int, Cell]] = [{} for _ in range(self.robots + 1)]
        self.cut = False
        if self._trails is not None:
            self._trails.clear()
        slow = self.robots > 1 and self._radio.shaped
        self._cycle = self._correspond(int(random.integers(2**31))) if slow else None
        self._look()

    def _correspond(self, seed: int) -> Cycle:
        """Maps as they are written in messages, and who carries these; nobody has said anything."""
        team = [Member("Base", "base", self._base, reach=0, radio_range=self._range)]
        team += [replace(team[0], name=f"R{n}", role="explorer") for n in range(1, self.robots + 1)]
        truth = self._world.environment
        return set_up(truth, team, Puppet(), self._radio, seed, late=range(len(team)))

    def step(self, told: Mapping[int, Any]) -> None:
        """0.1 s of simulated time. told: (2,) ahead and to the right, by number."""
        before = [one.place for one in self.stage.rovers]
        orders = {}
        for number, action in told.items():
            ahead, right = action.tolist()
            orders[number - 1] = ahead, SPIN * right
        self.stage.step(orders)
        self._steps += 1
        for number, rover in enumerate(self.stage.rovers):
            self._driven[number] += math.dist(before[number][:2], rover.place[:2])
        self._look()
        self.cut = self._steps >= self.rewards.steps

    def _look(self) -> None:
        """Take the scans into the maps, and have those who are linked merge theirs."""
        known = self._count
        for number, rover in enumerate(self.stage.rovers, 1):
            if rover.works:
                ahead, left, _ = rover.scanner.mount.position
                scan = rover.scanner.scan, rover.angles, rover.met
                place = moved(self.place(number), (ahead, left, 0.0))
                seen = self.charts[number].take_in(place, *scan)
                if self._localisation != "truth":
                    truth = moved(rover.place, (ahead, left, 0.0))
                    seen = self._scratch.take_in(truth, *scan)
                self._found |= seen & self._open
        self._count = int(np.count_nonzero(self._found))
        self.gained = (self._count - known) * self._world.environment.cell**2
        self.ended = self.covered >= self.rewards.coverage or not any(
            one.works for one in self.stage.rovers
        )
        if self.robots > 1:
            self._talk()
        if self._trails is not None:
            cells = [np.array([self._cell(n)], np.int64) for n in range(1, self.robots + 1)]
            self._trails.append([NOTHING, *cells])

    def _talk(self) -> None:
        """Merge the maps of those who are linked; a wall that anybody knows is one."""
        truth = self._world.environment
        there = [self._base]
        there += [self.charts[0].cell_of(*one.place[:2]) for one in self.stage.rovers]
        ranges = [self._range, *(self._range * one.works for one in self.stage.rovers)]
        links = find_links(self._radio, truth, there, ranges, self._steps)
        self.linked = [np.flatnonzero(row).tolist() for row in links.closed]
        if self._cycle is not None:
            self._send(self._cycle, links)
            return
        for group in links.groups():
            merged = np.bitwise_or.reduce([self.charts[number].bits for number in group])
            cells = {number: self._cell(number) for number in group if number}
            for number in group:
                self.charts[number].bits[:] = merged
                self._heard[number] |= {one: at for one, at in cells.items() if one != number}

    def _send(self, cycle: Cycle, links: Links) -> None:
        """The same by messages, which take bytes and steps and get lost, hop by hop."""
        for number, (chart, body) in enumerate(zip(self.charts, cycle.bodies, strict=True)):
            body.works = number == 0 or self.works(number)
            body.view.cell = self._cell(number) if number else self._base
            known = body.view.known
            bits = np.where(chart.bits & WALL, np.uint8(WALL | SAFE), chart.bits)
            cells = np.flatnonzero((bits ^ known.bits) & KNOWN)
            known.write(self._steps, cells, bits.reshape(-1)[cells])
        cycle.messages.trade(self._steps, cycle.bodies, links, cycle.environment)
        for number, (chart, body) in enumerate(zip(self.charts, cycle.bodies, strict=True)):
            chart.bits |= body.view.known.bits & np.uint8(FREE | WALL)
            mates = body.view.teammates
            self._heard[number] = {n: one.cell for n, one in mates.items() if n and one.heard >= 0}

    # -- what robots are told -----------------------------------------------------------------

    @property
    def covered(self) -> float:
        """Part of the reachable free cells that anybody has seen."""
        return self._count / self.free

    def works(self, number: int) -> bool:
        """Whether a robot is in the world."""
        return self.stage.rovers[number - 1].works

    def place(self, number: int) -> Place:
        """Where a robot is told that it is."""
        rover = self.stage.rovers[number - 1]
        if self._localisation == "truth":
            return rover.place
        return moved(self._starts[number - 1], rover.way)

    def _cell(self, number: int) -> Cell:
        x, y, _ = self.place(number)
        return self.charts[number].cell_of(x, y)

    def observe(self, number: int) -> Observation:
        """What a robot sees; see docs/gym.md."""
        x, y, heading = self.place(number)
        bits, rover = self.charts[number].bits, self.stage.rovers[number - 1]
        high, wide = (side * self._world.environment.cell for side in bits.shape)
        cell = self._cell(number)
        pose = [
            min(max(x / wide, 0.0), 1.0), min(max(1.0 - y / high, 0.0), 1.0), math.cos(heading),
            -math.sin(heading), min(self._steps / self.rewards.steps, 1.0),
        ]  # fmt: skip
        speed, turn = rover.velocity
        return {
            "local": surroundings(bits, cell),
            "map": whole(bits, cell, self._heard[number].values()),
            "pose": np.array(pose, np.float32),
            "ranges": rover.scanner.scan.astype(np.float32),
            "velocity": np.clip([speed, -turn], -FASTEST, FASTEST).astype(np.float32),
        }

    def reward(self, number: int) -> float:
        """What the team found in the last step, less what the robot is charged, m2."""
        touching = self.stage.rovers[number - 1].touching
        return self.gained - self.rewards.time - self.rewards.collision * touching

    def facts(self, number: int) -> dict[str, Any]:
        """What goes beside an observation and is not for the learner."""
        rover = self.stage.rovers[number - 1]
        x, y, heading = rover.place
        others = self.linked[number] if self.robots > 1 else ()
        return {
            "covered": self.covered,
            "distance": self._driven[number - 1],
            "collided": rover.touching,
            "linked": [one for one in others if one not in (0, number)],
            "time": round(self._steps * TICK, 6),
            "x": x,
            "y": y,
            "heading": -heading,
        }

    def picture(self) -> Picture:
        """The team's map, as `usarsim explore show` draws it."""
        truth = self._world.environment
        figures = [_figure("Base", "base", self._base, 0.0, self._range)]
        for number in range(1, self.robots + 1):
            cell, heading = self._cell(number), -self.place(number)[2]
            figures.append(_figure(f"R{number}", "explorer", cell, heading, self._range))
        layers = np.stack([truth.walls != 0, *(one.bits for one in self.charts)]).astype(np.uint8)
        base = 100 * int(np.count_nonzero(self.charts[0].bits & self._open)) / self.free
        scene = Scene(
            f"{truth.name}, gym, {self._steps * TICK:.1f} s", self._steps, tuple(figures), NOTHING,
            layers, self._trails or [[NOTHING] * (self.robots + 1)], 100 * self.covered, base,
            self._radio, truth.cell,
        )  # fmt: skip
        return draw(scene)


def _middle(cell: Cell, rows: int, width: float) -> tuple[float, float]:
    """x and y of the middle of a cell, m."""
    return (cell[0] + 0.5) * width, (rows - cell[1] - 0.5) * width


def _figure(
    name: str, role: Literal["base", "explorer"], cell: Cell, heading: float, reach: float
) -> Figure:
    """As pictures have robots."""
    return Figure(
        name, role, "explore", cell, heading, True, None, reach, 0, None,
        np.empty((0, 2), np.int32), None, None, (),
    )  # fmt: skip
