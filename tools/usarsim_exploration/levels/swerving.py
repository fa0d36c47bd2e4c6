"""Of the speeds near those that a robot wants, the ones with which it touches nothing.

A robot sweeps what its rectangle passes over within half a second. Speeds that lead too near to
something, or still nearer where it is too near already, are not driven: slower ones are, or a
curve beside, or, where it cannot turn, a little way to where it can (D. Fox, W. Burgard,
S. Thrun, The dynamic window approach to collision avoidance, 1997, with a rectangle).
"""

from __future__ import annotations

import math

import numpy as np

from usarsim_exploration.localisation.surfaces import Floats
from usarsim_exploration.measures.contacts import HALF

REACH = 0.85
"""m around the middle of a robot within which something can be in the way."""
_AHEAD = np.array([0.15, 0.3, 0.5])
"""s for which it is looked ahead."""
_LAG = 0.2
"""s after which wheels have come two thirds of the way to a new speed."""
_MARGIN = 0.04
"""m from the bumpers that are kept free, where they are."""
_WORSE = 0.001
"""m by which a robot that is too near may get nearer still."""
_PATIENCE, _FIRST = 3.0, 2.0
"""s, less for robots of low numbers, after which one that cannot do what it wants squeezes
through, and after twice of which it takes what comes; and how much less, by the number."""
_SQUEEZED, _GENTLE = 0.015, 0.7
"""m that are kept free by one that squeezes, and rad/s at most of one that may touch something."""
_TURNS = np.array([0.4, -0.4, 0.8, -0.8, 1.5, -1.5])
"""rad/s beside a curve that is not free, to be tried instead."""
_ASIDE = np.array([[s, t] for s in (0.15, -0.15) for t in (0.0, 0.3, -0.3, 0.7, -0.7)])
"""m/s and rad/s with which a robot gets to where it can turn."""
_GAIN = 0.002
"""m by which it has to get away from things by that."""


class Swerve:
    """Of one robot: it knows how fast it is."""

    def __init__(self, number: int, period: float) -> None:
        """It stands. number: of the robot, low ones wait less. period: s between two calls."""
        self._now = np.zeros(2)
        self._forces = False
        self._held, self._patience = 0.0, _PATIENCE - _FIRST / (1.0 + number)
        self._period = period
        self._gain = 1.0 - math.exp(-period / _LAG)

    def swerve(self, speed: float, turn: float, around: Floats) -> tuple[float, float]:
        """The speeds to drive with instead, m/s and rad/s to the right.

        Args:
            speed, turn: that the robot wants. around: (n, 2) where things are within `REACH`, m
                ahead of its middle and to the right.
        """
        if len(around) and (speed or turn):
            kept = _MARGIN if self._held < self._patience else _SQUEEZED
            found = self._choose(np.array([[speed, turn]]), around, kept)
            free = found == (speed, turn)
            self._forces = self._held >= self._patience * (1.0 if self._forces else 2.0)
            if self._forces:
                slower = min(1.0, _GENTLE / max(abs(turn), 1e-9))
                found, free = (slower * speed, slower * turn), True
            self._held = max(self._held + (-self._period if free else self._period), 0.0)
            speed, turn = found
        self._now += self._gain * (np.array([speed, turn]) - self._now)
        return speed, turn

    def _choose(self, wanted: Floats, around: Floats, kept: float) -> tuple[float, float]:
        now = float(_clear(around, np.zeros((1, 3)))[0]) - _WORSE
        least = min(kept, now)
        if self._margin(around, wanted)[0] >= least:
            return float(wanted[0, 0]), float(wanted[0, 1])
        if wanted[0, 0]:
            beside = wanted + np.column_stack([np.zeros(len(_TURNS)), _TURNS])
            tried = np.vstack([0.5 * wanted, beside, 0.5 * beside, wanted * (0.0, 1.0)])
        else:
            tried = 0.5 * wanted
        free = self._margin(around, tried) >= least
        if free.any():
            found = tried[np.argmax(free)]
            return float(found[0]), float(found[1])
        ends = self._poses(_ASIDE)[-1]
        away = np.hypot(*(around[None] - ends[:, None, :2]).transpose(2, 0, 1)).min(axis=1)
        gain = away - np.hypot(*around.T).min()
        gain[self._margin(around, _ASIDE) < min(_SQUEEZED, now)] = -math.inf
        best = int(np.argmax(gain))
        if gain[best] < _GAIN:
            return 0.0, 0.0
        return float(_ASIDE[best, 0]), float(_ASIDE[best, 1])

    def _poses(self, speeds: Floats) -> Floats:
        """(times, n, 3) where speeds (n, 2) lead."""
        slow = _LAG * (1.0 - np.exp(-_AHEAD / _LAG))
        ways, turns = (_AHEAD[:, None, None] * speeds + slow[:, None, None]
                       * (self._now - speeds)).transpose(2, 0, 1)  # fmt: skip
        return np.stack([ways * np.cos(turns / 2), ways * np.sin(turns / 2), turns], axis=2)

    def _margin(self, around: Floats, speeds: Floats) -> Floats:
        """(n,) m that stay free around a robot that drives so."""
        poses = self._poses(speeds)
        found: Floats = _clear(around, poses.reshape(-1, 3)).reshape(poses.shape[:2]).min(axis=0)
        return found


def _clear(around: Floats, poses: Floats) -> Floats:
    """(n,) m from the bumpers of a robot at poses (n, 3) to what is nearest."""
    cosines, sines = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x, y = around[:, 0] - poses[:, :1], around[:, 1] - poses[:, 1:2]
    ahead = np.abs(cosines * x + sines * y) - HALF[0]
    across = np.abs(cosines * y - sines * x) - HALF[1]
    found: Floats = np.maximum(ahead, across).min(axis=1)
    return found
