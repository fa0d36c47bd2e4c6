"""What an author of a sensor needs, in one place.

A sensor is one class: its keys in robot files are fields, `measure` keeps a reading, `data` writes
it down. Subclass `Sensor`, or for distances `Ranging`, `SingleRange`, or `LightRanging`, whose
beams smoke can stop:

    from usarsim_server.sensors.api import *

    @register("Thermometer")
    class Thermometer(Sensor):
        wire_type = "Thermometer"
        celsius: float = field(default=21.0, low=-90.0, unit="C", help="at height 0")

        def measure(self, robot, hits):
            self.reading = self.celsius - 0.0065 * self.world_pose(robot).position[2]
            return True

        def data(self, dialect):
            return (("Celsius", fixed(self.reading, 1)),)

`docs/sensors.md` has the rules.
"""

from usarsim_server.base.fields import field
from usarsim_server.protocol.numbers import boolean, fixed, ranges, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.robots.mounting import SetReply, SetResult
from usarsim_server.sensors.base import (
    EVERYWHERE,
    NOWHERE,
    Sensor,
    SensorContext,
    create_sensor,
    register,
)
from usarsim_server.sensors.ranges import (
    LightRanging,
    Ranging,
    SingleRange,
    cone_directions,
    fan_at,
    wire_directions,
)
from usarsim_server.sensors.smoke import SmokeSight
from usarsim_server.simulation.frames import flip_point, wire_from_pose
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = [
    "EVERYWHERE",
    "NOWHERE",
    "Dialect",
    "ItemDescription",
    "LightRanging",
    "Ranging",
    "RayFan",
    "RayHits",
    "RobotState",
    "Segment",
    "Sensor",
    "SensorContext",
    "SetReply",
    "SetResult",
    "SingleRange",
    "SmokeSight",
    "boolean",
    "cone_directions",
    "create_sensor",
    "fan_at",
    "field",
    "fixed",
    "flip_point",
    "ranges",
    "register",
    "vector",
    "wire_directions",
    "wire_from_pose",
]
