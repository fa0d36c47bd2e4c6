"""Names of robots, people and objects in a whole world: nobody answers for another."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from usarsim_server.protocol.names import LONGEST_NAME
from usarsim_server.protocol.truth import Position, positions
from usarsim_server.testing import Rehearsal, RehearsedClient


@pytest.fixture
def stage() -> Iterator[Rehearsal]:
    """An empty world."""
    with Rehearsal(world="empty", max_robots=16) as rehearsal:
        yield rehearsal


def start(stage: Rehearsal, name: str, x: float, kind: str = "USARBot.P2AT") -> RehearsedClient:
    """A connection that has sent its INIT."""
    client = stage.connect()
    client.send(f"INIT {{ClassName {kind}}} {{Name {name}}} {{Location {x},0,-0.3}}")
    return client


def labels(stage: Rehearsal) -> list[str]:
    """Names of all robots, in the order of their coming."""
    return [vehicle.name for vehicle in stage.assembly.fleet.vehicles]


def place(stage: Rehearsal, name: str) -> float:
    """x of a robot, m."""
    vehicle = stage.assembly.fleet.find(name)
    state = None if vehicle is None else vehicle.look()
    assert state is not None
    return round(state.pose.position[0], 1)


def test_robots_that_differ_in_case_only_are_told_apart(
    stage: Rehearsal, caplog: pytest.LogCaptureFixture
) -> None:
    """The second gets a number, and orders for the first move the first."""
    start(stage, "Rover", 0.0)
    start(stage, "ROVER", 3.0)
    assert labels(stage) == ["Rover", "ROVER_2"]
    assert any("another name" in message for message in caplog.messages)
    controller = start(stage, "WC", 0.0, "USARBot.WorldController")
    controller.send("CONTROL {Type AbsMove} {Name rover_2} {Location 9,0,-0.3}")
    assert [place(stage, name) for name in labels(stage)] == [0.0, 9.0]
    controller.send("CONTROL {Type AbsMove} {Name rover} {Location -5,0,-0.3}")
    assert [place(stage, name) for name in labels(stage)] == [-5.0, 9.0]


def test_a_name_is_free_again_when_its_robot_has_left(stage: Rehearsal) -> None:
    """In any case of its letters."""
    start(stage, "R1", 0.0).close()
    stage.run(0.1)
    start(stage, "r1", 0.0)
    assert labels(stage) == ["r1"]


def test_a_name_with_fields_in_it_becomes_one_word(
    stage: Rehearsal, caplog: pytest.LogCaptureFixture
) -> None:
    """Nobody forges a place in the lists that others read; the cleaned name is logged."""
    start(stage, "Evil Location 9,9,0 BatteryEmpty False", 1.0)
    start(stage, "Be\x07ll\x85", 3.0)
    assert labels(stage) == ["Evil_Location_9,9,0_BatteryEmpty_False", "Be_ll"]
    assert sum("another name" in message for message in caplog.messages) == 2
    assert stage.assembly.fleet.find("Evil Location 9,9,0 BatteryEmpty False") is not None
    stations = stage.assembly.fleet.stations()
    told = positions(Position(one.name, one.position) for one in stations)
    assert told.count(" Location ") == told.count(" BatteryEmpty ") == 2


def test_a_name_too_long_is_refused_and_the_connection_lives(
    stage: Rehearsal, caplog: pytest.LogCaptureFixture
) -> None:
    """Robots and people; the next INIT of the connection works."""
    for kind in ("USARBot.P2AT", "USARAvatar.USARAvatarNewMale"):
        client = start(stage, "x" * (LONGEST_NAME + 1), 0.0, kind)
        assert labels(stage) == []
        assert sum("INIT failed: the name has 65 characters" in m for m in caplog.messages) == 1
        caplog.clear()
    client.send("INIT {ClassName USARBot.P2AT} {Name " + "x" * LONGEST_NAME + "}")
    assert labels(stage) == ["x" * LONGEST_NAME]
    start(stage, "X" * LONGEST_NAME, 3.0)
    assert labels(stage)[1] == "X" * (LONGEST_NAME - 2) + "_2"


def test_a_class_that_is_spelled_by_the_client_has_to_be_a_name(stage: Rehearsal) -> None:
    """Classes that match a pattern keep the client's spelling: it is told to scoring tools."""
    find = stage.assembly.fleet.describe
    patterns = stage.assembly.fleet._roster._patterns
    assert patterns, "some class answers to a pattern"
    for pattern, _ in patterns:
        assert find(pattern.replace("*", "q7")) is not None
        for text in ("x" * 65_000, "a} {b", "a b", "a\x85b"):
            assert find(pattern.replace("*", text)) is None


def test_objects_and_people_have_clean_names_too(
    stage: Rehearsal, caplog: pytest.LogCaptureFixture
) -> None:
    """CONTROL Create and avatars: one word each, unique; the memory of an object is bounded."""
    caplog.set_level("INFO", "usarsim")
    controller = start(stage, "WC", 0.0, "USARBot.WorldController")
    create = "CONTROL {Type Create} {ClassName USARPhysObj.Box} {Location %d,5,-0.5} {Name %s}"
    controller.send(create % (0, "my box"), create % (2, "MY_BOX"), create % (4, "y" * 65_000))
    controller.send((create % (6, "fat")) + " {Memory " + "m" * 5000 + "}")
    controller.take()
    controller.send("CONTROL {Type GetSTA}")
    (told,) = controller.take("STA")
    assert told.count("{Name ") == 1
    assert "{Name my_box}" in told
    controller.send("CONTROL {Type GetSTA} {Name my box}")
    assert "{Name my_box}" in controller.take("STA")[0]
    assert any("the name has 65000 characters" in message for message in caplog.messages)
    assert any("the memory has 5000 characters" in message for message in caplog.messages)
    kind = "USARAvatar.USARAvatarNewMale"
    start(stage, "Bob Location 1,1,1", 8.0, kind)
    start(stage, "bob_location_1,1,1", 10.0, kind)
    names = [avatar.name for avatar, _ in stage.assembly.roles.avatars.present()]
    assert names == ["Bob_Location_1,1,1", "bob_location_1,1,1_2"]
