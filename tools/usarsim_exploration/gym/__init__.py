"""Exploration as environments for learning: Gymnasium for one robot, PettingZoo for teams.

Importing this registers `usarsim/ExploreGrid-v0`, `usarsim/ExploreFrontiers-v0` and
`usarsim/ExplorePhysics-v0`. `gymnasium.make("usarsim_exploration.gym:usarsim/ExploreGrid-v0")`
imports it by itself. Teams are `ExploreTeam` and `ExplorePhysicsTeam`. See docs/gym.md.
"""

from usarsim_server.base.extras import need

need("gymnasium", "pettingzoo", extra="gym", asker="usarsim_exploration.gym")

import gymnasium  # noqa: E402

from usarsim_exploration.gym.grid import ExploreGrid, ExploreTeam  # noqa: E402
from usarsim_exploration.gym.physics import ExplorePhysics, ExplorePhysicsTeam  # noqa: E402

__all__ = ["ExploreGrid", "ExplorePhysics", "ExplorePhysicsTeam", "ExploreTeam"]

gymnasium.register("usarsim/ExploreGrid-v0", "usarsim_exploration.gym.grid:ExploreGrid")
gymnasium.register(
    "usarsim/ExploreFrontiers-v0",
    "usarsim_exploration.gym.grid:ExploreGrid",
    kwargs={"action": "frontier"},
)
gymnasium.register("usarsim/ExplorePhysics-v0", "usarsim_exploration.gym.physics:ExplorePhysics")
