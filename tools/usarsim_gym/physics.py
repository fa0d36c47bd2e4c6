"""`usarsim/ExplorePhysics-v0`: one robot with a range finder maps a building in MuJoCo."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.radio.families.ranges import Circle
from usarsim_exploration.showing.picture import draw
from usarsim_exploration.showing.scene import Cells, Figure, Scene
from usarsim_exploration.worlds import draw_places, find
from usarsim_gym.chart import Bits, Chart, moved
from usarsim_gym.game import Rewards
from usarsim_gym.rover import TICK, Rover
from usarsim_gym.seeing import Observation, Picture, map_spaces, surroundings, whole

Localisation = Literal["truth", "odometry"]
SPIN = 0.5
"""Part of the speed of the wheels that a full turn takes."""
FASTEST = 10.0
"""m/s and rad/s of what is told."""


class ExplorePhysics(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One skid-steered robot; docs/gym.md has its spaces, with shapes and units."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        world: str = "lab",
        *,
        robot: str = "P3AT",
        speed: float = 0.8,
        reach: float = 10.0,
        noise: float = 0.0,
        localisation: Localisation = "truth",
        coverage: float = 0.95,
        steps: int = 3000,
        time_cost: float = 0.02,
        collision_cost: float = 0.1,
        render_mode: str | None = None,
    ) -> None:
        """Compile the world, once.

        Args:
            world: what `usarsim explore` calls an environment, or a map file.
            robot: skid-steered class with a range finder. speed: of its wheels, m/s.
            reach, noise: of the range finder; standard deviation of its echoes; m.
            localisation: whence the pose is that it is told, and where its map is drawn.
            coverage, steps, time_cost, collision_cost: see `Rewards`.
            render_mode: `rgb_array` or None.

        Raises:
            UsarsimError: something cannot be used; says what, and the cure.
        """
        self._rewards = Rewards(coverage, steps, time_cost, collision_cost)
        if localisation not in ("truth", "odometry"):
            raise ExplorationError(f"localisation: {localisation!r} (write truth or odometry)")
        self._world, self._localisation = find(world), localisation
        self._rover = Rover(self._world, robot, speed, reach, noise)
        self._reach = reach
        self._trail: list[Cells] = []
        truth = self._world.environment
        self._free = truth.reachable(self._world.base).astype(np.uint8)
        self._area = int(np.count_nonzero(self._free))
        fastest = np.full(2, FASTEST, np.float32)
        pose = np.array([0.0, 0.0, -1.0, -1.0, 0.0], np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = spaces.Dict(
            {
                **map_spaces(),
                "pose": spaces.Box(pose, np.ones(5, np.float32), dtype=np.float32),
                "ranges": spaces.Box(0.0, float(reach), (self._rover.beams,), np.float32),
                "velocity": spaces.Box(-fastest, fastest),
            }
        )
        self.render_mode = render_mode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new episode at another start, of the same compiled model. options: none are known."""
        super().reset(seed=seed)
        random, truth = self.np_random, self._world.environment
        where = draw_places(truth, self._world.title, "drawn", int(random.integers(2**31)))
        column, row = self._base = where.base
        x, y = (column + 0.5) * truth.cell, (truth.shape[0] - row - 0.5) * truth.cell
        self._rover.begin(x, y, random.uniform(-math.pi, math.pi), random)
        self._start = self._rover.place
        self._seen = Chart(truth.shape, truth.cell)
        told_truth = self._localisation == "truth"
        self._known = self._seen if told_truth else Chart(truth.shape, truth.cell)
        self._found = np.zeros(truth.shape, np.uint8)
        self._count = self._steps = 0
        self._driven = 0.0
        self._trail.clear()
        self._look()
        return self._observe(), self._facts()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """0.1 s of simulated time. action: (2,) ahead, and to the right."""
        rover, rewards, before = self._rover, self._rewards, self._count
        x, y, _ = rover.place
        ahead, right = np.clip(np.asarray(action, np.float64), -1.0, 1.0).tolist()
        there = rover.step(ahead, SPIN * right)
        self._steps += 1
        if there:
            self._driven += math.dist((x, y), rover.place[:2])
            self._look()
        reward = (self._count - before) * self._world.environment.cell**2 - rewards.time
        reward -= rewards.collision * rover.touching
        ended = self.covered >= rewards.coverage
        cut = self._steps >= rewards.steps or not there
        return self._observe(), reward, ended, cut, self._facts()

    @property
    def covered(self) -> float:
        """Part of the reachable free cells that it has seen."""
        return self._count / self._area

    def _look(self) -> None:
        """Take the scan into the maps: the robot's, and that of what it really saw."""
        ranges, angles, ahead, left = self._rover.sight

        def draw_in(chart: Chart, place: tuple[float, float, float]) -> Bits:
            return chart.take_in(moved(place, (ahead, left, 0.0)), ranges, angles, self._reach)

        self._found |= draw_in(self._seen, self._rover.place) & self._free
        self._count = int(np.count_nonzero(self._found))
        if self._known is not self._seen:
            draw_in(self._known, self._place())
        if self.render_mode is not None:
            self._trail.append(np.array([self._known.cell_of(*self._place()[:2])], np.int64))

    def _place(self) -> tuple[float, float, float]:
        """Where the robot is told that it is."""
        if self._localisation == "truth":
            return self._rover.place
        return moved(self._start, self._rover.way)

    def _observe(self) -> Observation:
        x, y, heading = self._place()
        chart, cell = self._known, self._world.environment.cell
        rows, columns = chart.bits.shape
        place = chart.cell_of(x, y)
        pose = [
            x / (columns * cell), 1.0 - y / (rows * cell), math.cos(heading), -math.sin(heading),
            self._steps / self._rewards.steps,
        ]  # fmt: skip
        low, high = (0.0, 0.0, -1.0, -1.0, 0.0), 1.0
        speed, turn = self._rover.velocity
        return {
            "local": surroundings(chart.bits, place),
            "map": whole(chart.bits, place),
            "pose": np.clip(pose, low, high).astype(np.float32),
            "ranges": self._rover.sight[0].astype(np.float32),
            "velocity": np.clip([speed, -turn], -FASTEST, FASTEST).astype(np.float32),
        }

    def _facts(self) -> dict[str, Any]:
        x, y, heading = self._rover.place
        return {
            "covered": self.covered,
            "distance": self._driven,
            "collided": self._rover.touching,
            "time": round(self._steps * TICK, 6),
            "x": x,
            "y": y,
            "heading": -heading,
        }

    def render(self) -> Picture | None:
        """The robot's map, as `usarsim explore show` draws it; None unless asked for at first."""
        if self.render_mode != "rgb_array":
            return None
        truth, known = self._world.environment, self._known
        x, y, heading = self._place()
        base = _figure("Base", self._base, 0.0)
        robot = _figure("R1", known.cell_of(x, y), -heading)
        layers = np.stack([truth.walls != 0, np.zeros_like(known.bits), known.bits])
        share = 100 * self.covered
        nothing = np.empty((0, 2), np.int64)
        scene = Scene(
            f"{truth.name}, gym, {self._steps * TICK:.1f} s", self._steps, (base, robot), nothing,
            layers.astype(np.uint8), [[nothing, one] for one in self._trail], share, 0.0,
            Circle(), truth.cell,
        )  # fmt: skip
        return draw(scene)


def _figure(name: str, cell: tuple[int, int], heading: float) -> Figure:
    """As pictures have robots."""
    role: Literal["base", "explorer"] = "base" if name == "Base" else "explorer"
    return Figure(
        name, role, "explore", cell, heading, True, None, 0.0, 0, None,
        np.empty((0, 2), np.int32), None, None, (),
    )  # fmt: skip
