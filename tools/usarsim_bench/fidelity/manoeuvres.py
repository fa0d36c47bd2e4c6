"""Manoeuvres on level ground and what is measured in them (robots reference 3.3, V1 to V13, V27).

Every function takes a stage with a fresh robot, drives it by DRIVE commands and returns numbers.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from usarsim_bench.fidelity.stage import Stage, turned, yaw_of
from usarsim_server.simulation.snapshot import RobotBody

SPIN_UP = 2.0
"""s until a robot is taken to be in steady motion."""
_ODOMETRY = re.compile(r"\{Type Odometry\}.*\{Pose [^,]+,[^,]+,([^,}]+)\}")


@dataclass(frozen=True, slots=True)
class Straight:
    """A straight drive.

    Attributes:
        speed: mean ground speed in steady motion, m/s.
        ratio: speed relative to that of the commanded wheel speed times the wheel radius.
        lateral: largest distance from the line of the start, m.
        yaw: largest deviation from the heading of the start, rad.
    """

    speed: float
    ratio: float
    lateral: float
    yaw: float


def drive_straight(stage: Stage, speed: float, seconds: float = 6.0) -> Straight:
    """Drive with both sides at a wheel speed (rad/s); ground speed is taken after 3 s."""
    start = stage.settle()
    stage.drive(speed, speed)
    return watch_straight(stage, start, speed, seconds)


def watch_straight(stage: Stage, start: RobotBody, speed: float, seconds: float) -> Straight:
    """Measure a straight drive that has just been commanded."""
    began = stage.state
    lateral = yaw = 0.0
    steady = began
    for state in stage.steps(seconds):
        lateral = max(lateral, abs(start.pose.inverse().rotate(_way(start, state))[1]))
        yaw = max(yaw, abs(turned(yaw_of(start), yaw_of(state))))
        if state.time <= began.time + 3.0 + stage.timestep / 2:
            steady = state
    end = stage.state
    ground = math.hypot(*_way(steady, end)[:2]) / (end.time - steady.time)
    radius = stage.robot.report.wheel_radius
    return Straight(ground, ground / (abs(speed) * radius) if speed else math.nan, lateral, yaw)


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn in place.

    Attributes:
        rate: mean yaw rate, rad/s, anticlockwise.
        ratio: rate relative to a differential robot that does what was commanded.
        grip: rate relative to a differential robot whose wheels turn as fast as these did.
        track: effective track, m: that of the differential robot that would turn like this.
        hop: peak to peak of the body's height, m.
        contact: share of the steps in which every driven wheel touched the ground.
        drift: largest distance of the reference point from where the turn was steady first, m.
        own: whether two parts of the robot ever touched each other.
        odometry: rate of the odometry's heading relative to the true one; NaN without odometry.
    """

    rate: float
    ratio: float
    grip: float
    track: float
    hop: float
    contact: float
    drift: float
    own: bool
    odometry: float


def turn_in_place(stage: Stage, speed: float, seconds: float = 10.0) -> Turn:
    """Turn anticlockwise with the sides at -speed and +speed (rad/s)."""
    stage.settle()
    stage.drive(-speed, speed)
    stage.run(SPIN_UP)
    stage.client.take()
    begin = stage.state
    probe = stage.probe()
    odometry = _OdometryWatch(stage)
    angle = drift = 0.0
    heights = [begin.pose.position[2]]
    full_contact = own = 0
    last = yaw_of(begin)
    for state in stage.steps(seconds):
        yaw = yaw_of(state)
        angle += turned(last, yaw)
        last = yaw
        heights.append(state.pose.position[2])
        drift = max(drift, math.hypot(*_way(begin, state)[:2]))
        contacts = probe.look(state.snapshot)
        full_contact += contacts.wheels == len(stage.robot.driven_wheels)
        own += contacts.own
        odometry.note(angle)
    spin = _mean_spin(begin, stage.state)
    rate = angle / seconds
    report = stage.robot.report
    ideal = speed * report.wheel_radius * 2 / report.track_width
    return Turn(
        rate=rate,
        ratio=rate / ideal,
        grip=rate / ideal * speed / spin,
        track=report.track_width * ideal / rate,
        hop=max(heights) - min(heights),
        contact=full_contact / round(seconds / stage.timestep),
        drift=drift,
        own=own > 0,
        odometry=odometry.ratio,
    )


@dataclass(frozen=True, slots=True)
class Arc:
    """A curve: yaw rate (rad/s) and its ratio to that of a differential robot."""

    rate: float
    ratio: float


def drive_arc(stage: Stage, left: float, right: float, seconds: float = 5.0) -> Arc:
    """Drive a curve with given wheel speeds (rad/s)."""
    stage.settle()
    stage.drive(left, right)
    stage.run(SPIN_UP)
    angle, last = 0.0, yaw_of(stage.state)
    for state in stage.steps(seconds):
        angle += turned(last, yaw_of(state))
        last = yaw_of(state)
    report = stage.robot.report
    ideal = (right - left) * report.wheel_radius / report.track_width
    return Arc(angle / seconds, angle / seconds / ideal)


def stop(stage: Stage, speed: float) -> float:
    """Way (m) from the command to stop until rest, from a ground speed (m/s)."""
    stage.settle()
    spin = speed / stage.robot.report.wheel_radius
    stage.drive(spin, spin)
    stage.run(SPIN_UP)
    stage.drive(0.0, 0.0)
    begin = stage.state
    stage.run(SPIN_UP)
    return math.hypot(*_way(begin, stage.state)[:2])


@dataclass(frozen=True, slots=True)
class Rest:
    """A robot left alone: largest movement (m), largest rotation (rad), deepest overlap (m)."""

    moved: float
    rotated: float
    depth: float


def rest(stage: Stage, seconds: float) -> Rest:
    """Leave the robot alone after it came to rest; it never gets a command."""
    begin = stage.settle()
    probe = stage.probe()
    moved = rotated = depth = 0.0
    inverse = begin.pose.inverse()
    for _ in range(math.ceil(seconds / REST_LOOK)):
        stage.run(REST_LOOK)
        state = stage.state
        moved = max(moved, math.dist(begin.pose.position, state.pose.position))
        w = min(1.0, abs((inverse @ state.pose).quaternion[0]))
        rotated = max(rotated, 2 * math.acos(w))
        depth = max(depth, probe.look(state.snapshot).depth)
    return Rest(moved, rotated, depth)


REST_LOOK = 0.1
"""s between two looks at a resting robot."""


class _OdometryWatch:
    """Compares the heading of odometry lines with the true one at the steps they come at."""

    def __init__(self, stage: Stage) -> None:
        self._lines = stage.client.lines
        self._seen = len(self._lines)
        self._pairs: list[tuple[float, float]] = []

    def note(self, angle: float) -> None:
        """Look at lines that came with the last step; angle is the true heading then."""
        for line in self._lines[self._seen :]:
            found = _ODOMETRY.search(line)
            if found:
                self._pairs.append((angle, -float(found[1])))
        self._seen = len(self._lines)

    @property
    def ratio(self) -> float:
        """Odometry's turning relative to the true turning, over all lines; NaN without lines."""
        if len(self._pairs) < 2:
            return math.nan
        (angle, theta), (last_angle, last_theta) = self._pairs[0], self._pairs[-1]
        return (last_theta - theta) / (last_angle - angle)


def _way(before: RobotBody, after: RobotBody) -> tuple[float, float, float]:
    (x, y, z), (u, v, w) = before.pose.position, after.pose.position
    return u - x, v - y, w - z


def _mean_spin(before: RobotBody, after: RobotBody) -> float:
    """Mean of the absolute wheel speeds between two looks, rad/s."""
    spins = (after.wheel_angles - before.wheel_angles) / (after.time - before.time)
    return float(np.abs(spins).mean())
