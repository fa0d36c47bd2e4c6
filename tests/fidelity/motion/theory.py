"""What rigid wheels with Coulomb friction do (robots reference 3.2); the yardstick of the tests."""

from __future__ import annotations

import math

from usarsim_server.robots.description import RobotDescription

GRAVITY = 9.81
"""m/s^2, as in MuJoCo."""


def wheel_layout(robot: RobotDescription) -> tuple[float, float, float]:
    """Half wheel base, half track and half wheel width of a robot, m."""
    report = robot.report
    return report.wheel_base / 2, report.track_width / 2, robot.driven_wheels[0].width / 2


def turn_ratio_points(half_base: float, half_track: float) -> float:
    """Yaw rate of a turn in place, relative to a differential robot of the same track.

    For wheels that touch at one point each. It depends neither on friction nor on speed nor on
    mass: the moment of the saturated friction forces about the middle vanishes.
    """
    return half_track**2 / (half_base**2 + half_track**2)


def turn_ratio_edges(half_base: float, half_track: float, half_width: float) -> float:
    """The same for wheels that touch along both edges of their tread.

    The moment of all contacts, force against slip, must vanish; found by bisection.
    """
    low, high = 0.0, 1.0
    while high - low > 1e-9:
        ratio = (low + high) / 2
        if _driving_moment(ratio, half_base, half_track, half_width) > 0.0:
            low = ratio
        else:
            high = ratio
    return low


def _driving_moment(ratio: float, half_base: float, half_track: float, half_width: float) -> float:
    """Moment of the edges of one wheel about the robot's middle, for unit rim speed and load."""
    rate = ratio / half_track
    moment = 0.0
    for y in (half_track - half_width, half_track + half_width):
        ahead, aside = 1.0 - y * rate, half_base * rate
        moment += (y * ahead - half_base * aside) / math.hypot(ahead, aside)
    return moment


def sliding_distance(speed: float, friction: float) -> float:
    """Way (m) on which Coulomb friction stops a body of a speed (m/s)."""
    return speed**2 / (2.0 * friction * GRAVITY)


def slope_limit(friction: float) -> float:
    """Steepest slope (rad) on which all wheels together find enough grip."""
    return math.atan(friction)
