"""`usarsim/ExploreGrid-v0` and `usarsim/ExploreFrontiers-v0`: one robot maps a grid."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np

from usarsim_gym.game import DEFAULT, Action, Game, Rewards, Tables
from usarsim_gym.seeing import Observation, Picture


class ExploreGrid(gymnasium.Env[Observation, np.int64]):
    """One robot on the grid; docs/gym.md has its spaces, with shapes and units."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        scenario: Tables | str | Path = DEFAULT,
        *,
        action: Action = "heading",
        worlds: int = 1,
        coverage: float = 0.95,
        steps: int = 400,
        time_cost: float = 0.1,
        collision_cost: float = 0.5,
        render_mode: str | None = None,
    ) -> None:
        """Read the scenario; see `Game` and `Rewards` for what the arguments mean.

        Raises:
            UsarsimError: something cannot be used; says what, and the cure.
        """
        rewards = Rewards(coverage, steps, time_cost, collision_cost)
        drawn = render_mode == "rgb_array"
        self._game = Game(scenario, 1, action, worlds, rewards, trails=drawn)
        self.observation_space = self._game.observation_space
        self.action_space = self._game.action_space
        self.render_mode = render_mode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """A new episode: another world of the pool, another start. options: none are known."""
        super().reset(seed=seed)
        self._game.begin(self.np_random)
        (body,) = self._game.robots
        return self._game.observe(body), self._game.facts(body)

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One step of the grid."""
        game = self._game
        game.step({1: int(action)})
        (body,) = game.robots
        return game.observe(body), game.reward(body), game.ended, game.cut, game.facts(body)

    def render(self) -> Picture | None:
        """The robot's map; None unless `render_mode` is `rgb_array`."""
        return self._game.picture() if self.render_mode == "rgb_array" else None
