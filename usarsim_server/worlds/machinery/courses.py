"""Going from one place on a line to another: limited speed, limited acceleration."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True)
class Course:
    """The fastest way to a target at which one comes to rest, as a function of time.

    Up to three parts of constant acceleration, as textbooks have the trapezoidal profile. Whoever
    is too fast to stop in time overshoots and returns. Units are m or rad.
    """

    since: float  # simulated s of the beginning
    place: float  # then
    velocity: float
    target: float  # where it ends, at rest
    speed: float  # never exceeded, unless it is at the beginning
    acceleration: float  # > 0

    @property
    def end(self) -> float:
        """Simulated time (s) of arrival."""
        return self.since + sum(duration for duration, _ in self._parts)

    def at(self, time: float) -> tuple[float, float]:
        """Place and velocity at a simulated time (s)."""
        left = max(0.0, time - self.since)
        place, velocity = self.place, self.velocity
        for duration, acceleration in self._parts:
            span = min(left, duration)
            place += velocity * span + 0.5 * acceleration * span * span
            velocity += acceleration * span
            left -= span
            if left <= 0.0:
                return place, velocity
        return self.target, 0.0

    def redirected(self, time: float, target: float | None) -> Course:
        """The course from a moment on to another target; None: to where one can stop soonest."""
        place, velocity = self.at(time)
        if target is None:
            target = place + velocity * abs(velocity) / (2.0 * self.acceleration)
        return Course(time, place, velocity, target, self.speed, self.acceleration)

    @cached_property
    def _parts(self) -> tuple[tuple[float, float], ...]:
        """Durations (s) and accelerations."""
        most, start = self.acceleration, self.velocity
        braking = start * abs(start) / (2.0 * most)
        ahead = self.target - self.place - braking
        if abs(ahead) < 1e-12:
            return ((abs(start) / most, -math.copysign(most, start)),)
        sign = math.copysign(1.0, ahead)
        way, start = (self.target - self.place) * sign, start * sign
        limit = max(self.speed, start)
        peak = min(limit, math.sqrt(most * way + start * start / 2.0))
        spent = (2.0 * peak * peak - start * start) / (2.0 * most)
        cruise = max(0.0, way - spent) / peak
        return (
            ((peak - start) / most, sign * most),
            (cruise, 0.0),
            (peak / most, -sign * most),
        )
