"""What an effector is: a hand at the end of a link, its commands, what it holds, and the text about
it.

An effector type is one class in one file. It says how its hand takes hold and which SET opcodes it
obeys; lines, mounts and schedules are done once, for all of them. A new file in this package is
enough to add a type; outside packages use the entry point group `usarsim_server.effectors` (see
`usarsim_server.plugins`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import usarsim_server.actuators as package
from usarsim_server.plugins import PluginTypes
from usarsim_server.protocol.messages import EffectorMount, effector_status
from usarsim_server.protocol.numbers import read_number
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.robots.mounting import DeclaredItem, SetResult
from usarsim_server.simulation.articulation import HandModel, JointOrder, Order
from usarsim_server.simulation.frames import flip_point, wire_from_pose
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.simulation.snapshot import RobotBody


class Effector(DeclaredItem, ABC):
    """Base of all effectors; one instance belongs to one robot and is used by one thread.

    Attributes:
        name: item name, also the name of its body and of its hand.
        description: what the robot file says.
        robot: the class it is mounted on.
    """

    wire_type: ClassVar[str]
    """Type on the wire, canonical spelling."""

    def __init__(self, description: EffectorDescription, robot: RobotDescription) -> None:
        """Read the description.

        Raises:
            RobotDescriptionError: a key has a value that cannot be used.
        """
        super().__init__(description.item)
        self.name = description.name
        self.description = description
        self.robot = robot
        self.first_tool: str | None = None
        """Detached effector that it holds from the start, if any."""

    @abstractmethod
    def hand(self) -> HandModel:
        """How it takes hold."""

    @abstractmethod
    def configuration(self) -> Item:
        """Name and segments of CONF."""

    def operate(self, close: bool, body: BodyHandle) -> bool:
        """Close or open: fingers, if it has any, then the hand; whether it obeyed."""
        orders = {}
        for finger in self.description.fingers:
            assert finger.limits is not None
            orders[finger.joint] = JointOrder(Order.POSITION, finger.limits[close])
        if orders:
            body.command_joints(orders)
        return body.operate_hand(self.name, close)

    def set(self, opcode: str, params: str, body: BodyHandle) -> SetResult:
        """Obey a SET command; `opcode` is upper case. Unknown opcodes change nothing."""
        if opcode not in ("CLOSE", "OPEN", "GRIP"):
            return SetResult.UNKNOWN
        close = opcode == "CLOSE" or (opcode == "GRIP" and read_number(params) != 0.0)
        return SetResult.OK if self.operate(close, body) else SetResult.FAILED

    def attached(self, state: RobotBody) -> bool:
        """Whether it is part of the robot at present; a loose one neither acts nor reports."""
        if not self.description.detached:
            return True
        hands = state.snapshot.hands.get(state.layout.slot, {})
        return any(hand.holding == self.name for hand in hands.values())

    def status(self, state: RobotBody) -> str:
        """The EFF line."""
        closed = state.hand(self.name).closed
        return effector_status(state.time, self.wire_type, self.name, closed)

    def mount(self, holder: Effector | None = None) -> EffectorMount:
        """Where it sits, for GEO.

        Args:
            holder: the effector that holds it, if it is a tool: it then sits on the holder's link
                with its origin at the holder's tip. A loose tool is where the robot file lays it.
        """
        pose, link = self.description.item.pose, self.description.item.link
        if holder is not None:
            pose, link = holder.description.item.pose, holder.description.item.link
            pose = pose @ holder.hand().tip
        location, rotation = wire_from_pose(pose)
        carrier = None if link is None else self.robot.find_link(link)
        return EffectorMount(
            name=self.name,
            location=location,
            rotation=rotation,
            mount=self.robot.name if carrier is None else carrier[0].name,
            mount_link=None if carrier is None else carrier[1],
            tip=flip_point(self.description.tip),
        )


GROUP = "usarsim_server.effectors"
"""Entry point group for effector types of other packages."""

TYPES: PluginTypes[Effector] = PluginTypes("effector", Effector, (package,), GROUP)

register_effector = TYPES.register
"""Class decorator: make an effector available under these types of a robot file."""

effector_types = TYPES.names
"""All types a robot file may name, sorted."""


def create_effector(description: EffectorDescription, robot: RobotDescription) -> Effector:
    """Make the effector that a robot file asks for.

    Raises:
        RobotDescriptionError: the type is unknown, or a parameter is unknown or ill-typed.
    """
    item = description.item
    cls = TYPES.find(item.type, item.where or f"effector {item.name}")
    effector = cls(description, robot)
    effector.parameters.finish()
    return effector


def create_effectors(robot: RobotDescription) -> tuple[Effector, ...]:
    """Make all effectors of a robot, in the order of its file.

    Raises:
        RobotDescriptionError: see `create_effector`.
    """
    return tuple(create_effector(description, robot) for description in robot.effectors)


@dataclass(frozen=True, slots=True)
class Change:
    """One change that the client did not cause by this very line."""

    event: str
    """ItemAttached or ItemReleased for things in a hand, ToolAttached or ToolReleased for an
    effector of the robot that a tool changer took or let go."""
    wire_type: str  # type of the hand, or of the tool
    name: str  # of the hand, or of the tool


class Holdings:
    """Compares what is held from look to look; used by one thread."""

    def __init__(self, effectors: Sequence[Effector]) -> None:
        self._hands = tuple(effectors)
        self._tools = {one.name: one for one in effectors if one.description.detached}
        self._held: dict[str, str | None] | None = None

    def changes(self, state: RobotBody) -> list[Change]:
        """What has changed since the last call; nothing at the first one."""
        if not self._hands:
            return []
        held = {hand.name: state.hand(hand.name).holding for hand in self._hands}
        before, self._held = self._held, held
        if before is None or before == held:
            return []
        changes: list[Change] = []
        for hand in self._hands:
            old, new = before[hand.name], held[hand.name]
            if old == new:
                continue
            if old is not None:
                changes.append(self._change(hand, old, "Released"))
            if new is not None:
                changes.append(self._change(hand, new, "Attached"))
        return changes

    def _change(self, hand: Effector, held: str, end: str) -> Change:
        tool = self._tools.get(held)
        if tool is not None:
            return Change(f"Tool{end}", tool.wire_type, tool.name)
        return Change(f"Item{end}", hand.wire_type, hand.name)
