"""The gripper: fingers that close on a thing (protocol reference 3.7, 4.8, 4.9)."""

from __future__ import annotations

from typing import ClassVar

from usarsim_server.actuators.effector import Effector
from usarsim_server.actuators.registry import register_effector
from usarsim_server.protocol.messages import gripper_item
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.simulation.articulation import Grip, HandModel
from usarsim_server.simulation.frames import Pose

__all__ = ["Gripper"]

DEFAULT_STRENGTH = 100.0
"""N: a starting value."""


@register_effector("Gripper", "GripperEffector")
class Gripper(Effector):
    """Fingers that close with all their force until each of them touches the same thing.

    Parameters: `strength` (N), the pull, beyond what the friction of the fingers bears, at which a
    held thing slips away.
    """

    wire_type: ClassVar[str] = "Gripper"

    def __init__(self, description: EffectorDescription, robot: RobotDescription) -> None:
        super().__init__(description, robot)
        self.strength = self.parameters.number("strength", DEFAULT_STRENGTH, above=0.0)
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
