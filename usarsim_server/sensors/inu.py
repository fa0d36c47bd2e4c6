"""Inertial navigation unit, the forerunner of the INS (protocol reference 4.6)."""

from __future__ import annotations

from typing import ClassVar

from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.sensors.base import SetResult
from usarsim_server.sensors.ins import InertialNavigation
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["InertialUnit"]


@register("INU")
class InertialUnit(InertialNavigation):
    """The orientation of an INS, with the same drift; no location, nothing to set.

    Early UT2004 servers had it, later ones the INS (robots reference 2.5).
    """

    wire_type: ClassVar[str] = "INU"

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Orientation, two digits, angles in [0, 2 pi)."""
        _, orientation = super().data(dialect)
        return (orientation,)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Nothing but the name."""
        return ()

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """It has no estimate of a pose to set."""
        return SetResult.UNKNOWN
