"""What a sensor is, which types there are, and how one is made from a table of a robot file.

A sensor type is one class in one file. It says which rays it needs, turns a robot's state and
the ray answers into a reading, and writes the reading's data segments. Its keys in robot files are
fields of the class. Everything around it (scheduling, heads, Time, batching, GEO) is done once, for
all sensors, elsewhere. A new file in this package is enough to add a type; outside packages use the
entry point group `usarsim_server.sensors` (see `usarsim_server.base.plugins`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from usarsim_server.base.fields import field
from usarsim_server.base.plugins import PluginTypes
from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Item, Segment
from usarsim_server.robots.description import ItemDescription, RobotDescription
from usarsim_server.robots.mounting import DeclaredItem, SetReply, SetResult
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.objects import ObjectFacts
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState, Snapshot
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.smoke import SmokeField
from usarsim_server.worlds.surroundings import Surroundings

Begun = tuple[Sequence[RayFan], Callable[[Sequence[RayHits]], Sequence["Sensor"]]]
"""Rays, and what takes readings of their answers; it returns the sensors that have measured."""

EVERYWHERE = frozenset(Dialect)
NOWHERE: frozenset[Dialect] = frozenset()


def _unknown(name: str, snapshot: Snapshot) -> ObjectFacts | None:
    """The look-up of a sensor that has no world around it."""
    return None


@dataclass(frozen=True, slots=True, eq=False)
class SensorContext:
    """What a sensor may know when it is made."""

    robot: RobotDescription  # the class it is mounted on
    world: WorldDescription  # the world it is in
    rng: np.random.Generator  # its own random stream; no other sensor draws from it
    objects: Callable[[str, Snapshot], ObjectFacts | None] = _unknown
    """Facts at an instant about the object that a name in `RayHits.names` belongs to, None if there
    is no such object; robots bear their labels."""
    surroundings: Surroundings | None = None
    """The live facts of the world; None: those of the world file, for this sensor alone."""
    smoke: SmokeField | None = None  # what light meets on its way; None in clear air

    @property
    def life(self) -> Surroundings:
        """The surroundings, whether they were given or not."""
        return self.surroundings or Surroundings(self.world)


class Sensor(DeclaredItem, ABC):
    """Base of all sensors; one instance belongs to one robot and is used by one thread.

    Attributes:
        name: item name of the robot file.
        link: link that carries the sensor, None for the chassis.
        mount: pose relative to the link or the reference point, simulation frame.
    """

    wire_type: ClassVar[str]
    """Type on the wire, canonical spelling."""
    aliases: ClassVar[tuple[str, ...]] = ()
    """Further spellings of the type, lower case, that requests may use."""
    nicknames: ClassVar[tuple[str, ...]] = ()
    """Item names, lower case, that clients use whatever the robot file calls the item."""
    timed: ClassVar[frozenset[Dialect]] = EVERYWHERE
    """Dialects in which its SEN lines carry Time (protocol reference 4.5)."""
    batched: ClassVar[frozenset[Dialect]] = NOWHERE
    """Dialects in which all instances of a robot share one line, one multi-pair segment each."""
    time_digits: ClassVar[Mapping[Dialect, int]] = {Dialect.UT2004: 4, Dialect.UDK: 4}
    """Digits of Time after the point (protocol reference 2.2)."""
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.1}
    """Default reporting interval in simulated seconds; 0 reports on SCAN only."""

    announces: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Keys of CONF and the fields whose values they tell, four digits."""
    announces_interval: ClassVar[bool] = False
    """ScanInterval is in CONF, before all others."""
    scans: ClassVar[bool] = False
    """SET SCAN asks for one report now."""

    own_interval: float | None = field(
        default=None, key="interval", low=0.0, unit="s", help="between reports; 0: on SCAN only"
    )
    era: Dialect | None = field(
        default=None, key="dialect", help="the only one whose clients know it; without: both"
    )

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        """Read the item.

        Raises:
            RobotDescriptionError: a key of the item has a value that cannot be used.
        """
        super().__init__(item)
        self.name = item.name
        self.link = item.link
        self.mount = item.pose

    @abstractmethod
    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Take one reading and keep it for `data`.

        Args:
            robot: the robot at this instant.
            hits: answers to the fans of `rays`, in order.

        Returns:
            False if there is nothing to report this time.
        """

    @abstractmethod
    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Data segments of the last reading, in wire order, without Time, Type and Name."""

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """Rays needed for the next reading; none by default."""
        return ()

    @classmethod
    def begin(cls, sensors: tuple[Self, ...], robot: RobotState) -> Begun:
        """Begin readings of sensors that stand one after the other on one robot, all of this class.

        One after the other by `rays` and `measure`; for a class of which robots carry many it may
        pay to do it at once.
        """
        if len(sensors) == 1:  # nearly always
            sensor = sensors[0]
            return sensor.rays(robot), lambda hits: sensors if sensor.measure(robot, hits) else ()
        wanted = [sensor.rays(robot) for sensor in sensors]

        def measure(hits: Sequence[RayHits]) -> list[Sensor]:
            measured: list[Sensor] = []
            begin = 0
            for sensor, rays in zip(sensors, wanted, strict=True):
                if sensor.measure(robot, hits[begin : begin + len(rays)]):
                    measured.append(sensor)
                begin += len(rays)
            return measured

        return [fan for rays in wanted for fan in rays], measure

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Segments of CONF after Name (protocol reference 4.8); by default what it announces."""
        interval = ("ScanInterval", fixed(self.interval(dialect), 4))
        told = [(key, fixed(getattr(self, name), 4)) for key, name in self.announces]
        return (interval, *told) if self.announces_interval else tuple(told)

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult | SetReply:
        """Obey a SET command; `opcode` is upper case. Unknown opcodes change nothing."""
        return SetResult.SCAN if self.scans and opcode == "SCAN" else SetResult.UNKNOWN

    def wire_name(self, dialect: Dialect) -> str:
        """Item name in a dialect; the name of the robot file by default."""
        return self.name

    def interval(self, dialect: Dialect) -> float:
        """Reporting interval in simulated seconds; 0 for clients of another era than its own."""
        if not self.known_in(dialect):
            return 0.0
        return self.intervals[dialect] if self.own_interval is None else self.own_interval

    def known_in(self, dialect: Dialect) -> bool:
        """Whether clients of a dialect know the sensor.

        A class of both generations had other items in each: AirRobot's sonars would end a client of
        the other one.
        """
        return self.era is None or self.era is dialect

    def item(self, dialect: Dialect) -> Item:
        """The last reading as an item of a SEN line."""
        return Item(self.wire_name(dialect), self.data(dialect))

    def carrier_pose(self, robot: RobotState) -> Pose:
        """Pose of what carries the sensor, in the world (simulation frame)."""
        return robot.pose if self.link is None else robot.link_pose(self.link)

    def world_pose(self, robot: RobotState) -> Pose:
        """Pose of the sensor in the world (simulation frame)."""
        return self.carrier_pose(robot) @ self.mount


GROUP = "usarsim_server.sensors"
"""Entry point group for sensor types of other packages."""

TYPES: PluginTypes[Sensor] = PluginTypes("sensor", Sensor, ("usarsim_server.sensors",), GROUP)

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
