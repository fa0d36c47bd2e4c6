"""Acceptance tests of cars, aircraft and submarines: V23 to V25, and single items of 5.2."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_bench.fidelity import worlds
from usarsim_bench.fidelity.results import ANY, Band, Result
from usarsim_bench.fidelity.stage import Stage, turned, yaw_of
from usarsim_bench.fidelity.workshop import Case, Workshop
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.ackerman import SteeredFamily
from usarsim_server.simulation.frames import Pose, rpy_from_quaternion
from usarsim_server.simulation.snapshot import RobotBody

Results = Iterator[Result]
Steps = Sequence[float]

ALOFT = Pose((0.0, 0.0, 5.0))
ROTORCRAFT = ("AirRobot", "quadrotor")
CARS = ("Hummer", "Sedan", "FrontAckerman", "BasicAckermanRobot")
"""The last one is steered behind."""
PULLED = ("FrontAckerman",)
"""Its front wheels are larger: turning as fast as the others they pull it into the curve."""
STEER = 0.3
"""rad (robots reference 3.3 V25)."""
GROUND_SPEED = 1.0
"""m/s at most; tyres slip little at that speed."""
WALKED = 4.0
"""s that a circle is watched."""


# -- cars ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Circle:
    """A drive on a circle.

    Attributes:
        radius: of the circle on which the middle of the axle that is not steered goes, m.
        clockwise: seen from above.
        own: whether two parts of the robot ever touched each other.
    """

    radius: float
    clockwise: bool
    own: bool


def unsteered_axle(robot: RobotDescription) -> float:
    """How far ahead of the reference point the wheels stand that no joint steers, m."""
    steering = robot.family
    assert isinstance(steering, SteeredFamily)
    places = [wheel.x for wheel in steering.wheels if wheel.joint is None]
    return sum(places) / len(places)


def ideal_radius(robot: RobotDescription, steer: float) -> float:
    """Wheel base over the tangent of the steering angle, m (robots reference 3.3 V25)."""
    steering = robot.family
    assert isinstance(steering, SteeredFamily)
    places = [wheel.x for wheel in steering.wheels]
    return (max(places) - min(places)) / math.tan(abs(steer))


def drive_circle(stage: Stage, steer: float, seconds: float = WALKED) -> Circle:
    """Drive ahead with the wheels turned by an angle (rad, positive to the right)."""
    robot = stage.robot
    steering = robot.family
    assert isinstance(steering, SteeredFamily)
    front = any(wheel.joint and wheel.front for wheel in steering.wheels)
    stage.settle()
    spin = min(GROUND_SPEED / steering.wheels[0].radius, robot.drive.max_wheel_speed / 2.0)
    command = f"{{FrontSteer {steer if front else 0.0}}} {{RearSteer {0.0 if front else steer}}}"
    stage.client.send(f"DRIVE {{Speed 0}} {command}")
    stage.run(1.0)
    stage.client.send(f"DRIVE {{Speed {spin:.9g}}} {command}")
    stage.run(1.0)
    probe, axle = stage.probe(), (unsteered_axle(robot), 0.0, 0.0)
    way = angle = 0.0
    own = False
    last = stage.state
    # Every twentieth step is enough for the length of a circle: the chord is as long as the arc.
    for number, state in enumerate(stage.steps(seconds)):
        if number % 20:
            continue
        before, after = ((one.pose @ Pose(axle)).position for one in (last, state))
        way += math.dist(before, after)
        angle += turned(yaw_of(last), yaw_of(state))
        own |= probe.look(state.snapshot).own
        last = state
    return Circle(way / abs(angle) if angle else math.inf, angle < 0.0, own)


def radius(shop: Workshop, steps: Steps) -> Results:
    """V25, #40: cars drive on the circle of their wheel base and angle; literally on a larger one.

    #41: wheels that turn under the chassis never touch it.
    """
    for robot in CARS:
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                ideal = ideal_radius(stage.robot, STEER)
                found = drive_circle(stage, STEER)
            yield Case("V25", robot, timestep).result(
                "radius / (base / tan 0.3)", found.radius / ideal, "", "1", Band(0.98, 1.02)
            )
            yield Case("#41", robot, timestep).result(
                "contact with itself in a turn", found.own, "", "0", Band(0.0, 0.0)
            )
            with shop.stage(worlds.flat(), f"{robot}_literal", timestep) as stage:
                literal = drive_circle(stage, STEER)
            yield Case("#40", f"{robot}_literal", timestep).result(
                "radius, literal / corrected",
                literal.radius / found.radius,
                "",
                "above 1",
                ANY if robot in PULLED else Band(low=1.001),
            )


# -- aircraft --------------------------------------------------------------------------------------


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


def tilting(stage: Stage, speed: float) -> tuple[float, float]:
    """Pitch (rad, wire) that an aircraft takes at a speed ahead, and s until within 2 deg of it."""
    stage.settle()
    stage.client.send("DRIVE " + _velocities(linear=speed))
    pitches = [nose_down(state) for state in stage.steps(2.0)]
    near = np.abs(np.array(pitches) - pitches[-1]) < math.radians(2.0)
    return pitches[-1], float(np.argmax(near)) * stage.timestep


def hovering(shop: Workshop, steps: Steps) -> Results:
    """V23: without velocities an aircraft stays where it is."""
    for robot in (*ROTORCRAFT, "Passarola"):
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep, ALOFT) as stage:
                fastest, drift = hover(stage)
            case = Case("V23", robot, timestep)
            yield case.result("vertical speed", 1e3 * fastest, "mm/s", "0", Band(high=10.0))
            yield case.result("drift in 10 s", 1e3 * drift, "mm", "0", Band(high=20.0))


def speeds(shop: Workshop, steps: Steps) -> Results:
    """V24, #42, #43: speed, yaw rate, height while turning, pitch and the time it takes."""
    for robot in ROTORCRAFT:
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep, ALOFT) as stage:
                found = fly(stage)
            case = Case("V24", robot, timestep)
            yield case.result("speed ahead", found.speed, "m/s", "2", Band(1.9, 2.1))
            yield case.result(
                "yaw rate", math.degrees(found.rate), "deg/s", "100", Band(98.0, 102.0)
            )
            yield Case("#42", robot, timestep).result(
                "change of height, turning", 1e3 * found.rise, "mm", "0", Band(high=20.0)
            )
            with shop.stage(worlds.flat(), robot, timestep, ALOFT) as stage:
                pitch, seconds = tilting(stage, 1.0)
            case = Case("#43", robot, timestep)
            yield case.result("pitch ahead", math.degrees(pitch), "deg", "-25", Band(-25.5, -24.5))
            yield case.result("time to pitch", seconds, "s", "0.65", Band(0.5, 0.8))


def _velocities(linear: float = 0.0, yaw: float = 0.0) -> str:
    return (
        f"{{AltitudeVelocity 0}} {{LinearVelocity {linear:.9g}}} {{LateralVelocity 0}}"
        f" {{RotationalVelocity {yaw:.9g}}} {{Normalized false}}"
    )


# -- submarines ------------------------------------------------------------------------------------


def dive(stage: Stage, seconds: float = 30.0) -> float:
    """How far (m) a submarine moves while commands of other families reach it."""
    begin = stage.settle()
    stage.client.send("DRIVE {Left 5} {Right 5}", "DRIVE {Speed 5} {FrontSteer 0} {RearSteer 0}")
    stage.client.send("DRIVE " + _velocities(linear=1.0))
    stage.run(seconds)
    return math.dist(begin.pose.position, stage.state.pose.position)


def depth(shop: Workshop, steps: Steps) -> Results:
    """#49: at zero input a submarine holds its depth, and other families' keys do nothing."""
    for timestep in steps:
        with shop.stage(worlds.flat(), "Submarine", timestep, ALOFT) as stage:
            moved = dive(stage)
        yield Case("#49", "Submarine", timestep).result(
            "moved in 30 s", 1e3 * moved, "mm", "0", Band(high=10.0)
        )
