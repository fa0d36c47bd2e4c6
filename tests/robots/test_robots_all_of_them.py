"""The list of classes that an old MATLAB demo spawned one after the other, from high above.

Robots reference 1.1 (bsamadi/AUT-USARSim-Toolbox: Demos/TEST_All_Robots.m) and 5.1: each of them
has to come to rest close to where it fell, on its wheels, tracks or feet.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from usarsim_server.data import data_directory
from usarsim_server.robots.catalog import load_robot, load_roster
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import Rehearsal, RehearsedClient

CLASSES = (
    *("KRobot", "Rugbot", "P2AT", "StereoP2AT", "OmniP2AT", "P2DX", "OmniP2DX", "ATRVJr", "ATRV"),
    *("Zerg", "Element", "Matilda", "SegwayRMPFifty", "Talon", "TeleMax", "Tarantula"),
    *("UnitLoader", "ForkLift", "Hummer", "SnowStorm", "Sedan", "Cooper", "Submarine", "AirRobot"),
    *("Passarola", "ERS", "QRIO", "Soryu", "Kurt2D", "Kurt3D", "Lisa", "kenaf"),
)
LISTED = {name.lower() for name in CLASSES}
OTHERS = tuple(
    robot.name
    for robot in load_roster().descriptions()
    if robot.kind != "static" and robot.name.lower() not in LISTED
)
"""Shipped classes that the demo did not know."""
FLOATING = {"Submarine", "AirRobot", "ARDrone", "Passarola", "quadrotor"}
"""They stay where they are put."""
HEIGHTS = (1.4, 1.75, 2.1)
"""m above the floor; the demo used heights from 1.4 to 2.1."""
FALL = 1.0
"""s of simulated time that is watched step by step: a fall from 2.1 m takes 0.65 s."""
SETTLE = 2.0
LARGEST_STEP = 0.1
"""m in one step (5.3 #62)."""


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
    """Heights of the reference point, step by step; no step may be a leap."""
    heights = []
    last = look(vehicle).pose.position
    step = yard.assembly.simulation.timestep
    for _ in range(round(FALL / step)):
        yard.run(step)
        place = look(vehicle).pose.position
        assert math.dist(last, place) < LARGEST_STEP
        heights.append(place[2])
        last = place
    return heights


@pytest.mark.parametrize("name", CLASSES)
def test_spawned_from_above_it_settles(yard: Rehearsal, client: RehearsedClient, name: str) -> None:
    """It appears, falls, does not leap, and stands where it fell (checks 1, 2, 17, 62)."""
    settles(yard, client, name, HEIGHTS[CLASSES.index(name) % len(HEIGHTS)])


@pytest.mark.parametrize("name", OTHERS)
def test_all_others_settle_too(yard: Rehearsal, client: RehearsedClient, name: str) -> None:
    """A metre above its rest height every other class does the same (checks 1, 17, 62)."""
    robot = load_robot(data_directory("robots") / f"{name}.toml")
    settles(yard, client, name, robot.rest_height + 1.0)


def settles(yard: Rehearsal, client: RehearsedClient, name: str, height: float) -> None:
    """Spawn a class at a height (m) and see that it stands there, upright and still, in the end."""
    client.send(f"INIT {{ClassName USARBot.{name}}} {{Location 4.0,-2.0,-{height}}}")
    (vehicle,) = yard.assembly.fleet.vehicles
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
