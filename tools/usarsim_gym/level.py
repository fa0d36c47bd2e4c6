"""What both levels have in common: what an episode is about, and how it is played."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from usarsim_exploration.errors import ExplorationError
from usarsim_gym.seeing import Observation, Picture


@dataclass(frozen=True, slots=True)
class Rewards:
    """What an episode is about, and when it is over.

    Attributes:
        coverage: part of the reachable free cells that ends an episode once the team knows it.
        steps: after which an episode is cut off.
        time, collision: taken off in each step, and for each step with a collision, m2.
    """

    coverage: float
    steps: int
    time: float
    collision: float

    def __post_init__(self) -> None:
        """Raises: ExplorationError: a value makes no sense."""
        if not 0.0 < self.coverage <= 1.0:
            raise ExplorationError(f"coverage: {self.coverage} (write a part above 0, up to 1)")
        if self.steps < 1:
            raise ExplorationError(f"steps: {self.steps} (write a number from 1)")


class Level(Protocol):
    """Episodes of robots 1 to n, one after the other; the grid and the physics are such levels.

    Attributes:
        robots: how many. action_space, observation_space: of each.
        ended: the goal is reached, or nobody can find more; cut: out of time.
    """

    robots: int
    action_space: spaces.Space[Any]
    observation_space: spaces.Dict
    ended: bool
    cut: bool

    def begin(self, random: np.random.Generator) -> None:
        """A new episode: draws its places and its luck."""

    def step(self, told: dict[int, Any]) -> None:
        """A step. told: actions by number, of those that work."""

    def works(self, number: int) -> bool:
        """Whether a robot goes on."""

    def observe(self, number: int) -> Observation:
        """What a robot sees."""

    def reward(self, number: int) -> float:
        """What the team found in the last step, less what the robot is charged, m2."""

    def facts(self, number: int) -> dict[str, Any]:
        """What goes beside an observation and is not for the learner, but for masks."""

    def picture(self) -> Picture:
        """The team's map."""
