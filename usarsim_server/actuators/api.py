"""What an author of an effector (a hand, a tool) needs, in one place.

An effector is one class: its keys in robot files are fields, `hand` says how it takes hold, and
`configuration` what CONF tells of it:

    from usarsim_server.actuators.api import *

    @register_effector("Magnet")
    class Magnet(Effector):
        wire_type = "Gripper"
        force: float = field(default=50.0, above=0.0, unit="N", help="beyond it a thing comes off")

        def hand(self):
            tip = Pose(self.description.tip)
            return HandModel(
                name=self.name, grip=Grip.SUCTION, body=self.name, tip=tip, reach=0.02,
                strength=self.force,
            )

        def configuration(self):
            return gripper_item(self.name)
"""

from usarsim_server.actuators.effectors import (
    Effector,
    create_effector,
    effector_types,
    register_effector,
)
from usarsim_server.base.fields import field
from usarsim_server.protocol.messages import gripper_item, tool_changer_item
from usarsim_server.protocol.values import Item
from usarsim_server.robots.description import EffectorDescription, RobotDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.simulation.articulation import Grip, HandModel, JointOrder, Order
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.snapshot import RobotBody

__all__ = [
    "Effector",
    "EffectorDescription",
    "Grip",
    "HandModel",
    "Item",
    "JointOrder",
    "Order",
    "Pose",
    "RobotBody",
    "RobotDescription",
    "SetResult",
    "create_effector",
    "effector_types",
    "field",
    "gripper_item",
    "register_effector",
    "tool_changer_item",
]
