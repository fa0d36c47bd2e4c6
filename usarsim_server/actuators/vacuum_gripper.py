"""The vacuum gripper: a suction cup (robots reference 1.10)."""

from __future__ import annotations

import math
from typing import ClassVar

from usarsim_server.actuators.effector import Effector
from usarsim_server.actuators.registry import register_effector
from usarsim_server.protocol.messages import gripper_item
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.simulation.articulation import Grip, HandModel
from usarsim_server.simulation.frames import Pose, Vector

__all__ = ["VacuumGripper"]


@register_effector("VacuumGripper", "Vacuum", "VacuumCup")
class VacuumGripper(Effector):
    """Holds the first thing in front of its tip, straight on from where it is mounted.

    While it is closed and empty it looks for something to hold again and again. On the wire it is
    a Gripper, as in the original.

    Parameters: `suction_length` (m), how far the suction reaches; `force` (N), the pull beyond
    which a thing comes off.
    """

    wire_type: ClassVar[str] = "Gripper"

    def __init__(self, description: EffectorDescription, robot: RobotDescription) -> None:
        super().__init__(description, robot)
        self.reach = self.parameters.number("suction_length", 0.125, above=0.0)
        self.force = self.parameters.number("force", 10.0, above=0.0)

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
