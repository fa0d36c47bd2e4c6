"""Which INIT asks for something that is no robot, and what it gets."""

from __future__ import annotations

from usarsim_server.control.objects import WorldObjects
from usarsim_server.control.world_controller import WorldController, is_world_controller
from usarsim_server.logs import Log
from usarsim_server.protocol.requests import Init
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.fleet import Fleet
from usarsim_server.robots.role import Casting
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.worlds.description import WorldDescription

__all__ = ["SpecialRoles"]


class SpecialRoles:
    """Makes world controllers; a `RoleFactory`."""

    def __init__(
        self,
        objects: WorldObjects,
        fleet: Fleet,
        world: WorldDescription,
        simulation: Simulation,
        clean_on_close: bool,
    ) -> None:
        """Know everything that roles need.

        Args:
            objects, fleet, world, simulation: of the world.
            clean_on_close: objects leave with the connection that created them.
        """
        self._objects = objects
        self._fleet = fleet
        self._world = world
        self._simulation = simulation
        self._clean_on_close = clean_on_close

    def __call__(self, init: Init, pose: Pose, log: Log) -> Casting | None:
        """The role that INIT asks for; None if it asks for a robot."""
        if is_world_controller(init.class_name):
            return self._world_controller(log)
        return None

    def _world_controller(self, log: Log) -> Casting:
        controller = WorldController(
            self._objects, self._fleet, self._world, self._simulation, self._clean_on_close, log
        )
        log.info("world controller connected")
        return Casting(controller, "WorldController", Dialect.UT2004, leave=controller.leave)
