"""Hands: the gripper, whose fingers close on a thing (protocol reference 3.7, 4.8, 4.9), the vacuum
gripper, a suction cup, and the tool changer, which takes loose effectors (robots reference 1.10).
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import ClassVar

from usarsim_server.actuators.effector import Effector, create_effector, register_effector
from usarsim_server.fields import field
from usarsim_server.protocol.messages import effector_status, gripper_item, tool_changer_item
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.simulation.articulation import Grip, HandModel
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.simulation.snapshot import RobotBody

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
        return gripper_item(self.name)


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
        return gripper_item(self.name)


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
        return tool_changer_item(self.name, self.position_tolerance, self.angle_tolerance)

    def status(self, state: RobotBody) -> str:
        """CLOSED only while it holds a tool."""
        held = state.hand(self.name).holding
        tool = None if held is None else (self._tool_types[held], held)
        return effector_status(state.time, self.wire_type, self.name, held is not None, tool)

    @cached_property
    def _tool_types(self) -> dict[str, str]:
        """Types of all tools on the wire, by name."""
        made = (create_effector(tool, self.robot) for tool in self.tools.values())
        return {tool.name: tool.wire_type for tool in made}
