"""Everything on a robot that moves and is no wheel, as its pilot uses it.

Requests become orders to joints and hands; GETCONF and GETGEO of actuators and effectors are
answered; status lines are written. No threads, no schedule.
"""

from __future__ import annotations

from collections.abc import Sequence

from usarsim_server.actuators.base import Actuator, joint_order
from usarsim_server.actuators.effector import Change, Effector, Holdings, create_effectors
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import sends_results
from usarsim_server.protocol.numbers import read_number
from usarsim_server.protocol.requests import Act, Drive, LinkTarget, MisPkg, MultiDrive, Set
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.simulation.snapshot import RobotBody

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
        self._followers = {
            link.joint: link.follows.lower()
            for actuator in robot.actuators
            for link in actuator.links
            if link.follows is not None
        }
        self._loose = tuple(
            link for one in robot.actuators if not one.package for link in one.links
        )

    # -- commands ----------------------------------------------------------------------------

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
                self._command(
                    {
                        self._joints[name].joint: JointOrder(Order.POSITION, value)
                        for name, value in request.joints.items()
                        if name in self._joints
                    }
                )

    def drive(self, request: Drive) -> None:
        """The single joint form of DRIVE (protocol reference 3.4.6)."""
        link = self._joints.get((request.name or "").lower())
        if link is None or request.value is None or request.steer:
            return
        order = joint_order(link, request.order, request.value, self._state(request.order))
        if order is not None:
            self._command({link.joint: order})

    def _move(self, name: str, groups: Sequence[LinkTarget], first: int) -> None:
        for actuator in self.actuators:
            if actuator.name.lower() == name.lower():
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
        if self._followers:
            free = {name.lower(): one for name, one in orders.items()}
            orders = {name: one for name, one in orders.items() if name not in self._followers}
            for follower, leader in self._followers.items():
                if leader in free:
                    orders[follower] = free[leader]
        if orders:
            self._body.command_joints(orders)

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
        return tuple((link.joint, state.joint_position(link.joint)) for link in self._loose)
