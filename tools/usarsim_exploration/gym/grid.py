"""The environments of the grid: `usarsim/ExploreGrid-v0`, `ExploreFrontiers-v0`, `ExploreTeam`."""

from __future__ import annotations

from pathlib import Path

from usarsim_exploration.gym.doors import Alone, Together
from usarsim_exploration.gym.game import DEFAULT, Action, Game, Tables
from usarsim_exploration.gym.level import Rewards


class ExploreGrid(Alone):
    """One robot on the grid; docs/gym.md has its spaces, with shapes and units."""

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
        super().__init__(Game(scenario, 1, action, worlds, rewards, drawn), render_mode)


class ExploreTeam(Together):
    """A team on the grid, under limited radio; docs/gym.md has its spaces.

    All act at once, as in a step of `usarsim explore`. Maps are merged when robots are linked,
    directly or over others and the base, and only then: each agent sees its own map.
    """

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

        Raises:
            UsarsimError: something cannot be used; says what, and the cure.
        """
        rewards = Rewards(coverage, steps, time_cost, collision_cost)
        drawn = render_mode == "rgb_array"
        super().__init__(Game(scenario, robots, action, worlds, rewards, drawn), render_mode)
