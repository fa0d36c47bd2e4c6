"""The plant in play: robots go through its doors, ride its lift and its belts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.testing import Rehearsal, RehearsedClient


@pytest.fixture
def stage() -> Iterator[Rehearsal]:
    """The plant."""
    with Rehearsal(world="plant") as rehearsal:
        yield rehearsal


def robot(stage: Rehearsal, location: str, speed: float = 0.0) -> RehearsedClient:
    """A P2AT at a place of the wire frame, heading along x, with its wheels at rad/s."""
    client = stage.connect()
    client.send(f"INIT {{ClassName USARBot.P2AT}} {{Location {location}}}")
    if speed:
        client.send(f"DRIVE {{Left {speed}}} {{Right {speed}}}")
    return client


def poses(stage: Rehearsal) -> list[Pose]:
    """Poses of the robots in the order of their coming."""
    simulation = stage.assembly.simulation
    snapshot = simulation.look()
    states = [simulation.body(robot).state(snapshot) for robot in sorted(snapshot.layouts)]
    return [state.pose for state in states if state is not None]


def ahead(stage: Rehearsal) -> tuple[float, str | None]:
    """What a ray meets that goes through the sliding door from 0.8 m before it."""
    simulation = stage.assembly.simulation
    fan = RayFan(
        np.array([-3.8, 2.3, 1.2]), np.array([[1.0, 0.0, 0.0]]), max_range=50.0, identify=True
    )
    (hits,) = simulation.cast([fan], simulation.look(), None)
    assert hits.names is not None
    return float(hits.distances[0]), hits.names[0]


def test_a_robot_goes_through_the_sliding_door(stage: Rehearsal) -> None:
    """The leaves make way for a robot that comes, rays see them go, and they close behind it."""
    distance, name = ahead(stage)
    assert distance == pytest.approx(0.775, abs=0.01)
    assert name == "gate_left"
    robot(stage, "-4.9,-2.0,-0.2", speed=6.0)
    stage.run(2.5)
    assert ahead(stage)[0] > 5.0
    stage.run(4.0)
    (pose,) = poses(stage)
    assert pose.position[0] > -1.6
    assert pose.position[1] == pytest.approx(2.0, abs=0.05)
    stage.run(5.0)
    assert ahead(stage)[1] == "gate_left"


def test_the_lift_takes_a_robot_to_the_mezzanine(stage: Rehearsal) -> None:
    """A robot that stands on the platform is taken up 1.18 m and drives off onto the floor."""
    client = robot(stage, "4.9,-2.0,-0.25")
    stage.run(1.5)
    low = poses(stage)[0].position[2]
    stage.run(6.0)
    assert poses(stage)[0].position[2] - low == pytest.approx(1.18, abs=0.003)
    client.send("DRIVE {Left 6.0} {Right 6.0}")
    stage.run(3.0)
    x, y, z = poses(stage)[0].position
    assert x > 6.2
    assert y == pytest.approx(2.0, abs=0.05)
    assert z - low == pytest.approx(1.18, abs=0.003)


def test_the_walkway_carries_at_its_speed(stage: Rehearsal) -> None:
    """A robot with its brakes on is carried at 0.4 m/s; CONTROL Conveyor turns the belt round."""
    robot(stage, "1.0,4.4,-0.25")
    stage.run(1.0)
    start = poses(stage)[0].position[0]
    stage.run(2.0)
    assert poses(stage)[0].position[0] - start == pytest.approx(0.8, abs=0.01)
    control = stage.connect()
    control.send("INIT {ClassName USARBotAPI.WorldController}")
    control.send("CONTROL {Type Conveyor} {Name walkway} {Speed -0.5}")
    stage.run(1.0)
    start = poses(stage)[0].position[0]
    stage.run(2.0)
    assert poses(stage)[0].position[0] - start == pytest.approx(-0.4, abs=0.01)


def test_an_avatar_goes_through_the_sliding_door(stage: Rehearsal) -> None:
    """Leaves are no walls to who plans a way, and the door opens for people, too."""
    avatar = stage.connect()
    avatar.send("INIT {ClassName USARAvatar.USARAvatarNewMale} {Location -6.0,-2.0,-1.0} {Name W}")
    avatar.send("GOTO {Name Gate}")
    stage.run(3.0)
    assert ahead(stage)[0] > 5.0
    stage.run(2.0)
    assert poses(stage)[0].position[0] == pytest.approx(-1.9, abs=0.1)


def test_runs_repeat() -> None:
    """Two runs with a robot under way end in the same state, bit for bit."""
    ends = []
    for _ in range(2):
        with Rehearsal(world="plant") as stage:
            robot(stage, "-4.9,-2.0,-0.2", speed=6.0)
            stage.run(3.0)
            snapshot = stage.assembly.simulation.look()
            ends.append((snapshot.qpos.tobytes(), snapshot.xpos.tobytes()))
    assert ends[0] == ends[1]
