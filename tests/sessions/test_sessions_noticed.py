"""What sensors notice of avatars and of objects that world controllers have made."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from control_harness import controller, create

from usarsim_server.testing import Rehearsal, RehearsedClient

SOCCER = """name = "Soccer"
extends = "P2AT"

[[sensor]]
type = "Helper"
name = "Ball"
position = [0.0, 0.0, 0.3]
"""
WATCH_AT = "0,0,-0.25"


@pytest.fixture
def stage() -> Iterator[Rehearsal]:
    """An empty world."""
    with Rehearsal(world="empty") as rehearsal:
        yield rehearsal


def watcher(stage: Rehearsal) -> RehearsedClient:
    """A robot with all sensors of life, looking along x."""
    client = stage.connect()
    client.send(f"INIT {{ClassName USARBot.RescueP2AT}} {{Location {WATCH_AT}}}")
    return client


def avatar(stage: Rehearsal, location: str, name: str = "W") -> RehearsedClient:
    """Somebody who stands."""
    client = stage.connect()
    client.send(f"INIT {{ClassName USARAvatar.Worker}} {{Location {location}}} {{Name {name}}}")
    return client


def readings(client: RehearsedClient, kind: str, key: str) -> list[str]:
    """Values of a key in all lines of a type since the last call."""
    lines = [line for line in client.lines if f"{{Type {kind}}}" in line]
    return [found for line in lines for found in re.findall(rf"{{{key} ([^}}]*)}}", line)]


def likely(client: RehearsedClient) -> list[float]:
    """What HumanMotion said."""
    return [float(value) for value in readings(client, "HumanMotion", "Prob")]


def test_who_walks_past_is_noticed(stage: Rehearsal) -> None:
    """An avatar that stands gives 0, one that walks past does not, one that has stopped is 0."""
    robot, person = watcher(stage), avatar(stage, "3,-2,-1")
    stage.run(2.0)
    assert set(likely(robot)) == {0.0}
    robot.take()
    person.send("MOVE {Location 3,2}")
    stage.run(3.0)
    # At 1.3 m/s he is as fast as a sensor wants; 3 of 5 m away he is 40 % likely.
    assert max(likely(robot)) == pytest.approx(0.4, abs=0.12)
    stage.run(3.0)
    robot.take()
    stage.run(1.0)
    assert likely(robot)
    assert set(likely(robot)) == {0.0}


def test_walls_hide_who_walks(stage: Rehearsal) -> None:
    """Behind a wall that a controller has put up nobody is noticed."""
    create(controller(stage), "Screen", "1.5,0,-1", Scale="0.2,20,7")
    robot, person = watcher(stage), avatar(stage, "3,-2,-1")
    person.send("MOVE {Location 3,2}")
    stage.run(4.0)
    assert likely(robot)
    assert set(likely(robot)) == {0.0}


def test_breath_of_avatars(stage: Rehearsal) -> None:
    """Who stands near adds to the CO2, and no more when gone."""
    robot = watcher(stage)
    stage.run(1.6)
    before = float(readings(robot, "CO2Sensor", "Density")[-1])
    person = avatar(stage, "0.75,0,-1")
    robot.take()
    stage.run(1.0)
    near = float(readings(robot, "CO2Sensor", "Density")[-1])
    person.close()
    stage.run(0.5)
    robot.take()
    stage.run(1.0)
    after = float(readings(robot, "CO2Sensor", "Density")[-1])
    assert near > before
    assert after == before


def test_avatars_are_no_victims(stage: Rehearsal) -> None:
    """The victim sensor finds victims, as the original did, and nobody else who is about."""
    robot = watcher(stage)
    avatar(stage, "2,0,-1")
    stage.run(4.0)
    assert set(readings(robot, "VictSensor", "Status")) == {"NoVictims"}
    assert readings(robot, "VictRFID", "VictimName") == []


def test_runs_with_passers_repeat() -> None:
    """Two runs give the same lines."""
    said = []
    for _ in range(2):
        with Rehearsal(world="empty", seed=3) as stage:
            robot, person = watcher(stage), avatar(stage, "3,-2,-1")
            person.send("MOVE {Location 3,2}")
            stage.run(3.0)
            said.append(robot.take("SEN"))
    assert said[0] == said[1]
    assert said[0]


def test_a_ball_of_a_controller_is_a_ball(tmp_path: Path) -> None:
    """The ball helper finds what a world controller calls ball, where it is then."""
    (tmp_path / "Soccer.toml").write_text(SOCCER, encoding="utf-8")
    with Rehearsal(world="empty", robots=(tmp_path,)) as stage:
        client = stage.connect()
        client.send(f"INIT {{ClassName USARBot.Soccer}} {{Location {WATCH_AT}}}")
        stage.run(2.0)
        assert readings(client, "Helper", "Pos3D") == []
        create(controller(stage), "Ball", "2,1,-0.15")
        stage.run(1.0)
        places = readings(client, "Helper", "Pos3D")
        assert places[-1] == "2.00,1.00,-0.15"
        assert readings(client, "Helper", "Visible")[-1] == "true"
