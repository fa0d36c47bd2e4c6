"""The environments of the physics: `usarsim/ExplorePhysics-v0` and `ExplorePhysicsTeam`."""

from __future__ import annotations

from usarsim_exploration.gym.crew import Crew, Localisation, Tables
from usarsim_exploration.gym.doors import Alone, Together
from usarsim_exploration.gym.level import Rewards


class ExplorePhysics(Alone):
    """One robot in MuJoCo; docs/gym.md has its spaces, with shapes and units."""

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
        """Compile the world, once; see `Crew` and `Rewards` for what the arguments mean.

        Raises:
            UsarsimError: something cannot be used; says what, and the cure.
        """
        rewards = Rewards(coverage, steps, time_cost, collision_cost)
        drawn = render_mode == "rgb_array"
        crew = Crew(
            world, 1, robot, speed, reach, noise, localisation, {}, 0.0, rewards, drawn
        )  # fmt: skip
        super().__init__(crew, render_mode)


class ExplorePhysicsTeam(Together):
    """A team in MuJoCo, under limited radio; docs/gym.md has its spaces.

    Robots see each other by their range finders and can collide. Maps are merged when robots are
    linked, directly or over others and the base; other robots are left out of them.
    """

    def __init__(
        self,
        world: str = "lab",
        *,
        robots: int = 2,
        robot: str = "P3AT",
        speed: float = 0.8,
        reach: float = 10.0,
        noise: float = 0.0,
        localisation: Localisation = "truth",
        radio: Tables | None = None,
        radio_range: float = 20.0,
        coverage: float = 0.95,
        steps: int = 3000,
        time_cost: float = 0.02,
        collision_cost: float = 0.1,
        render_mode: str | None = None,
    ) -> None:
        """Compile the world, once; see `Crew` and `Rewards` for what the arguments mean.

        Raises:
            UsarsimError: something cannot be used; says what, and the cure.
        """
        rewards = Rewards(coverage, steps, time_cost, collision_cost)
        drawn = render_mode == "rgb_array"
        crew = Crew(
            world, robots, robot, speed, reach, noise, localisation, radio or {}, radio_range,
            rewards, drawn,
        )  # fmt: skip
        super().__init__(crew, render_mode)
