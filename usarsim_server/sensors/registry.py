"""Which sensor types exist, and how one of them is made from a line of a robot file.

A new file in this package is enough to add a type; outside packages use the entry point group
`usarsim_server.sensors` (see `usarsim_server.plugins`).
"""

from __future__ import annotations

import usarsim_server.sensors as package
from usarsim_server.plugins import PluginTypes
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext

__all__ = ["GROUP", "create_sensor", "register", "sensor_types"]

GROUP = "usarsim_server.sensors"
"""Entry point group for sensor types of other packages."""

TYPES: PluginTypes[Sensor] = PluginTypes("sensor", Sensor, (package,), GROUP)

register = TYPES.register
"""Class decorator: make a sensor available under these types of a robot file."""

sensor_types = TYPES.names
"""All types a robot file may name, sorted, aliases included."""


def create_sensor(item: ItemDescription, context: SensorContext) -> Sensor:
    """Make the sensor that a robot file asks for.

    Raises:
        RobotDescriptionError: the type is unknown, or a parameter is unknown or ill-typed.
    """
    cls = TYPES.find(item.type, item.where or f"sensor {item.name}")
    sensor = cls(item, context)
    sensor.parameters.finish()
    return sensor
