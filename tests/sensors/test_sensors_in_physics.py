"""Sensors on a robot that MuJoCo moves, with the true ray caster (robots 65 to 103)."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from sensor_fakes import UDK, UT2004, describe_robot, make, numbers, values

from usarsim_server.robots.description import RobotReport, Wheel
from usarsim_server.sensors.base import Sensor
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import PhysicsOptions, RobotModel
from usarsim_server.simulation.rays.cast import cast
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.rays.scenery import StaticGeometry
from usarsim_server.simulation.snapshot import RobotBody

RADIUS, HALF_TRACK, HALF_BASE, HALF_WIDTH = 0.11, 0.2, 0.13, 0.14
NAMES = ("LeftFront", "RightFront", "LeftRear", "RightRear")
BOX = mujoco.mjtGeom.mjGEOM_BOX

Solid = tuple[str, tuple[float, float, float], tuple[float, float, float]]
"""Name (containing glass for a pane), centre and half extents, m."""


def corner(name: str) -> tuple[float, float, float]:
    """Place of a wheel relative to the reference point."""
    x = HALF_BASE if name.endswith("Front") else -HALF_BASE
    return x, HALF_TRACK if name.startswith("Left") else -HALF_TRACK, 0.0


def build_robot() -> mujoco.MjSpec:
    """A box on four wheels with velocity servos."""
    spec = mujoco.MjSpec()
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="free")
    base.add_geom(type=BOX, size=[0.2, HALF_WIDTH, 0.06], pos=[0, 0, 0.04], mass=9.0)
    for name in NAMES:
        wheel = base.add_body(name=name, pos=corner(name))
        wheel.add_joint(name=name, axis=[0, 1, 0], armature=0.01)
        size = [RADIUS, 0.04, RADIUS]
        wheel.add_geom(type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, size=size, mass=0.75)
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_velocity(kv=20.0)
    return spec


MODEL = RobotModel("cart", build_robot, NAMES, RADIUS)
CART = describe_robot(
    "Cart",
    wheels=tuple(
        Wheel(name, "left" if name.startswith("Left") else "right", corner(name), RADIUS, 0.08, 0.8)
        for name in NAMES
    ),
    report=RobotReport(
        RADIUS, 2 * HALF_TRACK, 2 * HALF_BASE, 12, "SkidSteered", (0, 0, 0), (0, 0, 0), 6, 60
    ),
)


def scenery(*solids: Solid) -> Callable[[], mujoco.MjSpec]:
    """An endless floor with boxes on it."""

    def build() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        for name, centre, half in solids:
            spec.worldbody.add_geom(name=name, type=BOX, pos=centre, size=half)
        return spec

    return build


class Bench:
    """Robots at places (x, y) of a world; robot 0 carries the sensors."""

    def __init__(self, *solids: Solid, at: tuple[tuple[float, float], ...] = ((0.0, 0.0),)) -> None:
        self.engine = Engine(scenery(*solids), PhysicsOptions(), [MODEL] * len(at))
        for number, (x, y) in enumerate(at):
            self.engine.occupy(number, number, Pose((x, y, RADIUS)))
        self.static = StaticGeometry(self.engine.world)
        self.dynamic = DynamicGeometry(self.engine.world)

    def read(self, *sensors: Sensor) -> RobotBody:
        """Let sensors take one reading of the present instant."""
        snapshot = self.engine.snapshot()
        robot = RobotBody(snapshot, snapshot.layouts[0])
        for sensor in sensors:
            hits = cast(list(sensor.rays(robot)), snapshot, 0, self.static, self.dynamic)
            sensor.measure(robot, hits)
        return robot

    def run(self, seconds: float, interval: float, *sensors: Sensor) -> None:
        """Advance the physics, reading at each interval."""
        for _ in range(round(seconds / interval)):
            self.engine.advance(round(interval / self.engine.timestep))
            self.read(*sensors)


WALL: Solid = ("wall", (2.5, 0.0, 1.0), (0.5, 5.0, 1.0))


@pytest.fixture(scope="module")
def room() -> Bench:
    """A wall 2 m ahead, a pane of glass 0.6 m ahead on the left, a second robot on the right."""
    pane: Solid = ("glass_pane", (0.6, 2.0, 0.5), (0.005, 1.0, 0.5))
    return Bench(WALL, pane, at=((0.0, 0.0), (0.0, -2.0)))


def test_sonar_hears_the_wall(room: Bench) -> None:
    """Robots 65 with true normals: 2.000 m within 1 %."""
    sonar = make("Sonar", robot=CART, location=(0.0, 0.0, -0.3))
    room.read(sonar)
    assert sonar.range == pytest.approx(2.0, rel=0.01)


def test_the_laser_is_not_blinded_by_its_own_robot(room: Bench) -> None:
    """Robots 73: from inside the chassis it sees wall and other robot, not itself."""
    laser = make("SICK", robot=CART, location=(0.0, 0.0, -0.04))
    room.read(laser)
    ranges = numbers(values(laser)["Range"])
    assert ranges[90] == 2.0
    assert ranges[0] == pytest.approx(2.0 - HALF_WIDTH, abs=0.01)
    assert min(ranges) > 1.0


def test_infrared_reads_the_wall_behind_glass(room: Bench) -> None:
    """Robots 77: the pane stops the laser and the plain range sensor, not the IR."""
    mount = {"location": (0.5, -1.5, -0.5)}
    infrared = make("IR", robot=CART, max_range=5.0, **mount)
    plain = make("RangeSensor", robot=CART, **mount)
    room.read(infrared, plain)
    assert infrared.range == pytest.approx(1.5, abs=1e-3)
    assert plain.range == pytest.approx(0.095, abs=1e-3)


@pytest.mark.parametrize(("gap", "expected"), [(-0.001, True), (0.001, True), (0.006, False)])
def test_touch_feels_a_true_surface(room: Bench, gap: float, expected: bool) -> None:
    """Robots 103: True at 1 mm, False at 6 mm, True when pressed in."""
    pad = make("Touch", robot=CART, location=(2.0 - gap, 0.0, -0.5))
    room.read(pad)
    assert pad.touched is expected


def depths(bench: Bench, height: float) -> set[float]:
    """All depths of one whole image from a height above the reference point."""
    camera = make("KinectDepth", robot=CART, location=(0.0, 0.0, -height))
    camera.set("SCAN", "", bench.read())
    pixels: set[float] = set()
    for _ in range(camera.frames):
        bench.read(camera)
        pixels |= set(numbers(values(camera)["Range"].removesuffix(",")))
    return pixels


def test_depth_of_a_wall_at_three_metres() -> None:
    """Robots 78: 3.00 in all 76,800 pixels, by true rays; a robot in front of it is nearer."""
    wall: Solid = ("wall", (3.5, 0.0, 2.0), (0.5, 6.0, 2.0))
    assert depths(Bench(wall), 1.4) == {3.0}
    pixels = depths(Bench(wall, at=((0.0, 0.0), (1.5, 0.0))), 0.04)
    assert {1.3, 3.0} <= pixels
    assert max(pixels) == 3.0


@pytest.mark.parametrize("yaw", np.linspace(-1.5, 1.5, 7).tolist())
@pytest.mark.parametrize(("gap", "expected"), [(0.01, True), (0.03, False)])
def test_a_bumper_feels_a_post_anywhere_on_its_arc(yaw: float, gap: float, expected: bool) -> None:
    """Robots 104: a post of 4 cm at 1 cm in front of the arc, none at 3 cm."""
    reach = 0.17 + gap + 0.02 * (abs(np.cos(yaw)) + abs(np.sin(yaw)))
    post: Solid = ("post", (reach * np.cos(yaw), -reach * np.sin(yaw), 0.5), (0.02, 0.02, 0.5))
    bumper = make("BumperArray", robot=CART, location=(0.0, 0.0, -0.3))
    Bench(post).read(bumper)
    assert bumper.touched is expected


def test_a_roof_hides_the_sky() -> None:
    """Robots 96 and 97: 11 satellites in the open, none below a wide roof."""
    roof: Solid = ("roof", (0.0, 0.0, 2.0), (60.0, 60.0, 0.1))
    walls: list[Solid] = [
        ("w", (60.0, 0.0, 1.0), (0.1, 60.0, 2.0)),
        ("e", (-60.0, 0.0, 1.0), (0.1, 60.0, 2.0)),
    ]
    for solids, fix in (((), "1"), ((roof, *walls), "0")):
        gps = make("GPS", robot=CART, location=(0.0, 0.0, -0.3))
        Bench(*solids).read(gps)
        assert values(gps)["Fix"] == fix


def test_a_straight_drive_by_all_wheel_sensors() -> None:
    """Robots 79, 85 and 88: standing, then about 2 m straight ahead.

    Odometry agrees with the truth within 1 %, Tachometer Vel with the wheel speed within 1 %,
    encoders count up, the INS stands still while the robot does.
    """
    bench = Bench()
    odometry = make("Odometry", robot=CART)
    tachometer = make("Tachometer", robot=CART)
    encoder = make("Encoder", "ECLeft", robot=CART)
    ins = make("INS", robot=CART)
    sensors = (odometry, tachometer, encoder, ins)
    bench.run(2.0, 0.2, *sensors)
    at_rest = ins.data(UDK)
    bench.run(2.0, 0.2, *sensors)
    assert ins.data(UDK) == at_rest

    odometry.set("RESET", "", bench.read())
    start = bench.read().pose.position
    bench.engine.drive(0, np.full(4, 3.0))
    bench.run(6.2, 0.2, *sensors)
    robot = bench.read()
    way = robot.pose.position[0] - start[0]
    assert way > 1.8
    assert numbers(values(odometry)["Pose"])[0] == pytest.approx(way, rel=0.01)
    assert numbers(values(tachometer)["Vel"]) == pytest.approx([3.0] * 4, rel=0.01)
    turned = float(robot.wheel_angles[0])
    assert int(values(encoder, UT2004)["Tick"]) == pytest.approx(turned / 0.01745, rel=0.01)
    assert numbers(values(ins)["Location"])[0] == pytest.approx(way + start[0], abs=0.3)


def test_inertial_sensors_of_a_standing_robot() -> None:
    """Robots 98: no acceleration in the IMU, gravity in the accelerometer."""
    bench = Bench()
    imu, accelerometer = make("IMU", robot=CART), make("Accelerometer", robot=CART)
    bench.run(2.0, 0.1, imu, accelerometer)
    for key in ("XYZAcceleration", "AngularVel", "AngularAccel"):
        assert numbers(values(imu)[key]) == pytest.approx([0.0] * 3, abs=0.01)
    proper = numbers(values(accelerometer)["ProperAcceleration"])
    assert proper == pytest.approx([0.0, 0.0, 9.81], abs=0.02)


def test_ground_truth_of_a_turned_robot() -> None:
    """Robots 91: after turning in place to the left the wire yaw is negative and true."""
    bench = Bench()
    truth, odometry = make("GroundTruth", robot=CART), make("Odometry", robot=CART)
    bench.run(0.5, 0.1, truth, odometry)
    bench.engine.drive(0, np.array([-2.0, 2.0, -2.0, 2.0]))
    bench.run(2.0, 0.1, truth, odometry)
    robot = bench.read(truth)
    w, _, _, z = robot.pose.quaternion
    yaw = numbers(values(truth)["Orientation"])[2]
    assert yaw == pytest.approx(-2.0 * np.arctan2(z, w), abs=1e-3)
    assert yaw < -0.2
    assert numbers(values(odometry)["Pose"])[2] < 1.2 * yaw
