"""Which INIT asks for something that is no robot, and what it gets (protocol reference 3.2)."""

from __future__ import annotations

from usarsim_server.errors import SpawnError
from usarsim_server.logs import Log
from usarsim_server.protocol.requests import Init
from usarsim_server.protocol.values import Dialect
from usarsim_server.sessions.avatar import Walker
from usarsim_server.sessions.robots import Fleet
from usarsim_server.sessions.role import Casting
from usarsim_server.sessions.world_controller import WorldController, is_world_controller
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.worlds.avatars.avatars import Avatars
from usarsim_server.worlds.avatars.bodies import AvatarClass
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.objects.objects import WorldObjects

AVATAR_PACKAGE = "usaravatar"
"""In lower case; without the package only classes whose own names begin so are avatars, lest one
of them hides a robot."""


class SpecialRoles:
    """Makes world controllers and avatars; a `RoleFactory`."""

    def __init__(
        self,
        objects: WorldObjects,
        avatars: Avatars,
        fleet: Fleet,
        world: WorldDescription,
        simulation: Simulation,
        clean_on_close: bool,
        quiet_period: float,
    ) -> None:
        """Know everything that roles need.

        Args:
            objects, avatars, fleet, world, simulation: of the world.
            clean_on_close: objects leave with the connection that created them.
            quiet_period: simulated s after INIT in which an avatar reports nothing.
        """
        self._objects = objects
        self._avatars = avatars
        self._quiet_period = quiet_period
        self._fleet = fleet
        self._world = world
        self._simulation = simulation
        self._clean_on_close = clean_on_close

    def __call__(self, init: Init, pose: Pose, log: Log) -> Casting | None:
        """The role that INIT asks for; None if it asks for a robot."""
        if is_world_controller(init.class_name):
            return self._world_controller(log)
        kind = self._avatars.find_class(init.class_name)
        if init.package.lower() == AVATAR_PACKAGE:
            if kind is None:
                raise SpawnError("there is no avatar of this class")
            return self._avatar(kind, init, pose, log)
        if kind is not None and init.class_name.lower().startswith(AVATAR_PACKAGE):
            return self._avatar(kind, init, pose, log)
        return None

    def _world_controller(self, log: Log) -> Casting:
        controller = WorldController(
            self._objects, self._fleet, self._world, self._simulation, self._clean_on_close, log
        )
        log.info("world controller connected")
        return Casting(controller, "WorldController", Dialect.UT2004, leave=controller.leave)

    def _avatar(self, kind: AvatarClass, init: Init, pose: Pose, log: Log) -> Casting:
        avatar = self._avatars.spawn(kind, init.name, pose)
        log = log.bind(avatar=avatar.name)
        walker = Walker(
            avatar,
            self._avatars,
            self._world.path_nodes,
            self._simulation,
            self._quiet_period,
            log,
        )
        log.info("avatar spawned", avatar_class=kind.name, id=avatar.body)
        return Casting(
            walker, avatar.name, Dialect.UDK, leave=walker.leave, attach=avatar.handle.attach
        )
