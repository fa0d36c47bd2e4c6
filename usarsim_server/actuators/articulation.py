"""Everything on a robot that moves and is no wheel, as its pilot uses it.

Requests become orders to joints and hands; GETCONF and GETGEO of actuators and effectors are
answered; status lines are written. No threads, no schedule.

Links are numbered from 1 in MISPKG and in everything that is reported, from 0 in ACT (protocol
reference 5.2 number 5). GEO announces every link by a frame whose z axis is the axis of its joint
(protocol 4.7), as captured messages show: a pan axis that points upwards is `{Orientation
3.1415,0.0000,0.0000}` on the body, a tilt axis that points to the right is `1.5707,0.0000,0.0000`
on the pan. What is mounted on a link is announced in another frame, the link's own, which is
parallel to the body while the joints are at zero; captured poses of cameras on such links have no
rotation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from usarsim_server.actuators.effectors import Change, Effector, Holdings, create_effectors
from usarsim_server.base.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import sends_results
from usarsim_server.protocol.numbers import read_number
from usarsim_server.protocol.requests import Act, Drive, LinkTarget, MisPkg, MultiDrive, Set
from usarsim_server.protocol.values import Dialect, near
from usarsim_server.robots.coupling import coupled_position, coupled_speed, farthest
from usarsim_server.robots.description import ActuatorDescription, LinkDescription, RobotDescription
from usarsim_server.robots.families.base import within
from usarsim_server.robots.mounting import SetResult
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.frames import (
    IDENTITY,
    Pose,
    Vector,
    flip_point,
    flip_quaternion,
    quaternion_from_rpy,
    wire_from_pose,
)
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.simulation.snapshot import RobotBody


def joint_frame(link: LinkDescription) -> Pose:
    """The announced frame of a link, seen from the link's own frame.

    It is turned about x, and only if the axis has a part along x also about the new y.
    """
    x, y, z = flip_point(link.axis)
    roll = math.atan2(-y, z) if y or z else 0.0
    if roll <= -math.pi:
        roll = math.pi
    pitch = math.asin(min(1.0, max(-1.0, x)))
    about_x = Pose(quaternion=flip_quaternion(quaternion_from_rpy(roll, 0.0, 0.0)))
    about_y = Pose(quaternion=flip_quaternion(quaternion_from_rpy(0.0, pitch, 0.0)))
    return about_x @ about_y


def announced_link(
    actuator: ActuatorDescription, index: int, base: Pose = IDENTITY
) -> tuple[Vector, Vector]:
    """Wire location (m) and rotation (rad) of a link relative to its parent, joints at zero.

    Args:
        actuator: the chain.
        index: of the link, from 0.
        base: what links without a parent are relative to is here, seen from the base.
    """
    link = actuator.links[index]
    origin = base if link.parent is None else joint_frame(actuator.links[link.parent])
    return wire_from_pose(origin.inverse() @ link.pose @ joint_frame(link))


_log = Log("robot")

_PLAY = 1e-9
"""rad or m by which limits may be passed."""

RELATIVE = 10
"""Orders 10, 11, 12 are 0, 1, 2 relative to the present value (robots reference 1.6)."""


def joint_order(
    link: LinkDescription, order: int, value: float, state: RobotBody | None
) -> JointOrder | None:
    """What a wire order means for a joint; None if there is no such order.

    Args:
        link: the link that the joint moves.
        order: 0 position, 1 velocity, 2 torque; 10, 11, 12 the same on top of what is.
        value: rad or m, their rates, N m or N.
        state: the present state, needed for relative orders only.
    """
    kind = order - RELATIVE if order >= RELATIVE else order
    if not Order.POSITION <= kind <= Order.TORQUE:
        return None
    if order >= RELATIVE:
        if state is None:
            return None
        value += _present(link, Order(kind), state)
    return JointOrder(Order(kind), value)


def _present(link: LinkDescription, order: Order, state: RobotBody) -> float:
    if order is Order.POSITION:
        return state.joint_position(link.joint)
    if order is Order.VELOCITY:
        return state.joint_velocity(link.joint)
    return state.joint_torque(link.joint)


def _tell_clamped(link: LinkDescription, order: Order, value: float) -> None:
    """Say what the servo of a joint will take for its limit."""
    low, high = link.limits or (-math.inf, math.inf)
    if order is Order.STIFFNESS:
        low, high = 0.0, 1.0
    elif order is not Order.POSITION:
        high = link.max_speed if order is Order.VELOCITY else link.max_torque
        low = -high
    if not low <= value <= high:
        within(f"{link.joint}: {order.name.lower()}", value, low, high)


class Actuator:
    """A mission package or arm; used by one thread.

    Attributes:
        name: item name.
        description: what the robot file says.
    """

    def __init__(self, description: ActuatorDescription, robot: RobotDescription) -> None:
        self.name = description.name
        self.description = description
        mount = description.mount
        carrier = None if mount is None else robot.find_link(mount)
        self._mount = robot.name if carrier is None else carrier[0].name
        self._mount_link = None if carrier is None else carrier[1]

    def orders(
        self, groups: Sequence[LinkTarget], first: int, state: RobotBody | None
    ) -> dict[str, JointOrder]:
        """Orders by joint; links and orders that do not exist are left out.

        Args:
            groups: as sent.
            first: number that the client means by the first link: 1 in MISPKG, 0 in ACT.
            state: the present state, needed for relative orders only.
        """
        orders = {}
        for group in groups:
            index = group.link - first
            if not 0 <= index < len(self.description.links):
                continue
            link = self.description.links[index]
            order = joint_order(link, group.order, group.value, state)
            if order is not None:
                orders[link.joint] = order
        return orders

    def status(self, dialect: Dialect, state: RobotBody) -> str:
        """The MISSTA or ASTA line."""
        links = [
            (state.joint_position(link.joint), state.joint_torque(link.joint))
            for link in self.description.links
        ]
        return messages.actuator_status(dialect, state.time, self.name, links)

    def item(self) -> messages.ActuatorItem:
        """The actuator for CONF and GEO Actuator: its links hang on its base."""
        location, rotation = wire_from_pose(self.description.pose)
        return messages.ActuatorItem(
            name=self.name,
            location=location,
            rotation=rotation,
            mount=self._mount,
            mount_link=self._mount_link,
            links=self._links(IDENTITY),
            tip=flip_point(self.description.tip),
        )

    def package(self) -> messages.ActuatorItem:
        """The actuator for CONF and GEO MisPkg: its links hang on what carries it."""
        return messages.ActuatorItem(
            name=self.name, links=self._links(self.description.pose.inverse())
        )

    def _links(self, base: Pose) -> tuple[messages.ActuatorLink, ...]:
        links = []
        for index, link in enumerate(self.description.links):
            location, rotation = announced_link(self.description, index, base)
            links.append(
                messages.ActuatorLink(
                    joint_type=link.type.value,
                    max_speed=link.max_speed,
                    max_torque=link.max_torque,
                    limits=link.limits,
                    parent=None if link.parent is None else link.parent + 1,
                    location=location,
                    rotation=rotation,
                )
            )
        return tuple(links)


ALL_JOINTS = frozenset({"alljoints", "allangles"})
JOINT_OPCODES = frozenset({"ANGLE", "TARGET"})


class Articulation:
    """Actuators and effectors of one robot; used by one thread."""

    def __init__(self, robot: RobotDescription, body: BodyHandle) -> None:
        """Make the actuators and effectors that a robot file asks for.

        Raises:
            RobotDescriptionError: if an effector's type or parameters are wrong.
        """
        self._body = body
        self.actuators = tuple(Actuator(one, robot) for one in robot.actuators if one.package)
        self.effectors = create_effectors(robot)
        self._holdings = Holdings(self.effectors)
        self._joints = {
            name.lower(): link
            for actuator in robot.actuators
            for link in actuator.links
            for name in (link.body, link.joint)
        }
        self._links = {
            link.joint.lower(): link for actuator in robot.actuators for link in actuator.links
        }
        self._bound = frozenset(
            link.joint
            for link in self._links.values()
            if link.follows is not None or link.coupling is not None
        )
        """Joints that take no orders of their own."""
        self._followers = self._leaders_first()
        self._told = tuple(
            link.joint for one in robot.actuators if not one.package for link in one.links
        )

    # -- commands ----------------------------------------------------------------------------

    def means(self, request: Set) -> bool:
        """Whether a SET is for joints or effectors."""
        return request.type.lower() == "joint" or bool(self._find(request.type, request.name))

    def obey(self, request: MisPkg | Act | MultiDrive) -> None:
        """Carry out a command; what it names and does not exist is ignored."""
        match request:
            case MisPkg():
                self._move(request.name, request.groups, 1)
                self._grip(request.name, request.gripper)
            case Act():
                self._move(request.name, request.groups, 0)
                self._grip(request.name, request.gripper)
            case MultiDrive():
                orders = {}
                for name, value in request.joints.items():
                    link = self._joints.get(name)
                    if link is None:
                        _log.debug("there is no such joint", joint=name)
                    else:
                        orders[link.joint] = JointOrder(Order.POSITION, value)
                self._command(orders)

    def drive(self, request: Drive) -> None:
        """The single joint form of DRIVE (protocol reference 3.4.6)."""
        link = self._joints.get((request.name or "").lower())
        if link is None and request.name and _log.is_heard:
            hint = near(request.name, self._joints)
            _log.debug(f"there is no such joint{hint}", name=request.name)
        if link is None or request.value is None or request.steer:
            return
        order = joint_order(link, request.order, request.value, self._state(request.order))
        if order is not None:
            self._command({link.joint: order})

    def _move(self, name: str, groups: Sequence[LinkTarget], first: int) -> None:
        wanted = name.lower()
        names = [one.name for one in self.actuators] + [one.name for one in self.effectors]
        if _log.is_heard and wanted not in map(str.lower, names):
            known = ", ".join(sorted(names)) or "none"
            _log.debug(f"there is no such actuator{near(name, names)}", name=name, known=known)
        for actuator in self.actuators:
            if actuator.name.lower() == wanted:
                newest = max((group.order for group in groups), default=0)
                self._command(actuator.orders(groups, first, self._state(newest)))

    def _grip(self, name: str, gripper: int | None) -> None:
        """Close or open the effectors of an actuator, or the effector of that name."""
        if gripper is None:
            return
        wanted = name.lower()
        carried = {
            link.body
            for actuator in self.actuators
            if actuator.name.lower() == wanted
            for link in actuator.description.links
        }
        for effector in self.effectors:
            if effector.name.lower() == wanted or effector.description.item.link in carried:
                effector.set("GRIP", str(gripper), self._body)

    def _command(self, orders: dict[str, JointOrder]) -> None:
        for name, (order, value) in orders.items():
            _tell_clamped(self._joints[name.lower()], order, value)
        if self._bound:
            orders = self._with_followers(orders)
        if orders:
            self._body.command_joints(orders)

    def _leaders_first(self) -> tuple[LinkDescription, ...]:
        """Links whose joints follow others, each behind the one that it follows."""
        found: list[LinkDescription] = []
        left = [link for link in self._links.values() if link.follows is not None]
        while left:
            behind = {link.joint.lower() for link in left}
            found += [link for link in left if (link.follows or "").lower() not in behind]
            left = [link for link in left if (link.follows or "").lower() in behind]
            if len(left) == len(behind):
                break  # a ring, which robot files cannot have
        return tuple(found)

    def _with_followers(self, orders: Mapping[str, JointOrder]) -> dict[str, JointOrder]:
        """Orders of joints that take some, and what these mean for those that follow."""
        found = {name: one for name, one in orders.items() if name not in self._bound}
        led = {link.follows.lower() for link in self._followers if link.follows and link.coupling}
        for name, (order, value) in found.items():
            if order is Order.POSITION and name.lower() in led:
                found[name] = JointOrder(order, self._within_reach(name, value))
        given = {name.lower(): one for name, one in found.items()}
        for link in self._followers:
            assert link.follows is not None
            leader = given.get(link.follows.lower())
            if leader is not None:
                found[link.joint] = given[link.joint.lower()] = self._follow(link, leader)
        return found

    def _follow(self, link: LinkDescription, leader: JointOrder) -> JointOrder:
        """What an order to its leader means for a joint."""
        if link.coupling is None or leader.order is Order.STIFFNESS:
            return leader
        if leader.order is Order.POSITION:
            return JointOrder(Order.POSITION, coupled_position(link.coupling, leader.value))
        # Rods carry it: it has no drive, and so holds nothing against them.
        slope = coupled_speed(link.coupling, self._links[(link.follows or "").lower()].home, 1.0)
        return JointOrder(leader.order, slope * leader.value)

    def _within_reach(self, name: str, value: float) -> float:
        """The position next to a wanted one in which all that is coupled is within its limits."""
        leader = self._links[name.lower()]
        low, high = leader.limits or (-math.inf, math.inf)

        def allowed(place: float) -> bool:
            places = {name.lower(): place}
            for link in self._followers:
                above = places.get((link.follows or "").lower())
                if link.coupling is None or above is None:
                    continue
                here = places[link.joint.lower()] = coupled_position(link.coupling, above)
                least, most = link.limits or (-math.inf, math.inf)
                if not least - _PLAY <= here <= most + _PLAY:
                    return False
            return True

        return farthest(min(max(value, low), high), leader.home, allowed)

    def _state(self, order: int) -> RobotBody | None:
        """The present state, but only if an order may need it: looking takes time."""
        return self._body.look() if order > Order.TORQUE else None

    # -- SET ---------------------------------------------------------------------------------

    def set(self, request: Set, dialect: Dialect) -> list[str]:
        """Obey a SET to joints or effectors; returns the RES lines, none if nobody is meant."""
        opcode = request.opcode
        if opcode is None:
            return []
        if request.type.lower() == "joint":
            results = self._set_joints(request.name or "", opcode, request.params)
        else:
            results = [
                (effector.wire_type, effector.name, self._set(effector, opcode, request.params))
                for effector in self._find(request.type, request.name)
            ]
        state = self._body.look() if results and sends_results(dialect) else None
        return [
            messages.result(state.time, wire_type, name, result is not SetResult.FAILED)
            for wire_type, name, result in results
            if state is not None and result is not SetResult.UNKNOWN
        ]

    def _set(self, effector: Effector, opcode: str, params: str) -> SetResult:
        if effector.description.detached:
            state = self._body.look()
            if state is None or not effector.attached(state):
                return SetResult.FAILED
        return effector.set(opcode, params, self._body)

    def _set_joints(self, name: str, opcode: str, params: str) -> list[tuple[str, str, SetResult]]:
        if name.lower() in ALL_JOINTS:
            links = list(dict.fromkeys(self._joints.values()))
        else:
            links = [self._joints[name.lower()]] if name.lower() in self._joints else []
        if not links:
            return []
        value = read_number(params)
        if opcode in JOINT_OPCODES:
            self._command({link.joint: JointOrder(Order.POSITION, value) for link in links})
        elif opcode == "STIFFNESS":
            self._command({link.joint: JointOrder(Order.STIFFNESS, value) for link in links})
        else:
            return [("Joint", name, SetResult.UNKNOWN)]
        return [("Joint", name, SetResult.OK)]

    def _find(self, wire_type: str, name: str | None) -> list[Effector]:
        """Effectors of a type on the wire or of a robot file, and of a name if there is one."""
        wanted = wire_type.strip().lower()
        return [
            effector
            for effector in self.effectors
            if wanted in (effector.wire_type.lower(), effector.description.item.type.lower())
            and (name is None or effector.name.lower() == name.strip().lower())
        ]

    # -- answers -----------------------------------------------------------------------------

    def configuration(self, wire_type: str, name: str | None, dialect: Dialect) -> str:
        """The answer to GETCONF, empty if there is none."""
        match wire_type.strip().lower():
            case "actuator":
                chosen = self._choose(name)
                return messages.actuator_configuration([one.item() for one in chosen])
            case "mispkg":
                packages = [one.package() for one in self._choose(name)]
                return messages.mission_package_configuration(dialect, packages)
        found = self._find(wire_type, name)
        items = [effector.configuration() for effector in found]
        return messages.configuration(found[0].wire_type, items) if found else ""

    def geometry(self, wire_type: str, name: str | None) -> str:
        """The answer to GETGEO, empty if there is none."""
        match wire_type.strip().lower():
            case "actuator":
                return messages.actuator_geometry([one.item() for one in self._choose(name)])
            case "mispkg":
                packages = [one.package() for one in self._choose(name)]
                return messages.mission_package_geometry(packages)
        found = self._find(wire_type, name)
        mounts = [effector.mount(self._holder(effector)) for effector in found]
        return messages.effector_geometry(found[0].wire_type, mounts) if found else ""

    def _holder(self, tool: Effector) -> Effector | None:
        """What holds a detached effector at present."""
        state = self._body.look() if tool.description.detached else None
        if state is None:
            return None
        held = (one for one in self.effectors if state.hand(one.name).holding == tool.name)
        return next(held, None)

    def _choose(self, name: str | None) -> list[Actuator]:
        if name is None:
            return list(self.actuators)
        return [one for one in self.actuators if one.name.lower() == name.strip().lower()]

    # -- reports -----------------------------------------------------------------------------

    def actuator_lines(self, dialect: Dialect, state: RobotBody) -> list[str]:
        """MISSTA or ASTA of every actuator."""
        return [actuator.status(dialect, state) for actuator in self.actuators]

    def effector_lines(self, state: RobotBody) -> list[str]:
        """EFF of every effector that is attached."""
        return [one.status(state) for one in self.effectors if one.attached(state)]

    def changes(self, state: RobotBody) -> list[Change]:
        """What its hands have taken or let go since the last call."""
        return self._holdings.changes(state)

    def joints(self, state: RobotBody) -> tuple[tuple[str, float], ...]:
        """Name and position (rad or m) of the joints that STA tells of, such as flippers."""
        return tuple(zip(self._told, state.joint_positions(self._told), strict=True))
