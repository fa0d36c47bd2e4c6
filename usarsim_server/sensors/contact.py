"""Touch pads and bumpers: small discs probed by short rays, one or an arc of them that reports as
one (robots reference 2.8).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.protocol.numbers import boolean, fixed
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import NOWHERE, Sensor, SensorContext, register
from usarsim_server.sensors.ranges import AHEAD, fan_at
from usarsim_server.simulation.frames import pose_from_wire
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

Array = NDArray[np.float64]

PROBE_LENGTH = 0.003
"""m."""

PROBE_DEPTH = 0.01
"""m that probes start behind the pad: contacts give way a little, and a ray that starts inside an
object does not see its surface."""

RING_SPACING = 0.005
POINTS_PER_RING = 6


@register("Touch")
class Touch(Sensor):
    """True while something is within a few millimetres of the pad, which faces along x."""

    wire_type: ClassVar[str] = "Touch"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    batched: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UT2004})
    announces = (("Diameter", "diameter"),)

    diameter: float = field(default=0.01, above=0.0, high=1.0, unit="m", help="of the pad")
    probe_length: float = field(
        default=PROBE_LENGTH, above=0.0, high=1.0, unit="m", help="what is nearer counts as touched"
    )

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._starts, self._ways = self.probes()
        self.touched = False

    def probes(self) -> tuple[Array, Array]:
        """Start points (n, 3) and directions (n, 3) of the probes in the sensor's frame."""
        starts = disc_probes(self.diameter / 2)
        return starts, np.repeat(AHEAD, len(starts), axis=0)

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One short ray per probe."""
        length = PROBE_DEPTH + self.probe_length
        return (fan_at(self.world_pose(robot), self._ways, length, starts=self._starts),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep whether any probe hit."""
        self.touched = bool(np.isfinite(hits[0].distances).any())
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Touch, True or False."""
        return (("Touch", boolean(self.touched)),)


def disc_probes(radius: float) -> Array:
    """Starts (n, 3) of the probes of a disc across the x axis: centre and rings of six points."""
    rings = max(1, math.ceil(radius / RING_SPACING - 1e-9))
    radii = np.repeat(radius * np.arange(1, rings + 1) / rings, POINTS_PER_RING)
    angles = np.tile(math.tau * np.arange(POINTS_PER_RING) / POINTS_PER_RING, rings)
    behind = np.full(len(radii), -PROBE_DEPTH)
    around = np.column_stack((behind, radii * np.cos(angles), radii * np.sin(angles)))
    return np.vstack(([[-PROBE_DEPTH, 0.0, 0.0]], around))


PADS = 20
"""Number of discs along the arc (BumperArray.uc of robocup-usarsim)."""


@register("TouchArray", "BumperArray")
class TouchArray(Touch):
    """True while something is within 2 cm outside an arc, anywhere along it.

    The arc lies in the sensor's x-y plane around its origin, symmetric to the x axis.
    """

    wire_type: ClassVar[str] = "TouchArray"
    batched: ClassVar[frozenset[Dialect]] = NOWHERE
    probe_length = 0.02

    arc_radius: float = field(default=0.17, above=0.0, high=10.0, unit="m")
    arc_angle: float = field(default=3.14, above=0.0, high=math.tau, unit="rad", help="its width")
    arc_roll: float = field(default=0.0, unit="rad", help="turns the arc in the sensor's frame")
    arc_pitch: float = field(default=0.0, unit="rad", help="likewise")
    arc_yaw: float = field(default=0.0, unit="rad", help="likewise")

    def probes(self) -> tuple[Array, Array]:
        """The discs of all pads, each looking outward, from right to left."""
        self.arc_rotation = (self.arc_roll, self.arc_pitch, self.arc_yaw)
        arc = pose_from_wire((0.0, 0.0, 0.0), self.arc_rotation)
        disc = disc_probes(self.diameter / 2)
        starts, ways = [], []
        for yaw in np.linspace(self.arc_angle / 2, -self.arc_angle / 2, PADS).tolist():
            place = (self.arc_radius * math.cos(yaw), self.arc_radius * math.sin(yaw), 0.0)
            pad = arc @ pose_from_wire(place, (0.0, 0.0, yaw))
            turn = pad.matrix().T
            starts.append(disc @ turn + np.array(pad.position))
            ways.append(np.repeat(AHEAD @ turn, len(disc), axis=0))
        return np.concatenate(starts), np.concatenate(ways)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Diameter of a pad, and the arc (protocol reference 4.8)."""
        roll, pitch, yaw = (fixed(angle, 4) for angle in self.arc_rotation)
        return (
            *super().configuration(dialect),
            ("ArcRotation", f"Pitch {pitch} Roll {roll} Yaw {yaw}"),
            ("ArcRadius", fixed(self.arc_radius, 4)),
            ("ArcAngle", fixed(self.arc_angle, 4)),
        )
