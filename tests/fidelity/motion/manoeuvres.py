"""Manoeuvres on level ground, in air and water, and what is measured in them.

Robots reference 3.3, V1 to V13 and V23 to V27.

Every function takes a stage with a fresh robot, drives it by DRIVE commands and returns numbers.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from motion.stage import Stage, turned, yaw_of
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.steered import SteeredFamily
from usarsim_server.simulation.frames import Pose, rpy_from_quaternion
from usarsim_server.simulation.snapshot import RobotBody

SPIN_UP = 2.0
"""s until a robot is taken to be in steady motion."""
_ODOMETRY = re.compile(r"\{Type Odometry\}.*\{Pose [^,]+,[^,]+,([^,}]+)\}")


@dataclass(frozen=True, slots=True)
class Straight:
    """A straight drive."""

    speed: float  # mean ground speed in steady motion, m/s
    ratio: float  # speed relative to that of the commanded wheel speed times the wheel radius
    lateral: float  # largest distance from the line of the start, m
    yaw: float  # largest deviation from the heading of the start, rad


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
        if state.time <= began.time + 3.0 + stage.glance / 2:
            steady = state
    end = stage.state
    ground = math.hypot(*_way(steady, end)[:2]) / (end.time - steady.time)
    radius = stage.robot.report.wheel_radius
    return Straight(ground, ground / (abs(speed) * radius) if speed else math.nan, lateral, yaw)


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn in place."""

    rate: float  # mean yaw rate, rad/s, anticlockwise
    ratio: float  # rate relative to a differential robot that does what was commanded
    grip: float  # rate relative to a differential robot whose wheels turn as fast as these did
    track: float  # effective track, m: that of the differential robot that would turn like this
    hop: float  # peak to peak of the body's height, m
    contact: float  # share of the steps in which every driven wheel touched the ground
    drift: float  # largest distance of the reference point from where the turn was steady first, m
    own: bool  # whether two parts of the robot ever touched each other
    odometry: float  # rate of the odometry's heading relative to the true one; NaN without odometry

    @property
    def exaggeration(self) -> float:
        """By what odometry exaggerates the turn, times the grip: 1 if it goes by the wheels."""
        return self.odometry * self.grip


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
        contact=full_contact / round(seconds / stage.glance),
        drift=drift,
        own=own > 0,
        odometry=odometry.ratio,
    )


def about_axle(stage: Stage) -> tuple[float, float]:
    """Turn a robot with casters once about its driven axle.

    Returns:
        Largest way of the axle's middle from its place (m), and the angle turned (rad).
    """
    report = stage.robot.report
    spin = stage.capped(3.0)
    period = math.tau * report.track_width / (2.0 * spin * report.wheel_radius)
    axle = Pose((stage.robot.driven_wheels[0].position[0], 0.0, 0.0))
    stage.settle()
    stage.drive(-spin, spin)
    stage.run(1.0)
    last = stage.state
    middle = (last.pose @ axle).position
    angle = drift = 0.0
    for _ in range(20):
        stage.run(period / 20.0)
        state = stage.state
        angle += turned(yaw_of(last), yaw_of(state))
        drift = max(drift, math.dist((state.pose @ axle).position, middle))
        last = state
    return drift, angle


@dataclass(frozen=True, slots=True)
class Arc:
    """A curve: yaw rate (rad/s) and its ratio to that of a differential robot."""

    rate: float
    ratio: float


def arc(stage: Stage, left: float, right: float, seconds: float = 5.0) -> Arc:
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


def stop(stage: Stage, speed: float = 0.33) -> tuple[float, float]:
    """Way (m) from the command to stop, from a ground speed (m/s), and the speed after it."""
    stage.settle()
    spin = speed / stage.robot.report.wheel_radius
    stage.drive(spin, spin)
    stage.run(SPIN_UP)
    stage.drive(0.0, 0.0)
    begin = stage.state
    stage.run(SPIN_UP)
    end = stage.state
    return math.hypot(*_way(begin, end)[:2]), abs(end.linear_velocity[0])


@dataclass(frozen=True, slots=True)
class Rest:
    """A robot left alone: largest movement (m), largest rotation (rad), deepest overlap (m)."""

    moved: float
    rotated: float
    depth: float


def rest(stage: Stage, seconds: float = 60.0) -> Rest:
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


# -- cars ------------------------------------------------------------------------------------------

STEER = 0.3
"""rad (robots reference 3.3 V25)."""
GROUND_SPEED = 1.0
"""m/s at most; tyres slip little at that speed."""
WALKED = 4.0
"""s that a circle is watched."""


@dataclass(frozen=True, slots=True)
class Circle:
    """A drive on a circle."""

    radius: float  # of the circle on which the middle of the axle that is not steered goes, m
    ratio: float  # of the radius to that of wheel base and steering angle
    clockwise: bool  # seen from above
    own: bool  # whether two parts of the robot ever touched each other


def steered(robot: RobotDescription) -> SteeredFamily:
    """What steers a car."""
    assert isinstance(robot.family, SteeredFamily)
    return robot.family


def ideal_radius(robot: RobotDescription, steer: float) -> float:
    """Wheel base over the tangent of the steering angle, m (robots reference 3.3 V25)."""
    places = [wheel.x for wheel in steered(robot).wheels]
    return (max(places) - min(places)) / math.tan(abs(steer))


def circle(stage: Stage, steer: float = STEER, seconds: float = WALKED) -> Circle:
    """Drive ahead with the wheels turned by an angle (rad, positive to the right)."""
    robot = stage.robot
    wheels = steered(robot).wheels
    front = any(wheel.joint and wheel.front for wheel in wheels)
    fixed = [wheel.x for wheel in wheels if wheel.joint is None]
    stage.settle()
    spin = min(GROUND_SPEED / wheels[0].radius, robot.drive.max_wheel_speed / 2.0)
    command = f"{{FrontSteer {steer if front else 0.0}}} {{RearSteer {0.0 if front else steer}}}"
    stage.client.send(f"DRIVE {{Speed 0}} {command}")
    stage.run(1.0)
    stage.client.send(f"DRIVE {{Speed {spin:.9g}}} {command}")
    stage.run(1.0)
    probe, axle = stage.probe(), Pose((sum(fixed) / len(fixed), 0.0, 0.0))
    way = angle = 0.0
    own = False
    last = stage.state
    # Every twentieth step is enough for the length of a circle: the chord is as long as the arc.
    for number, state in enumerate(stage.steps(seconds)):
        if number % (20 // stage.every):
            continue
        before, after = ((one.pose @ axle).position for one in (last, state))
        way += math.dist(before, after)
        angle += turned(yaw_of(last), yaw_of(state))
        own |= probe.look(state.snapshot).own
        last = state
    radius = way / abs(angle) if angle else math.inf
    return Circle(radius, radius / ideal_radius(robot, steer), angle < 0.0, own)


# -- aircraft and submarines -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight straight ahead, then a turn on the spot.

    Attributes:
        speed: m/s. rate: rad/s, clockwise.
        rise: largest change of height while turning, m.
    """

    speed: float
    rate: float
    rise: float


def hover(stage: Stage, seconds: float = 10.0) -> tuple[float, float]:
    """Vertical speed (m/s) and drift (m) of an aircraft that is told to stand still."""
    stage.client.send("DRIVE " + _velocities())
    begin = stage.settle()
    fastest = 0.0
    for state in stage.steps(seconds):
        fastest = max(fastest, abs(state.linear_velocity[2]))
    return fastest, math.dist(begin.pose.position, stage.state.pose.position)


def fly(stage: Stage, speed: float = 2.0, rate: float = 100.0) -> Flight:
    """Fly at a speed (m/s), stop, turn clockwise at a rate (deg/s)."""
    stage.client.send("DRIVE " + _velocities(linear=speed))
    stage.run(3.0)
    began = stage.state
    stage.run(2.0)
    way = math.dist(began.pose.position, stage.state.pose.position)
    ground = way / (stage.state.time - began.time)
    unit = FACETS[stage.robot.dialect].rotational_velocity_unit
    stage.client.send("DRIVE " + _velocities(yaw=math.radians(rate) / unit))
    stage.run(2.0)
    begin = last = stage.state
    angle = rise = 0.0
    for state in stage.steps(2.0):
        angle -= turned(yaw_of(last), yaw_of(state))
        rise = max(rise, abs(state.pose.position[2] - begin.pose.position[2]))
        last = state
    return Flight(ground, angle / (last.time - begin.time), rise)


def nose_down(state: RobotBody) -> float:
    """Pitch of the wire frame, rad: negative with the nose down."""
    return -rpy_from_quaternion(state.pose.quaternion)[1]


def lean(stage: Stage, speed: float) -> tuple[float, float]:
    """Pitch (rad, wire) that an aircraft takes at a speed ahead, and s until within 2 deg of it."""
    stage.settle()
    stage.client.send("DRIVE " + _velocities(linear=speed))
    pitches = [nose_down(state) for state in stage.steps(2.0)]
    near = np.abs(np.array(pitches) - pitches[-1]) < math.radians(2.0)
    return pitches[-1], float(np.argmax(near)) * stage.glance


def _velocities(linear: float = 0.0, yaw: float = 0.0) -> str:
    return (
        f"{{AltitudeVelocity 0}} {{LinearVelocity {linear:.9g}}} {{LateralVelocity 0}}"
        f" {{RotationalVelocity {yaw:.9g}}} {{Normalized false}}"
    )


def dive(stage: Stage, seconds: float = 30.0) -> float:
    """How far (m) a submarine moves while commands of other families reach it."""
    begin = stage.settle()
    stage.client.send("DRIVE {Left 5} {Right 5}", "DRIVE {Speed 5} {FrontSteer 0} {RearSteer 0}")
    stage.client.send("DRIVE " + _velocities(linear=1.0))
    stage.run(seconds)
    return math.dist(begin.pose.position, stage.state.pose.position)
