"""The former name of `usarsim_exploration.gym`, kept for one release."""

from usarsim_exploration.gym import ExploreGrid, ExplorePhysics, ExplorePhysicsTeam, ExploreTeam

__all__ = ["ExploreGrid", "ExplorePhysics", "ExplorePhysicsTeam", "ExploreTeam"]
