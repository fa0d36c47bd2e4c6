"""All classes at once: they come to rest where they fall, and do what GEO and CONF announce.

An old MATLAB demo spawned a list of classes one after the other from high above: robots reference
1.1 (bsamadi/AUT-USARSim-Toolbox: Demos/TEST_All_Robots.m) and robots 5.1. Each of them has to come
to rest close to where it fell, on its wheels, tracks or feet.

Clients reckon with WheelRadius times MaxSpeed, and believe odometry (protocol reference 3.4.1,
protocol 131 and 132; robots 19 and 79). Every class is driven straight at its
announced limit, or at 3 m/s if that is less, by a client that commands twice the limit where it is
driven at it. Turns are compared where wheels do not slip sideways: with two driven wheels.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest
from lanes import slow_but
from robot_files import number
from sharing import shipped_robots

from usarsim_server.base.files import data_directory
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import Rehearsal, RehearsedClient

CLASSES = (
    *("KRobot", "Rugbot", "P2AT", "StereoP2AT", "OmniP2AT", "P2DX", "OmniP2DX", "ATRVJr", "ATRV"),
    *("Zerg", "Element", "Matilda", "SegwayRMPFifty", "Talon", "TeleMax", "Tarantula"),
    *("UnitLoader", "ForkLift", "Hummer", "SnowStorm", "Sedan", "Cooper", "Submarine", "AirRobot"),
    *("Passarola", "ERS", "QRIO", "Soryu", "Kurt2D", "Kurt3D", "Lisa", "kenaf"),
)
FAMILIES = ("P2AT", "OmniP2AT", "Talon", "Sedan", "Submarine", "AirRobot", "ERS", "Soryu")
"""One class of each family: the others are slow."""
LISTED = {name.lower() for name in CLASSES}
OTHERS = tuple(
    robot.name
    for robot in shipped_robots().descriptions()
    if robot.kind != "static" and robot.name.lower() not in LISTED
)
"""Shipped classes that the demo did not know."""
FLOATING = {"Submarine", "AirRobot", "ARDrone", "Passarola", "quadrotor"}
"""They stay where they are put."""
HEIGHTS = (1.4, 1.75, 2.1)
"""m above the floor; the demo used heights from 1.4 to 2.1."""
FALL = 1.0
"""s of simulated time that is watched at every other step: a fall from 2.1 m takes 0.65 s."""
SETTLE = 2.0
LARGEST_STEP = 0.1
"""m in two steps; robots 62 allows as much in one."""


@pytest.fixture(scope="module")
def yard() -> Iterator[Rehearsal]:
    """An endless floor for one robot at a time."""
    with Rehearsal(world="empty", max_robots=1) as rehearsal:
        yield rehearsal


@pytest.fixture
def client(yard: Rehearsal) -> Iterator[RehearsedClient]:
    """A connection whose robot leaves after the test."""
    connection = yard.connect()
    yield connection
    connection.close()
    yard.run(0.02)


def look(vehicle: Vehicle) -> RobotBody:
    """Its state; it must not have been lost."""
    state = vehicle.body.look()
    assert state is not None, "lost"
    return state


def fallen(yard: Rehearsal, vehicle: Vehicle) -> list[float]:
    """Heights of the reference point, every other step; none may be a leap."""
    heights = []
    last = look(vehicle).pose.position
    step = 2.0 * yard.assembly.simulation.timestep
    for _ in range(round(FALL / step)):
        yard.run(step)
        place = look(vehicle).pose.position
        assert math.dist(last, place) < LARGEST_STEP
        heights.append(place[2])
        last = place
    return heights


@pytest.mark.parametrize("name", slow_but(FAMILIES.__contains__, CLASSES))
def test_spawned_from_above_it_settles(yard: Rehearsal, client: RehearsedClient, name: str) -> None:
    """It appears, falls, does not leap, and stands where it fell (robots 1, 2, 17, 62)."""
    settles(yard, client, name, HEIGHTS[CLASSES.index(name) % len(HEIGHTS)])


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_all_others_settle_too(yard: Rehearsal, client: RehearsedClient, name: str) -> None:
    """A metre above its rest height every other class does the same (robots 1, 17, 62)."""
    robot = load_robot(data_directory("robots") / f"{name}.toml")
    settles(yard, client, name, robot.rest_height + 1.0)


def settles(yard: Rehearsal, client: RehearsedClient, name: str, height: float) -> None:
    """Spawn a class at a height (m) and see that it stands there, upright and still, in the end."""
    client.send(f"INIT {{ClassName USARBot.{name}}} {{Location 4.0,-2.0,-{height}}}")
    (vehicle,) = yard.assembly.robots.vehicles
    robot = vehicle.description
    assert robot.name.lower() == name.lower()
    heights = fallen(yard, vehicle)
    yard.run(SETTLE)
    before = look(vehicle)
    yard.run(0.2)
    after = look(vehicle)
    x, y, z = after.pose.position
    assert math.hypot(x - 4.0, y - 2.0) < 0.1
    assert math.dist(before.pose.position, after.pose.position) < 1e-3, "at rest"
    up = after.pose.rotate((0.0, 0.0, 1.0))[2]
    assert up > math.cos(math.radians(5.0)), "upright"
    client.send("GETGEO {Type Robot}")
    assert client.take("GEO"), "it answers"
    if name in FLOATING:
        assert z == pytest.approx(height, abs=0.02)
        return
    assert z == pytest.approx(robot.rest_height, abs=0.01)
    landed = next(i for i, one in enumerate(heights) if one < robot.rest_height + 0.01)
    assert max(heights[landed:]) < robot.rest_height + 0.05, "bounces"


DRIVEN = {robot.name: robot for robot in shipped_robots().descriptions() if robot.wheels}
STRAIGHT, TURNING = sorted(DRIVEN), sorted(n for n, r in DRIVEN.items() if r.kind == "differential")
FASTEST = 3.0
"""m/s; beyond it only a part of the limit is tried."""
APART = 15.0
"""m between two robots."""
GATHERING, WINDOW = 3.5, 2.0
"""Simulated s to get up to speed, and to measure."""
TURN = 0.5
"""rad/s in the turn."""


def vector(line: str, key: str) -> list[float]:
    """Numbers of a line."""
    found = re.search(rf"\{{{key} ([^}}]*)\}}", line)
    assert found is not None, (key, line)
    return [float(part) for part in found[1].split(",")]


@dataclass
class Driver:
    """A client with a robot of one class.

    Attributes:
        robot: the class. client: the connection.
        radius, separation, limit: as announced, m, m, rad/s.
        measured: by name, what was driven and told in a window of time.
    """

    robot: RobotDescription
    client: RehearsedClient
    radius: float = 0.0
    separation: float = 0.0
    limit: float = 0.0
    measured: dict[str, float] = field(default_factory=dict)
    told: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)

    def ask(self) -> None:
        """Learn what the class announces."""
        self.client.take()
        self.client.send("GETGEO {Type Robot}", "GETCONF {Type Robot}")
        geo, conf = (line for line in self.client.take() if line.startswith(("GEO", "CONF")))
        self.radius, self.separation = number(geo, "WheelRadius"), number(geo, "WheelSeparation")
        self.limit = number(conf, "MaxSpeed")

    @property
    def spin(self) -> float:
        """rad/s at which it is measured."""
        return min(self.limit, FASTEST / self.radius)

    def straight(self) -> None:
        """Full speed ahead: more than the limit is commanded where the limit is tried."""
        spin = 2.0 * self.limit if self.spin == self.limit else self.spin
        self.client.send(self._command(spin, spin))

    def turn(self) -> None:
        """To the right on the spot."""
        spin = min(self.limit, TURN * self.separation / (2.0 * self.radius))
        self.measured["commanded turn"] = 2.0 * spin * self.radius / self.separation
        self.client.send(self._command(spin, -spin))

    def stop(self) -> None:
        self.client.send(self._command(0.0, 0.0))

    def _command(self, left: float, right: float) -> str:
        match self.robot.kind:
            case "ackerman":
                return f"DRIVE {{Speed {left:.4f}}} {{FrontSteer 0}} {{RearSteer 0}}"
            case "omni":
                wheels = range(len(self.robot.driven_wheels))
                groups = [f"{{WheelNumber {n}}} {{WheelSpeed {left:.4f}}}" for n in wheels]
                return "DRIVE " + " ".join(groups)
        return f"DRIVE {{Left {left:.4f}}} {{Right {right:.4f}}}"

    def hear(self) -> None:
        """Note place, heading and odometry as the newest lines tell them."""
        said = self.client.take("SEN")
        truth = [line for line in said if "{Type GroundTruth}" in line]
        location, heading = vector(truth[-1], "Location"), vector(truth[-1], "Orientation")[2]
        place = [*location, heading, number(truth[-1], "Time")]
        odometry = [line for line in said if "{Type Odometry}" in line]
        pose = vector(odometry[-1], "Pose") if odometry else []
        self.told = {"now": (place, pose), "before": self.told.get("now", (place, pose))}

    def way(self) -> tuple[float, float | None, float]:
        """Ground truth and odometry (m) of the last window, and its length, s."""
        (then, pose), (now, newer) = self.told["before"], self.told["now"]
        reckoned = math.dist(pose[:2], newer[:2]) if pose else None
        return math.dist(then[:2], now[:2]), reckoned, now[-1] - then[-1]

    def turned(self) -> tuple[float, float | None, float]:
        """The same of the heading, rad, clockwise."""
        (then, pose), (now, newer) = self.told["before"], self.told["now"]
        reckoned = newer[2] - pose[2] if pose else None
        return (now[3] - then[3]) % math.tau, reckoned, now[-1] - then[-1]


@pytest.fixture(scope="module")
def drivers() -> Iterator[dict[str, Driver]]:
    """All of them, after they have been driven straight and turned."""
    with Rehearsal(world="empty", max_robots=64) as stage:
        found: dict[str, Driver] = {}
        for row, (name, robot) in enumerate(DRIVEN.items()):
            client = stage.connect()
            place = f"{{Location 0,{row * APART:g},{-robot.rest_height - 0.01:.3f}}}"
            client.send(f"INIT {{ClassName USARBot.{name}}} {{Name R{row}}} {place}")
            found[name] = Driver(robot, client)
        stage.run(1.0)
        for driver in found.values():
            driver.ask()
            driver.straight()
        for wait in (GATHERING, WINDOW):
            stage.run(wait)
            for driver in found.values():
                driver.hear()
        for driver in found.values():
            way, reckoned, elapsed = driver.way()
            driver.measured |= {"speed": way / elapsed, "top": driver.spin * driver.radius}
            if reckoned is not None:
                driver.measured["odometry"] = reckoned / way
            driver.stop()
        turning = [found[name] for name in TURNING]
        stage.run(2.0)
        for driver in turning:
            driver.turn()
        for wait in (1.5, 2.0):
            stage.run(wait)
            for driver in turning:
                driver.hear()
        for driver in turning:
            angle, reckoned, elapsed = driver.turned()
            driver.measured["turn"] = angle / elapsed
            if reckoned is not None:
                driver.measured["turn of odometry"] = reckoned / angle
        yield found


def tolerance(robot: RobotDescription) -> float:
    """Belts slip a little."""
    return 0.10 if robot.kind == "tracked" else 0.05


@pytest.mark.slow
@pytest.mark.parametrize("name", STRAIGHT)
def test_speed_is_radius_times_limit(drivers: dict[str, Driver], name: str) -> None:
    """MaxSpeed of CONF times WheelRadius of GEO is the speed of a class, and what is beyond the
    limit is not driven (protocol checks 131, 132)."""
    driver = drivers[name]
    assert driver.measured["speed"] == pytest.approx(
        driver.measured["top"], rel=tolerance(driver.robot)
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", STRAIGHT)
def test_odometry_is_the_way(drivers: dict[str, Driver], name: str) -> None:
    """Odometry of a straight way is its length (robots check 79); only some classes have one."""
    driver = drivers[name]
    has = any(item.type == "Odometry" for item in driver.robot.items)
    assert ("odometry" in driver.measured) is has
    if has:
        assert driver.measured["odometry"] == pytest.approx(1.0, rel=tolerance(driver.robot))


@pytest.mark.slow
@pytest.mark.parametrize("name", TURNING)
def test_turns_are_those_of_the_separation(drivers: dict[str, Driver], name: str) -> None:
    """With two driven wheels the turn is (Left - Right) radius / separation, in truth and in
    odometry (protocol check 132)."""
    measured = drivers[name].measured
    assert measured["turn"] == pytest.approx(measured["commanded turn"], rel=0.05)
    assert measured.get("turn of odometry", 1.0) == pytest.approx(1.0, rel=0.05)
