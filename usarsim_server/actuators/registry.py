"""Which effector types exist, and how one of them is made from a table of a robot file.

A new file in this package is enough to add a type; outside packages use the entry point group
`usarsim_server.effectors` (see `usarsim_server.plugins`).
"""

from __future__ import annotations

import usarsim_server.actuators as package
from usarsim_server.actuators.effector import Effector
from usarsim_server.plugins import PluginTypes
from usarsim_server.robots.description import EffectorDescription, RobotDescription

__all__ = ["GROUP", "create_effector", "create_effectors", "effector_types", "register_effector"]

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
