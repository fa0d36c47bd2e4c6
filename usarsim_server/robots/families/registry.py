"""Which families of vehicles exist.

A new file in this package is enough to add one; outside packages use the entry point group
`usarsim_server.families` (see `usarsim_server.plugins`).
"""

from __future__ import annotations

from functools import cache

import usarsim_server.robots.families as package
from usarsim_server.plugins import PluginTypes
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import Family

__all__ = ["GROUP", "TYPES", "families", "family_of", "find_family", "register_family"]

GROUP = "usarsim_server.families"
"""Entry point group for families of other packages."""

TYPES: PluginTypes[Family] = PluginTypes("vehicle", Family, (package,), GROUP)

register_family = TYPES.register
"""Class decorator: make a family available under these kinds of a robot file."""

families = TYPES.names
"""All kinds a robot file may name, sorted."""


@cache
def find_family(kind: str, place: str = "") -> Family:
    """The family of a kind.

    Args:
        kind: as robot files write it.
        place: where it stands, for the error.

    Raises:
        RobotDescriptionError: if there is none.
    """
    return TYPES.find(kind, place)()


def family_of(robot: RobotDescription) -> Family:
    """The family of a robot class."""
    return find_family(robot.kind)
