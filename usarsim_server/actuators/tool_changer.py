"""The tool changer: a coupling that takes loose effectors (robots reference 1.10)."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

from usarsim_server.actuators.effector import Effector, Machine
from usarsim_server.actuators.registry import create_effector, register_effector
from usarsim_server.protocol.messages import effector_status, tool_changer_item
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.sensors.base import SetResult
from usarsim_server.simulation.articulation import Grip, HandModel
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.snapshot import RobotBody

__all__ = ["ToolChanger"]


@register_effector("ToolChanger")
class ToolChanger(Effector):
    """CLOSE takes a detached effector of the same robot whose pose is near enough; OPEN drops it.

    Parameters: `position_tolerance` (m), `angle_tolerance` (rad); `tool`, name of a detached
    effector that it holds from the start.
    """

    wire_type: ClassVar[str] = "ToolChanger"

    def __init__(self, description: EffectorDescription, robot: RobotDescription) -> None:
        super().__init__(description, robot)
        read = self.parameters
        self.position_tolerance = read.number("position_tolerance", 0.5, minimum=0.0)
        self.angle_tolerance = read.number("angle_tolerance", 0.5, minimum=0.0)
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

    def set(self, opcode: str, params: str, machine: Machine) -> SetResult:
        """CLOSE and OPEN; a changer cannot GRIP."""
        return SetResult.UNKNOWN if opcode == "GRIP" else super().set(opcode, params, machine)

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
