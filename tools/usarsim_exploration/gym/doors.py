"""The two doors of a level: Gymnasium's, for one robot, and PettingZoo's, for a team."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction
from pettingzoo import ParallelEnv

from usarsim_exploration.gym.level import Level, Turn, checked
from usarsim_exploration.gym.seeing import Observation, Picture

Facts = dict[str, Any]


class Alone(gymnasium.Env[Observation, Any]):
    """A level with one robot."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, level: Level, render_mode: str | None) -> None:
        """render_mode: `rgb_array`, or None for no pictures."""
        self.level, self._turn = level, Turn()
        self.observation_space = level.observation_space
        self.action_space = level.action_space
        self.render_mode = render_mode

    def reset(
        self, *, seed: int | None = None, options: Facts | None = None
    ) -> tuple[Observation, Facts]:
        """A new episode. options: none are known."""
        super().reset(seed=seed)
        self.level.begin(self.np_random)
        self._turn.begin()
        return self.level.observe(1), self.level.facts(1)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, Facts]:
        """One step of the level.

        Raises:
            ResetNeeded: no episode goes on. InvalidAction: the space has no such action.
        """
        level = self.level
        self._turn.check_step()
        level.step({1: checked(level.action_space, action, "action")})
        self._turn.over = level.ended or level.cut
        return level.observe(1), level.reward(1), level.ended, level.cut, level.facts(1)

    def render(self) -> Picture | None:
        """What is known; None unless `render_mode` is `rgb_array`.

        Raises:
            ResetNeeded: there was no episode yet.
        """
        if self.render_mode != "rgb_array":
            return None
        self._turn.check_begun()
        return self.level.picture()


class Together(ParallelEnv[str, Observation, Any]):
    """A level with a team; agents are `robot_1`, `robot_2` and so on."""

    metadata: ClassVar[dict[str, Any]] = {
        "name": "usarsim_explore_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(self, level: Level, render_mode: str | None) -> None:
        """render_mode: `rgb_array`, or anything else for no pictures."""
        self.level, self._turn = level, Turn()
        self.possible_agents = [f"robot_{n}" for n in range(1, level.robots + 1)]
        self.agents: list[str] = []
        self._numbers = {name: number for number, name in enumerate(self.possible_agents, 1)}
        # each has spaces of its own, which draw by seeds of their own
        self.observation_spaces = {
            name: spaces.Dict(dict(level.observation_space.spaces)) for name in self.possible_agents
        }
        self.action_spaces = {name: _twin(level.action_space) for name in self.possible_agents}
        self.render_mode = render_mode
        self._random = np.random.default_rng()

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of an agent; always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Of an agent; always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: Facts | None = None
    ) -> tuple[dict[str, Observation], dict[str, Facts]]:
        """A new episode. options: none are known."""
        if seed is not None:
            self._random = np.random.default_rng(seed)
        self.level.begin(self._random)
        self._turn.begin()
        self.agents = list(self.possible_agents)
        return self._observations(self.agents), self._facts(self.agents)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Facts]
    ]:
        """One step of the level. A robot that failed is terminated; the others go on.

        Raises:
            ResetNeeded: no episode goes on. InvalidAction: an agent has none, or the space has no
                such action, or no such agent goes on.
        """
        level, acting = self.level, list(self.agents)
        self._turn.check_step()
        if actions.keys() != set(acting):
            wrong = sorted(actions.keys() ^ set(acting))
            cure = "give one to each name in `agents`, and to no other"
            raise InvalidAction(f"actions: {', '.join(map(str, wrong))} ({cure})")
        level.step(
            {
                self._numbers[name]: checked(level.action_space, actions[name], name)
                for name in acting
            }
        )
        rewards = {name: level.reward(self._numbers[name]) for name in acting}
        terminated = {name: level.ended or not level.works(self._numbers[name]) for name in acting}
        truncated = dict.fromkeys(acting, level.cut)
        self.agents = [name for name in acting if not (terminated[name] or truncated[name])]
        self._turn.over = not self.agents
        return self._observations(acting), rewards, terminated, truncated, self._facts(acting)

    def render(self) -> Picture | None:
        """What the team knows together; None unless `render_mode` is `rgb_array`.

        Raises:
            ResetNeeded: there was no episode yet.
        """
        if self.render_mode != "rgb_array":
            return None
        self._turn.check_begun()
        return self.level.picture()

    def close(self) -> None:
        """Nothing is held."""

    def _observations(self, names: list[str]) -> dict[str, Observation]:
        return {name: self.level.observe(self._numbers[name]) for name in names}

    def _facts(self, names: list[str]) -> dict[str, Facts]:
        return {name: self.level.facts(self._numbers[name]) for name in names}


def _twin(space: spaces.Space[Any]) -> spaces.Space[Any]:
    if isinstance(space, spaces.Discrete):
        return spaces.Discrete(int(space.n))
    assert isinstance(space, spaces.Box)
    return spaces.Box(space.low, space.high, dtype=np.float32)
