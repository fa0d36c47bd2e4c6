"""Which wheels the wheel sensors look at."""

from __future__ import annotations

from usarsim_server.robots.description import RobotDescription

__all__ = ["front_wheel", "has_wheel_sensors"]


def has_wheel_sensors(robot: RobotDescription) -> bool:
    """Whether odometry and encoders work on this kind of robot; elsewhere they stay silent."""
    return robot.rolls


def front_wheel(robot: RobotDescription, side: str) -> int | None:
    """Index of the foremost driven wheel of a side (`left`, `right`); None if there is none.

    The index counts driven wheels in part order, as `RobotState.wheel_angles` does.
    """
    wheels = [(i, w) for i, w in enumerate(robot.driven_wheels) if w.side.lower() == side]
    if not wheels:
        return None
    return max(wheels, key=lambda entry: entry[1].position[0])[0]
