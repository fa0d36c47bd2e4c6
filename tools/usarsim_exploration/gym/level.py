"""What both levels have in common: what an episode is about, and how it is played."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.gym.seeing import Observation, Picture


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


@dataclass(slots=True)
class Turn:
    """Whether an episode goes on.

    Attributes:
        begun: there was one. over: the last one has ended, or was cut off.
    """

    begun: bool = False
    over: bool = False

    def begin(self) -> None:
        """A new one."""
        self.begun, self.over = True, False

    def check_begun(self) -> None:
        """Raises: ResetNeeded: there was none yet."""
        if not self.begun:
            raise ResetNeeded("there is no episode yet (call reset first)")

    def check_step(self) -> None:
        """Raises: ResetNeeded: none goes on."""
        self.check_begun()
        if self.over:
            raise ResetNeeded("the episode is over (call reset before the next step)")


def checked(space: spaces.Space[Any], action: Any, name: str) -> Any:
    """An action as an int or an array of float64, whatever type of number it came in.

    Args:
        space: it is of. action: from outside. name: for the error.

    Raises:
        InvalidAction: the space has no such action.
    """
    try:
        found = np.asarray(action)
    except ValueError:  # rows of different lengths
        found = np.asarray(None)
    if isinstance(space, spaces.Discrete):
        if found.size == 1 and found.dtype.kind in "iu" and 0 <= (number := found.item()) < space.n:
            return number
        cure = f"give a whole number from 0 to {space.n - 1}"
    else:
        assert isinstance(space, spaces.Box)
        if found.shape == space.shape and found.dtype.kind in "iuf":
            values = found.astype(np.float64)
            if ((space.low <= values) & (values <= space.high)).all():
                return values
        cure = f"give {space.shape[0]} numbers from {space.low.min():g} to {space.high.max():g}"
    raise InvalidAction(f"{name}: {' '.join(repr(action).split())[:60]} ({cure})")
