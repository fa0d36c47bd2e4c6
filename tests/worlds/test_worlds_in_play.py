"""Smoke and ground as a controller meets them: shipped robots, text in, text out."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from shipped_worlds import build
from world_files import HEAD, START, write_world

from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.snapshot import RobotBody
from usarsim_server.testing import Rehearsal, RehearsedClient
from usarsim_server.worlds.smoke import SmokeField

G = 9.81

SCOUT = """
extends = "P3AT"
name = "Scout"
without = ["InsTest", "TachTest", "W1", "W2"]

[[sensor]]
type = "Hokuyo"
name = "urg"
position = [0.2085, 0, -0.2]

[[sensor]]
type = "Sonar"
name = "F4"
position = [0.2085, 0, -0.1]

[drive]
max_wheel_speed = 8.17
"""
ICE = '[[surface]]\nname = "rink"\nkind = "ice"\nx = [1.9, 9]\ny = [-2, 2]\nz = [-0.1, 2]\n'
P2AT_MASS, P2AT_RADIUS = 14.0, 0.13


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Rehearsal]:
    """The shipped corridor, with a robot that has a SICK and a Hokuyo in the same place."""
    (tmp_path / "Scout.toml").write_text(SCOUT, encoding="utf-8")
    with Rehearsal(world="smoke_corridor", robots=(tmp_path,)) as rehearsal:
        yield rehearsal


def enter(stage: Rehearsal, robot: str, x: float, y: float) -> RehearsedClient:
    """A robot at a place (simulation frame), facing along +x, at rest on the ground."""
    client = stage.connect()
    client.send(f"INIT {{ClassName USARBot.{robot}}} {{Location {x},{-y},-0.25}}")
    stage.run(1.0)
    return client


def scan(stage: Rehearsal, client: RehearsedClient, name: str) -> list[float]:
    """A fresh reading of a sensor."""
    client.take()
    stage.run(0.4)
    line = [line for line in client.lines if f"{{Name {name}}}" in line][-1]
    found = re.search(r"\{Range ([^}]*)\}", line)
    assert found is not None
    return [float(part) for part in found.group(1).split(",")]


def body_of(stage: Rehearsal) -> RobotBody:
    """State of the first robot."""
    body = stage.assembly.robots.vehicles[0].body.look()
    assert body is not None
    return body


def speed_at(stage: Rehearsal, client: RehearsedClient, *places: float) -> list[float]:
    """Speed along x (m/s) over the 0.4 m that follow each place."""
    speeds = []
    for place in places:
        times = []
        for goal in (place, place + 0.4):
            for _ in range(4000):
                body = body_of(stage)
                if body.pose.position[0] >= goal:
                    break
                stage.run(0.02)
            else:
                pytest.fail(f"the robot does not get to {goal}")
            times.append((body.time, body.pose.position[0]))
        (start, begin), (end, finish) = times
        speeds.append((finish - begin) / (end - start))
    return speeds


# -- smoke -----------------------------------------------------------------------------------


def test_the_smoke_of_the_corridor(stage: Rehearsal) -> None:
    """Robots 76 from 0.5 m before the smoke: SICK sees the far wall, Hokuyo nothing ahead."""
    client = enter(stage, "Scout", 6.0, 0.3)
    sick, hokuyo = scan(stage, client, "lms200"), scan(stage, client, "urg")
    assert sick[90] == pytest.approx(23.94 - 6.0 - 0.2085, abs=0.05)
    assert hokuyo[114] == 0.0
    # To both sides the walls of the corridor are nearer than the smoke.
    for side in (25, 203):
        angle = 4.189 / 2 - 0.0184086914 * side
        half = 1.2 + math.copysign(0.3, angle)
        assert hokuyo[side] == pytest.approx(half / abs(math.sin(angle)), abs=0.05)
    assert scan(stage, client, "F4") == [5.0]


def test_before_the_smoke_both_lasers_agree(stage: Rehearsal) -> None:
    """In the lobby the Hokuyo reads what the SICK reads, up to its own range."""
    client = enter(stage, "Scout", -4.7, 0.6)
    sick, hokuyo = scan(stage, client, "lms200"), scan(stage, client, "urg")
    assert sick[90] > 10.0
    assert hokuyo[114] == 4.0
    for degrees in (-85, -70, 70, 85):
        beam = round((4.189 / 2 - math.radians(degrees)) / 0.0184086914)
        assert hokuyo[beam] == pytest.approx(sick[90 - degrees], abs=0.06)


def test_the_fire_stops_lasers_but_not_sonar(stage: Rehearsal) -> None:
    """At the height of the scanner the plume is thick: it reads the plume, sonar the way on."""
    client = enter(stage, "Scout", 16.9, -0.75)
    sick = scan(stage, client, "lms200")
    assert 0.2 < sick[90] < 0.95
    assert sick[125] > 3.0
    assert scan(stage, client, "F4") == [5.0]


def test_the_fire_is_thick_where_it_matters() -> None:
    """At any time more than nine of ten level beams through the middle of the plume are stopped."""
    field = SmokeField(build("smoke_corridor").world.smoke)
    heights = np.linspace(0.3, 1.9, 200)
    starts = np.column_stack((np.full(200, 17.0), np.full(200, -0.75), heights))
    ways = np.tile([1.0, 0.0, 0.0], (200, 1))
    for time in (0.0, 3.3, 8.1):
        stopped = np.isfinite(field.blocked_at(starts, ways, time))
        assert stopped.mean() > 0.9


# -- ground ----------------------------------------------------------------------------------


def test_a_p2at_on_floor_sand_and_mud(stage: Rehearsal) -> None:
    """At the same command: full speed on the floor, nearly so in sand, slipping in mud.

    In mud the grip that is left over the rolling resistance balances the drag of four wheels:
    v = (mu - sqrt(z/d)) m g / (4 c) within 10 %.
    """
    client = enter(stage, "P2AT", 1.3, 0.2)
    client.send("DRIVE {Left 3.85} {Right 3.85}")
    floor, sand = speed_at(stage, client, 1.7, 3.4)
    assert floor == pytest.approx(3.85 * P2AT_RADIUS, rel=0.02)
    assert 0.93 * floor < sand < 0.98 * floor
    stage.assembly.robots.vehicles[0].body.teleport(Pose((13.3, 0.2, 0.2)))
    (mud,) = speed_at(stage, client, 15.2)
    left = 0.4 - math.sqrt(0.02 / (2 * P2AT_RADIUS))
    assert mud == pytest.approx(left * P2AT_MASS * G / (4 * 15.0), rel=0.10)


def test_a_robot_with_a_caster_passes_sand_but_not_mud(stage: Rehearsal) -> None:
    """Two driven wheels get a P2DX through sand; in mud they spin (docs/worlds.md)."""
    client = enter(stage, "P2DX", 2.0, 0.2)
    client.send("DRIVE {Left 3.0} {Right 3.0}")
    assert speed_at(stage, client, 5.3)[0] > 0.2
    stage.assembly.robots.vehicles[0].body.teleport(Pose((13.4, 0.2, 0.2)))
    stage.run(8.0)
    body = body_of(stage)
    assert 13.9 < body.pose.position[0] < 15.0
    assert body.wheel_speeds.min() > 2.5


def ramp(directory: Path, *tables: str) -> Path:
    """A world with a ramp of 10 degrees from x = 2 m on."""
    w, _, y, _ = quaternion_from_rpy(0.0, math.radians(-10.0), 0.0)
    scene = f"""<mujoco><worldbody>
      <geom name="floor" type="plane" size="0 0 1" friction="1"/>
      <body pos="2 0 0" quat="{w} 0 {y} 0">
        <geom name="ramp" type="box" pos="2 0 -0.15" size="2.5 1 0.15" friction="1"/>
      </body>
    </worldbody></mujoco>"""
    return write_world(directory, HEAD + START + "\n".join(tables), scene)


@pytest.mark.parametrize(
    ("ice", "climbs"),
    [("", True), (ICE, False)],
    ids=["bare", "icy"],
)
def test_a_p2at_cannot_climb_ten_degrees_of_ice(tmp_path: Path, ice: str, climbs: bool) -> None:
    """On ice (mu 0.1) it stays at the foot with spinning wheels; without ice it gets up."""
    with Rehearsal(world=str(ramp(tmp_path, ice))) as stage:
        client = enter(stage, "P2AT", 0.8, 0.0)
        client.send("DRIVE {Left 3.85} {Right 3.85}")
        stage.run(6.0)
        body = body_of(stage)
        assert body.wheel_speeds.min() > 2.0
        if climbs:
            assert body.pose.position[2] > 0.45
        else:
            assert body.pose.position[2] < 0.3
            assert body.pose.position[0] < 2.5


def test_a_world_of_patches_runs_the_same_twice(tmp_path: Path) -> None:
    """Through sand and smoke: equal scripts give equal lines."""
    heard = []
    for _ in range(2):
        with Rehearsal(world="smoke_corridor", seed=4) as stage:
            client = enter(stage, "P2AT", 2.0, 0.1)
            client.send("DRIVE {Left 4.0} {Right 3.0}")
            stage.run(2.0)
            heard.append(client.take())
    assert heard[0] == heard[1]
    assert len(heard[0]) > 20


def test_a_robot_that_asks_for_a_place_outside_starts_inside() -> None:
    """INIT far outside the world, in metres or by mistake in engine units, gives a robot that
    stands on the floor."""
    with Rehearsal(world="smoke_corridor") as stage:
        client = stage.connect()
        client.send("INIT {ClassName USARBot.P2AT} {Location 1e6,120,-2.5}")
        stage.run(3.0)
        x, y, z = body_of(stage).pose.position
        corner = stage.assembly.world.upper[0], stage.assembly.world.lower[1]
        assert (x, y) == pytest.approx(corner, abs=0.01)
        assert 0.0 < z < 1.0
        assert client.take("STA")


@pytest.mark.parametrize("robot", ["AirRobot", "quadrotor", "Passarola"])
def test_aircraft_stay_in_the_world(robot: str) -> None:
    """Whatever direction it is sent, an aircraft ends at the edge of the world's box."""
    with Rehearsal(world="smoke_corridor") as stage:
        client = stage.connect()
        client.send(f"INIT {{ClassName USARBot.{robot}}} {{Location 0,0,-6}}")
        client.send("DRIVE {AltitudeVelocity 2} {LinearVelocity -2} {LateralVelocity 0}")
        stage.run(30.0)
        x, _, z = body_of(stage).pose.position
        assert x == pytest.approx(stage.assembly.world.lower[0], abs=0.1)
        assert z == pytest.approx(stage.assembly.world.upper[2], abs=0.3)
