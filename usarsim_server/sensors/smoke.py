"""How ranging by light fares in smoke; sound does not mind it.

Particles of local smoke stop every beam: it reads the distance to the particle. What regional and
global smoke do is a choice, parameter `smoke` of the sensor:

* `ignore`: nothing. The SICK saw through the smoke of the original (robots reference 2.3).
* `budget`: a beam may use up `smoke_budget` of density times metres; beyond that there is no echo
  strong enough and it reads 0.0. The Hokuyo of the original had a budget of 0.00575, found by
  experiment: Formsma, Dijkshoorn, van Noort and Visser, Realistic Simulation of Laser Range Finder
  Behavior in a Smoky Environment, RoboCup 2010, LNAI 6556.
* `scatter`: light that meets a droplet comes back from there. The optical depth at which a photon
  is scattered has the exponential distribution (Beer and Lambert), so a beam reaches its target
  through the optical depth D with the probability exp(-D), and otherwise reads the distance at
  which the depth drawn for it is reached: mostly near the front of dense smoke, anywhere in thin
  smoke. Here the density is the extinction coefficient in 1/m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_server.sensors.base import SensorContext
from usarsim_server.simulation.rays.query import RayFan

Array = NDArray[np.float64]

MODELS = ("ignore", "budget", "scatter")
HOKUYO_BUDGET = 0.00575
"""Density times metres (robots reference 2.3)."""
BLIND = 0.0
"""m: what a beam reads whose budget is used up."""


class SmokeSight:
    """The smoke in the way of one sensor's beams."""

    def __init__(self, context: SensorContext, model: str, budget: float) -> None:
        """Take the parameters `smoke` (one of `MODELS`) and `smoke_budget` of a sensor.

        The random stream of the context is used by `scatter`.
        """
        self._model = model
        self._budget = budget
        self._field = context.smoke
        self._rng = context.rng
        self._fan: RayFan | None = None
        self._time = 0.0
        self._blind: NDArray[np.bool_] | None = None

    def send(self, fan: RayFan, time: float) -> RayFan:
        """Remember the beams of the next reading and their time (s); returns them as they are."""
        self._fan, self._time = fan, time
        return fan

    def receive(self, distances: Array) -> Array:
        """Distances (n,) that the beams sent last measure, given those without smoke.

        Args:
            distances: to the geometry, inf for a miss, m.
        """
        if self._field is None or self._fan is None:
            return distances
        origin, directions = self._fan.origin, self._fan.directions
        seen = np.minimum(distances, self._field.blocked_at(origin, directions, self._time))
        lengths = np.minimum(seen, self._fan.max_range)
        if self._model == "budget":
            depth = self._field.optical_depth(origin, directions, lengths)
            self._blind = depth > self._budget
        elif self._model == "scatter":
            drawn = self._rng.exponential(size=len(lengths))
            seen = np.minimum(seen, self._field.distance_at(origin, directions, lengths, drawn))
        return seen

    def blank(self, ranges: Array) -> Array:
        """The ranges (n,) of a reading, with `BLIND` for the beams that nothing comes back from."""
        return ranges if self._blind is None else np.where(self._blind, BLIND, ranges)
