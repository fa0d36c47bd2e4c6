"""A floor plan, robots with two wheels on it, and what their scanners see; all in numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_client import readings
from usarsim_client.decoder import decode

SIDE = 0.1
"""Of a cell of a plan, m; its first character is at x = y = 0, rows go along y (right)."""
FAR = 8.0
"""m that a scanner sees."""
STEP = 0.1
"""s between two reports."""


class Plan:
    """Walls where a text has `#`; each character is a square of `scale` cells."""

    def __init__(self, text: str, scale: int = 5) -> None:
        rows = [list(row) for row in text.split()]
        coarse = np.array([[one == "#" for one in row] for row in rows])
        self.walls: NDArray[np.bool_] = coarse.repeat(scale, 0).repeat(scale, 1)

    def wall(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether places are in a wall; everything outside is."""
        row, column = np.floor(y / SIDE).astype(int), np.floor(x / SIDE).astype(int)
        high, wide = self.walls.shape
        inside = (row >= 0) & (row < high) & (column >= 0) & (column < wide)
        found: NDArray[np.bool_] = ~inside
        found[inside] = self.walls[row[inside], column[inside]]
        return found


@dataclass
class Toy:
    """A robot on a plan; it stops at walls, 0.25 m from its middle."""

    plan: Plan
    x: float
    y: float
    yaw: float = 0.0
    time: float = 0.0
    speed: float = 0.6
    left: float = 0.0
    right: float = 0.0
    ahead: float = 0.0
    """m from its middle to its scanner."""

    def step(self) -> None:
        """Let 0.1 s pass."""
        ahead, turn = (self.left + self.right) / 2.0, (self.left - self.right) / 2.0
        self.yaw += 1.5 * turn * STEP
        x = self.x + self.speed * ahead * math.cos(self.yaw) * STEP
        y = self.y + self.speed * ahead * math.sin(self.yaw) * STEP
        around = np.linspace(0.0, math.tau, 16)
        if not self.plan.wall(x + 0.25 * np.cos(around), y + 0.25 * np.sin(around)).any():
            self.x, self.y = x, y
        self.time += STEP

    def scan_line(self) -> str:
        """What its scanner tells."""
        bearings = np.linspace(-math.pi / 2, math.pi / 2, 121)[::-1] + self.yaw
        steps = np.arange(0.05, FAR, 0.05)
        x = self.x + self.ahead * math.cos(self.yaw)
        y = self.y + self.ahead * math.sin(self.yaw)
        hit = self.plan.wall(
            x + steps[None, :] * np.cos(bearings)[:, None],
            y + steps[None, :] * np.sin(bearings)[:, None],
        )
        ranges = np.where(hit.any(1), steps[hit.argmax(1)], FAR)
        told = ",".join(f"{one:.3f}" for one in ranges)
        return (
            f"SEN {{Time {self.time:.2f}}} {{Type RangeScanner}} {{Name Scanner1}} "
            f"{{Resolution 0.0262}} {{FOV 3.1416}} {{Range {told}}}"
        )

    def pose_line(self) -> str:
        """What its ground truth sensor tells."""
        return (
            f"SEN {{Time {self.time:.2f}}} {{Type GroundTruth}} {{Name GT}} "
            f"{{Location {self.x:.4f},{self.y:.4f},0}} {{Orientation 0,0,{self.yaw:.4f}}}"
        )

    def scan(self) -> readings.LaserScan:
        """The same, decoded."""
        (found,) = decode(self.scan_line().encode())
        assert isinstance(found, readings.LaserScan)
        return found
