"""Turning by an angle and driving a distance, closed over what the robot reports of itself.

Each report gives the way still to go; the power is what should cover it at a rate proportional to
it. How fast a robot is at full power is learned on the way, since a server tells only how fast its
wheels can turn. A robot that stands close enough is done.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from usarsim_server.protocol.values import Vector

_RATE = 1.2  # 1/s: share of the way still to go that a second covers
_LEAST = 0.015  # of full power: less moves no wheel
_LEARN = 0.3  # of a new measurement
_REST = 0.25  # simulated s of hardly any motion that count as standing
_PATIENCE = 20.0  # simulated s beyond what the move should take


@dataclass(frozen=True, slots=True)
class Powers:
    """What wheels get, -1 to 1. done, failed: the move is over; a text says why it failed."""

    left: float = 0.0
    right: float = 0.0
    done: bool = False
    failed: str = ""


class _Move:
    """What both moves share: goal, learned speed, end."""

    def __init__(self, goal: float, speed: float, tolerance: float, full: float) -> None:
        self._goal, self._speed, self._full = goal, speed, full
        self._close, self._still = tolerance * 0.5, tolerance * 0.2
        self._gone, self._power = 0.0, 0.0
        self._time = math.nan
        self._begun = math.nan
        self._resting = math.nan

    @property
    def gone(self) -> float:
        """How far it has come, m or rad."""
        return self._gone

    def _advance(self, step: float, time: float) -> tuple[float, str]:
        """Take a step of the way at a simulated time; the next power, and why it is over.

        The reason is `done`, empty, or what went wrong.
        """
        if math.isnan(self._time):
            self._time = self._begun = time
            return self._next(), ""
        passed = time - self._time
        if passed <= 0.0:
            return self._power, ""
        self._gone += step
        self._time = time
        if abs(self._power) > _LEAST and step * self._power > 0.0:
            measured = step / passed / self._power
            learned = self._full + _LEARN * (measured - self._full)
            self._full = max(learned, 0.02)
        rest = self._goal - self._gone
        if abs(step) > self._still:
            self._resting = math.nan
        elif math.isnan(self._resting):
            self._resting = time
        if abs(rest) <= self._close and time - self._resting >= _REST:
            return 0.0, "done"
        if time - self._begun > _PATIENCE + abs(self._goal) / (self._full * self._speed):
            return 0.0, f"it does not come there: {abs(rest):.3f} still to go"
        return self._next(), ""

    def _next(self) -> float:
        rest = self._goal - self._gone
        if abs(rest) <= self._close:
            self._power = 0.0
        else:
            size = min(max(abs(rest) * _RATE / self._full, _LEAST), self._speed)
            self._power = math.copysign(size, rest)
        return self._power


class Travel(_Move):
    """Drive a distance, forward positive; ends within 2 cm."""

    def __init__(self, metres: float, speed: float, full: float = 1.0) -> None:
        """Begin.

        Args:
            metres: how far. speed: greatest power, 0 to 1.
            full: first guess of m/s at full power.
        """
        super().__init__(metres, speed, 0.02, full)
        self._last: tuple[float, float] | None = None

    def report(self, place: Vector, yaw: float, time: float) -> Powers:
        """Take a pose (m, rad, simulated s); what the wheels get now."""
        x, y, _ = place
        step = 0.0
        if self._last is not None:
            dx, dy = x - self._last[0], y - self._last[1]
            step = math.copysign(math.hypot(dx, dy), dx * math.cos(yaw) + dy * math.sin(yaw))
        self._last = x, y
        power, end = self._advance(step, time)
        return _powers(power, power, end)


class Rotate(_Move):
    """Turn on the spot, clockwise positive; ends within 1 degree."""

    def __init__(self, degrees: float, speed: float, full: float = 2.0) -> None:
        """Begin.

        Args:
            degrees: how far. speed: greatest power, 0 to 1.
            full: first guess of rad/s at full power.
        """
        super().__init__(math.radians(degrees), speed, math.radians(1.0), full)
        self._last: float | None = None

    def report(self, place: Vector, yaw: float, time: float) -> Powers:
        """As `Travel.report`."""
        step = 0.0 if self._last is None else math.remainder(yaw - self._last, math.tau)
        self._last = yaw
        power, end = self._advance(step, time)
        return _powers(power, -power, end)


def _powers(left: float, right: float, end: str) -> Powers:
    return Powers(left, right, end == "done", "" if end == "done" else end)
