"""Bumpers: an arc of touch pads that report as one (robots reference 2.8)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.sensors.base import NOWHERE
from usarsim_server.sensors.fans import AHEAD
from usarsim_server.sensors.registry import register
from usarsim_server.sensors.touch import Touch, disc_probes
from usarsim_server.simulation.frames import pose_from_wire

__all__ = ["TouchArray"]

Array = NDArray[np.float64]

PADS = 20
"""Number of discs along the arc (BumperArray.uc of robocup-usarsim)."""


@register("TouchArray", "BumperArray")
class TouchArray(Touch):
    """True while something is within 2 cm outside an arc, anywhere along it.

    The arc lies in the sensor's x-y plane around its origin, symmetric to the x axis. Parameters:
    those of `Touch`, and `arc_radius` (m), `arc_angle` (rad), and `arc_roll`, `arc_pitch`,
    `arc_yaw` (rad), which turn the arc in the sensor's frame.
    """

    wire_type: ClassVar[str] = "TouchArray"
    batched: ClassVar[frozenset[Dialect]] = NOWHERE
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.1}
    default_probe_length: ClassVar[float] = 0.02

    def probes(self) -> tuple[Array, Array]:
        """The discs of all pads, each looking outward, from right to left."""
        read = self.parameters
        self.arc_radius = read.number("arc_radius", 0.17, above=0.0, maximum=10.0)
        self.arc_angle = read.number("arc_angle", 3.14, above=0.0, maximum=math.tau)
        self.arc_rotation = (
            read.number("arc_roll", 0.0),
            read.number("arc_pitch", 0.0),
            read.number("arc_yaw", 0.0),
        )
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
