"""What an effector is: a hand at the end of a link, its commands, what it holds, and the text about
it.

An effector type is one class. It says how its hand takes hold and which SET opcodes it obeys;
lines, mounts and schedules are done once, for all of them. A new file in this package is enough to
add a type; outside packages use the entry point group `usarsim_server.effectors` (see
`usarsim_server.base.plugins`).

Here are the gripper, whose fingers close on a thing (protocol reference 3.7, 4.8, 4.9), the vacuum
gripper, a suction cup, and the tool changer, which takes loose effectors (robots reference 1.10).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from usarsim_server.base.fields import field
from usarsim_server.base.plugins import PluginTypes
from usarsim_server.protocol import messages
from usarsim_server.protocol.numbers import read_number
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.robots.mounting import DeclaredItem, SetResult
from usarsim_server.simulation.articulation import Grip, HandModel, JointOrder, Order
from usarsim_server.simulation.frames import Pose, Vector, flip_point, wire_from_pose
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
        return messages.effector_status(state.time, self.wire_type, self.name, closed)

    def mount(self, holder: Effector | None = None) -> messages.EffectorMount:
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
        return messages.EffectorMount(
            name=self.name,
            location=location,
            rotation=rotation,
            mount=self.robot.name if carrier is None else carrier[0].name,
            mount_link=None if carrier is None else carrier[1],
            tip=flip_point(self.description.tip),
        )


GROUP = "usarsim_server.effectors"
"""Entry point group for effector types of other packages."""

TYPES: PluginTypes[Effector] = PluginTypes(
    "effector", Effector, ("usarsim_server.actuators",), GROUP
)

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


DEFAULT_STRENGTH = 100.0
"""N: a starting value."""


@register_effector("Gripper", "GripperEffector")
class Gripper(Effector):
    """Fingers that close with all their force until each of them touches the same thing.

    Parameters: `strength` (N), the pull, beyond what the friction of the fingers bears, at which a
    held thing slips away.
    """

    wire_type: ClassVar[str] = "Gripper"

    strength: float = field(default=DEFAULT_STRENGTH, above=0.0)

    def __init__(self, description: EffectorDescription, robot: RobotDescription) -> None:
        super().__init__(description, robot)
        if not description.fingers:
            raise self.parameters.error(
                "finger", "a gripper without fingers", "add [[effector.finger]] tables"
            )

    def hand(self) -> HandModel:
        """It holds what all fingers touch."""
        return HandModel(
            name=self.name,
            grip=Grip.PINCH,
            body=self.name,
            tip=Pose(self.description.tip),
            fingers=tuple(finger.body for finger in self.description.fingers),
            strength=self.strength,
        )

    def configuration(self) -> Item:
        """The opcodes it obeys."""
        return messages.gripper_item(self.name)


@register_effector("VacuumGripper", "Vacuum", "VacuumCup")
class VacuumGripper(Effector):
    """Holds the first thing in front of its tip, straight on from where it is mounted.

    While it is closed and empty it looks for something to hold again and again. On the wire it is
    a Gripper, as in the original.

    Parameters: `suction_length` (m), how far the suction reaches; `force` (N), the pull beyond
    which a thing comes off.
    """

    wire_type: ClassVar[str] = "Gripper"

    reach: float = field(default=0.125, above=0.0, key="suction_length")
    force: float = field(default=10.0, above=0.0)

    def hand(self) -> HandModel:
        """It holds what is in front of the tip."""
        return HandModel(
            name=self.name,
            grip=Grip.SUCTION,
            body=self.name,
            tip=_facing(self.description.tip),
            reach=self.reach,
            strength=self.force,
        )

    def configuration(self) -> Item:
        """The opcodes it obeys."""
        return messages.gripper_item(self.name)


def _facing(tip: Vector) -> Pose:
    """A pose at the tip whose x axis points away from the mount; ahead if the two coincide."""
    length = math.hypot(*tip)
    if length < 1e-9:
        return Pose(tip)
    x, y, z = (value / length for value in tip)
    if x < -1.0 + 1e-9:
        return Pose(tip, (0.0, 0.0, 0.0, 1.0))
    # Half way between the x axis and the wanted direction is the axis of half a turn's worth.
    w = math.sqrt((1.0 + x) / 2.0)
    return Pose(tip, (w, 0.0, -z / (2.0 * w), y / (2.0 * w)))


@register_effector("ToolChanger")
class ToolChanger(Effector):
    """CLOSE takes a detached effector of the same robot whose pose is near enough; OPEN drops it.

    Parameters: `position_tolerance` (m), `angle_tolerance` (rad); `tool`, name of a detached
    effector that it holds from the start.
    """

    wire_type: ClassVar[str] = "ToolChanger"

    position_tolerance: float = field(default=0.5, low=0.0)
    angle_tolerance: float = field(default=0.5, low=0.0)

    def __init__(self, description: EffectorDescription, robot: RobotDescription) -> None:
        super().__init__(description, robot)
        self.tools = {other.name: other for other in robot.effectors if other.detached}
        self.first_tool = self._first_tool()

    def _first_tool(self) -> str | None:
        wanted = self.parameters.raw("tool")
        if wanted is None:
            return None
        for name in self.tools:
            if isinstance(wanted, str) and wanted.lower() == name.lower():
                return name
        known = ", ".join(self.tools) or "none"
        raise self.parameters.error(
            "tool", f"{wanted!r} is no detached effector", f"known are: {known}"
        )

    def hand(self) -> HandModel:
        """It holds a tool with the tool's origin at its tip."""
        return HandModel(
            name=self.name,
            grip=Grip.COUPLING,
            body=self.name,
            tip=Pose(self.description.tip),
            tolerance=(self.position_tolerance, self.angle_tolerance),
            tools=tuple(self.tools),
        )

    def set(self, opcode: str, params: str, body: BodyHandle) -> SetResult:
        """CLOSE and OPEN; a changer cannot GRIP."""
        return SetResult.UNKNOWN if opcode == "GRIP" else super().set(opcode, params, body)

    def configuration(self) -> Item:
        """Tolerances and opcodes."""
        return messages.tool_changer_item(self.name, self.position_tolerance, self.angle_tolerance)

    def status(self, state: RobotBody) -> str:
        """CLOSED only while it holds a tool."""
        held = state.hand(self.name).holding
        tool = None if held is None else (self._tool_types[held], held)
        return messages.effector_status(
            state.time, self.wire_type, self.name, held is not None, tool
        )

    @cached_property
    def _tool_types(self) -> dict[str, str]:
        """Types of all tools on the wire, by name."""
        made = (create_effector(tool, self.robot) for tool in self.tools.values())
        return {tool.name: tool.wire_type for tool in made}
