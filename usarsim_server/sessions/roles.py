"""What INIT makes of a connection, and where it puts it (protocol reference 3.2).

Also the answers to questions about the world, which any connection may ask before it has a role.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from usarsim_server.base.errors import SpawnError
from usarsim_server.base.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import DialectMode
from usarsim_server.protocol.requests import GetClosestPathNode, GetPathNodes, GetStartPoses, Init
from usarsim_server.protocol.values import near
from usarsim_server.sessions.avatar import Walker
from usarsim_server.sessions.robot_role import RobotRole, RobotRoleOptions
from usarsim_server.sessions.robots import Robots
from usarsim_server.sessions.schedule import Role
from usarsim_server.sessions.world_controller import WorldController, is_world_controller
from usarsim_server.simulation.frames import Pose, pose_from_wire, wire_from_pose
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.worlds.avatars.avatars import Avatars
from usarsim_server.worlds.avatars.bodies import AvatarClass
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.objects.objects import WorldObjects

AVATAR_PACKAGE = "usaravatar"
"""In lower case; without the package only classes whose own names begin so are avatars, lest one
of them hides a robot."""

_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class RoleOptions:
    """What a lab may change about connections and their roles."""

    dialect: DialectMode = DialectMode.AUTO  # how the dialect of a connection is chosen
    replace_robot: bool = False  # a second INIT replaces the robot instead of being ignored
    tick: float | None = None  # simulated s between two ticks of lockstep; None without lockstep
    role: RobotRoleOptions = field(default_factory=RobotRoleOptions)
    """Its quiet period holds for avatars, too."""
    start_at_first_pose: bool = False
    """INIT without place uses the first start pose, not the origin."""
    clean_on_close: bool = False  # objects leave with the world controller that created them


@dataclass(frozen=True, slots=True, eq=False)
class Roles:
    """Makes the roles of all connections of a server; for any thread."""

    world: WorldDescription
    simulation: Simulation
    robots: Robots
    objects: WorldObjects
    avatars: Avatars
    admit: Callable[[str], None]
    """Asked, with `host:port` of the client, before anything comes in; raises `SpawnError`."""
    forget: Callable[[str], None]  # told that one which was let in did not come after all
    options: RoleOptions

    def make(self, init: Init, peer: str, wanted: Callable[[], bool], log: Log) -> Role:
        """The role that INIT asks for. May take long.

        Args:
            init: the request.
            peer: `host:port` of the client.
            wanted: asked when a robot's turn has come; others before it may have taken long.
            log: names the connection.

        Raises:
            UsarsimError: if it cannot be played.
        """
        pose = self._place(init, log)
        self.admit(peer)
        if is_world_controller(init.class_name):
            log.info("world controller connected")
            return WorldController(
                self.objects,
                self.robots,
                self.world,
                self.simulation,
                self.options.clean_on_close,
                log,
            )
        packed = init.package.lower() == AVATAR_PACKAGE
        if packed or init.class_name.lower().startswith(AVATAR_PACKAGE):
            kind = self.avatars.find_class(init.class_name)
            if kind is not None:
                return self._avatar(kind, init, pose, log)
            if packed:
                raise SpawnError(
                    f"there is no avatar of this class{near(init.class_name, self.avatars.names)}"
                )
        description = self.robots.describe(init.class_name)
        if description is None:
            self.forget(peer)  # a class that does not exist costs nothing
            raise SpawnError(f"unknown class{near(init.class_name, self.robots.class_names)}")
        asked = self.robots.time
        vehicle = self.robots.spawn(description, init.name, pose, wanted, init.exact_name)
        log = log.bind(robot=vehicle.name)
        log.info("robot spawned", robot_class=description.name, id=vehicle.robot)
        return RobotRole(vehicle, description.dialect, self.options.role, init.battery, log, asked)

    def _avatar(self, kind: AvatarClass, init: Init, pose: Pose, log: Log) -> Walker:
        avatar = self.avatars.spawn(kind, init.name, pose, init.exact_name)
        log = log.bind(avatar=avatar.name)
        log.info("avatar spawned", avatar_class=kind.name, id=avatar.body)
        quiet = self.options.role.quiet_period
        return Walker(avatar, self.avatars, self.world.path_nodes, self.simulation, quiet, log)

    def _place(self, init: Init, log: Log) -> Pose:
        """Where INIT wants to be."""
        starts = self.world.starts
        if init.start is not None:
            start = self.world.start(init.start)
            if start is not None:
                return start.pose
            hint = near(init.start, (one.tag for one in starts))
            log.warning(f"unknown start pose, the first one is used{hint}", start=init.start)
            if starts:
                return starts[0].pose
        elif init.location is None and self.options.start_at_first_pose and starts:
            return starts[0].pose
        return pose_from_wire(init.location or _ZERO, init.rotation or _ZERO)

    # -- questions about the world -----------------------------------------------------------

    def start_poses(self, request: GetStartPoses) -> list[str]:
        """Where robots may start."""
        starts = self.world.starts
        poses = messages.start_poses([(start.tag, *start.announced) for start in starts])
        return [messages.exact_names(), poses] if request.exact_name else [poses]

    def path_nodes(self, request: GetPathNodes) -> list[str]:
        """The nodes of the graph that avatars walk along."""
        nodes = [
            (node.tag, wire_from_pose(Pose(node.position))[0], _ZERO)
            for node in self.world.path_nodes
        ]
        return [messages.path_nodes(nodes)]

    def closest_path_node(self, request: GetClosestPathNode) -> list[str]:
        """The one nearest to a place, seen from above."""
        nodes = self.world.path_nodes
        if request.location is None or not nodes:
            return []
        x, y, _ = pose_from_wire(request.location).position
        nearest = min(nodes, key=lambda one: math.hypot(one.position[0] - x, one.position[1] - y))
        location, _ = wire_from_pose(Pose(nearest.position))
        return [messages.closest_path_node(nearest.tag, location)]
