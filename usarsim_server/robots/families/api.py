"""What an author of a family of vehicles needs, in one place.

A family is one class with a few words about its vehicles and the controller that drives one of
them; `field` declares the keys of a table of its own in robot files:

    from usarsim_server.robots.families.api import *

    @register_family("twist")
    @dataclass(frozen=True)
    class Twist(WheeledFamily):
        section = "twist"
        brisk: bool = field(default=False, help="turns before it drives")

        def drive_controller(self, robot, body):
            return TwistController(robot, body)

`docs/families.md` has the whole example and the table of what a family may say.
"""

from dataclasses import dataclass

from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.protocol import messages
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import ActuatorDescription, RobotDescription, Wheel
from usarsim_server.robots.families.base import (
    DriveController,
    Family,
    MachineFamily,
    StatusFacts,
    balance_weight,
    register_family,
)
from usarsim_server.robots.families.wheeled import WheelController, WheeledFamily
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.motion_laws import Law, LawModel
from usarsim_server.simulation.simulation import BodyHandle

__all__ = [
    "ActuatorDescription",
    "BodyHandle",
    "Dialect",
    "Drive",
    "DriveController",
    "Family",
    "JointOrder",
    "Law",
    "LawModel",
    "MachineFamily",
    "Order",
    "RobotDescription",
    "StatusFacts",
    "Table",
    "Wheel",
    "WheelController",
    "WheeledFamily",
    "balance_weight",
    "dataclass",
    "field",
    "messages",
    "register_family",
]
