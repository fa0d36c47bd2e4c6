"""`ExploreTeam`: a team maps a grid under limited radio, as a PettingZoo environment.

All act at once, as in a step of `usarsim explore`. Maps are merged when robots are linked, directly
or over others and the base, and only then: each agent sees its own map.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from usarsim_gym.game import DEFAULT, Action, Game, Rewards, Tables
from usarsim_gym.seeing import Observation, Picture


class ExploreTeam(ParallelEnv[str, Observation, np.int64]):
    """A team on the grid; agents are `robot_1`, `robot_2` and so on. docs/gym.md has the spaces."""

    metadata: ClassVar[dict[str, Any]] = {
        "name": "usarsim_explore_team_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenario: Tables | str | Path = DEFAULT,
        *,
        robots: int | None = None,
        action: Action = "heading",
        worlds: int = 1,
        coverage: float = 0.95,
        steps: int = 400,
        time_cost: float = 0.1,
        collision_cost: float = 0.5,
        render_mode: str | None = None,
    ) -> None:
        """Read the scenario; see `Game` and `Rewards` for what the arguments mean.

        Args:
            scenario: tables or a file, of `usarsim explore`. robots: how many; None: as it says.
            render_mode: `rgb_array`, or anything else for no pictures.

        Raises:
            UsarsimError: something cannot be used; says what, and the cure.
        """
        rewards = Rewards(coverage, steps, time_cost, collision_cost)
        drawn = render_mode == "rgb_array"
        self._game = Game(scenario, robots, action, worlds, rewards, trails=drawn)
        self.possible_agents = [f"robot_{n}" for n in range(1, len(self._game.names) + 1)]
        self.agents: list[str] = []
        self._numbers = {name: number for number, name in enumerate(self.possible_agents, 1)}
        self.observation_spaces: dict[str, spaces.Space[Any]] = {
            name: spaces.Dict(dict(self._game.observation_space.spaces))
            for name in self.possible_agents
        }
        self.action_spaces: dict[str, spaces.Space[Any]] = {
            name: spaces.Discrete(int(self._game.action_space.n)) for name in self.possible_agents
        }
        self.render_mode = render_mode
        self._random = np.random.default_rng()

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of an agent; always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Of an agent; always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """A new episode. options: none are known."""
        if seed is not None:
            self._random = np.random.default_rng(seed)
        self._game.begin(self._random)
        self.agents = list(self.possible_agents)
        return self._observations(self.agents), self._infos(self.agents)

    def step(
        self, actions: dict[str, np.int64]
    ) -> tuple[
        dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool],
        dict[str, dict[str, Any]],
    ]:  # fmt: skip
        """One step of the grid. A robot that failed is terminated; the others go on."""
        game, acting = self._game, list(self.agents)
        game.step({self._numbers[name]: int(actions[name]) for name in acting})
        bodies = {name: game.cycle.bodies[self._numbers[name]] for name in acting}
        rewards = {name: game.reward(body) for name, body in bodies.items()}
        terminated = {name: game.ended or not body.works for name, body in bodies.items()}
        truncated = dict.fromkeys(acting, game.cut)
        self.agents = [name for name in acting if not (terminated[name] or truncated[name])]
        return self._observations(acting), rewards, terminated, truncated, self._infos(acting)

    def render(self) -> Picture | None:
        """What the team knows together; None unless `render_mode` is `rgb_array`."""
        return self._game.picture() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Nothing is held."""

    def _observations(self, names: list[str]) -> dict[str, Observation]:
        bodies = self._game.cycle.bodies
        return {name: self._game.observe(bodies[self._numbers[name]]) for name in names}

    def _infos(self, names: list[str]) -> dict[str, dict[str, Any]]:
        bodies = self._game.cycle.bodies
        return {name: self._game.facts(bodies[self._numbers[name]]) for name in names}
