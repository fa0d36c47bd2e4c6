"""World controllers: objects come, are asked for and go (protocol 3.14, 4.11, 46, 167 to 172)."""

from __future__ import annotations

import random
import re

import pytest
from control_harness import (
    HEIGHT,
    avatar,
    control,
    controller,
    create,
    near,
    status,
    statuses,
    where,
)

from usarsim_server.testing import Rehearsal, RehearsedClient

# -- who may control -------------------------------------------------------------------------------


def test_only_world_controllers_control(stage: Rehearsal, client: RehearsedClient) -> None:
    """Without INIT, and with a robot, CONTROL does nothing and is not answered (protocol 167)."""
    nobody, robot = stage.connect(), stage.connect()
    robot.send("INIT {ClassName P2AT} {Location 40,0,-0.3}")
    for one in (nobody, robot):
        one.send("CONTROL {Type Create} {ClassName Box} {Name Sly} {Location 30,0,-0.15}")
        one.send("CONTROL {Type GetSTA}")
        assert one.take("STA {Name") == []
        assert "STA" not in one.take()
    assert status(client) == {}


@pytest.mark.parametrize(
    "name", ["USARBot.WorldController", "USARBotAPI.WorldController", "worldcontroller"]
)
def test_names_of_the_class(stage: Rehearsal, name: str) -> None:
    """Both packages, none at all, in any case (protocol 3.2, 72)."""
    assert status(controller(stage, name)) == {}


def test_a_controller_is_no_robot(stage: Rehearsal, client: RehearsedClient) -> None:
    """It has no body, streams nothing, and ignores what is meant for robots."""
    before = len(stage.assembly.robots.vehicles)
    stage.run(0.6)
    client.send("DRIVE {Left 1} {Right 1}", "SET {Type INS} {Opcode POSE}", "GETCONF {Type Robot}")
    assert client.take() == []
    client.send("INIT {ClassName P2AT} {Location 0,0,-0.3}")
    assert len(stage.assembly.robots.vehicles) == before
    client.send("GETSTARTPOSES")
    assert client.take("NFO {StartPoses")


def test_the_command_is_read_tolerantly(client: RehearsedClient) -> None:
    """Case of words, keys and types does not matter; unknown types are not answered
    (protocol 1.6)."""
    client.send("control {TYPE create}{CLASSNAME usarphysobj.BOX}{name a}{LOCATION 1,1,-0.15}")
    client.send("Control {type getsta} {NAME A}")
    assert client.take("STA {Name a}")
    assert control(client, "Explode", Name="a") == []
    assert control(client, "") == []


# -- Create ----------------------------------------------------------------------------------------


def test_create_and_ask(client: RehearsedClient) -> None:
    """What was created is reported with its size, place, memory and rotation (protocol 168,
    171)."""
    create(client, "Box3", "3.1, 0.2, -0.15", Rotation="0, 0, 0.7854", Memory="red one")
    assert status(client) == {
        "Box3": {
            "Name": "Box3",
            "Size": "0.3000,0.3000,0.3000",
            "Location": "3.1000,0.2000,-0.1500",
            "Memory": "red one",
            "Rotation": "0.0000,0.0000,0.7854",
        }
    }


@pytest.mark.parametrize(
    "text", ["1,2,-0.15", "1, 2, -0.15", "1.0 2.0 -0.15", " 1,2,-.15 ", "1,0 2,0 -0,15"]
)
def test_spellings_of_vectors(client: RehearsedClient, text: str) -> None:
    """All the shapes of protocol 2.3 put the object at the same place (protocol 47 to 50)."""
    create(client, "a", text)
    assert where(client, "a") == near(1, 2, HEIGHT)


def test_an_existing_name_is_left_alone(stage: Rehearsal, client: RehearsedClient) -> None:
    """A second object of a name is refused, whatever its case and whoever asks (protocol 169)."""
    create(client, "a", "1,0,-0.15", Memory="first")
    create(client, "A", "3,0,-0.15", Memory="second")
    other = controller(stage)
    create(other, "a", "5,0,-0.15", Memory="third")
    assert [row["Memory"] for row in status(client).values()] == ["first"]
    assert where(other, "a") == near(1, 0, HEIGHT)


def test_without_a_name_one_is_invented(client: RehearsedClient) -> None:
    """Objects without a name are told apart all the same."""
    for x in range(3):
        control(client, "Create", ClassName="Box", Location=f"{x},0,-0.15")
    assert len(status(client)) == 3


@pytest.mark.parametrize(
    "wish",
    [
        {"ClassName": "NoSuchThing", "Location": "0,5,-1"},
        {"ClassName": "", "Location": "0,5,-1"},
        {"Location": "0,5,-1"},
        {"ClassName": "Box", "Location": "9,9,-0.15"},
        {"ClassName": "Box", "Location": "9.2,9,-0.15", "Physics": "RigidBody"},
        {"ClassName": "Box", "Location": "1e9,0,0"},
        {"ClassName": "Box", "Location": "0,5,-1", "Scale": "1000,1,1"},
        {"ClassName": "Box", "Location": "0,5,-1", "Scale": "20,1,1", "Physics": "RigidBody"},
        {"ClassName": "Box", "Start": "Nowhere"},
    ],
)
def test_refusals_are_silent(client: RehearsedClient, wish: dict[str, str]) -> None:
    """Unknown classes, blocked places, silly sizes: no answer, no object, and life goes on."""
    create(client, "there", "9,9,-0.15")
    assert control(client, "Create", Name="a", **wish) == []
    assert list(status(client)) == ["there"]
    create(client, "a", "0,0,-0.15")
    assert len(status(client)) == 2


def test_a_robot_blocks_a_place(stage: Rehearsal, client: RehearsedClient) -> None:
    """Nothing is created inside a robot, nor a robot inside an object."""
    robot = stage.connect()
    robot.send("INIT {ClassName P2AT} {Location 20,0,-0.3}")
    stage.run(0.5)
    create(client, "a", "20,0,-0.15")
    assert status(client) == {}
    robot.close()
    stage.run(0.1)
    create(client, "a", "20,0,-0.15")
    assert where(client, "a") == near(20, 0, HEIGHT)


@pytest.mark.parametrize(
    ("scale", "size"),
    [
        ("2,1,0.5", "0.6000,0.3000,0.1500"),
        ("0,0,0", "0.3000,0.3000,0.3000"),
        ("2,0,0", "0.6000,0.3000,0.3000"),
        ("-2,1,1", "0.6000,0.3000,0.3000"),
        ("", "0.3000,0.3000,0.3000"),
    ],
)
def test_scale(client: RehearsedClient, scale: str, size: str) -> None:
    """Factors along the axes; 0 and missing ones are 1; sizes are positive."""
    create(client, "a", "0,0,-2", Scale=scale)
    assert status(client)["a"]["Size"] == size


def test_start_wins_over_location(stage: Rehearsal, client: RehearsedClient) -> None:
    """Start names a start pose of the world."""
    create(client, "a", "9,9,-5", Start="robotSTART2")
    start = stage.assembly.world.start("RobotStart2")
    assert start is not None
    x, y, _ = start.pose.position
    assert where(client, "a")[:2] == near(x, -y)


def test_materials(client: RehearsedClient) -> None:
    """A known material is taken, whatever its case; an unknown one does no harm."""
    create(client, "a", "2,0,-0.6", ClassName="Wall", Material="GLASS")
    create(client, "b", "4,0,-0.6", ClassName="Wall", Material="Unobtainium")
    assert len(status(client)) == 2


# -- removing --------------------------------------------------------------------------------------


def test_kill(stage: Rehearsal, client: RehearsedClient) -> None:
    """Kill removes one object, whoever created it, permanent or not (protocol 168)."""
    other = controller(stage)
    create(other, "a", "0,0,-0.15", Permanent="true")
    create(client, "b", "2,0,-0.15")
    control(client, "Kill", Name="A")
    assert control(client, "GetSTA", Name="a") == ["STA"]
    assert list(status(client)) == ["b"]
    create(client, "a", "0,0,-0.15")
    assert len(status(client)) == 2


def test_kill_all(client: RehearsedClient) -> None:
    """Without a box everything goes that is not permanent."""
    for n, permanent in enumerate(("true", "false", "1", "0", "")):
        create(client, f"o{n}", f"{n},0,-0.15", Permanent=permanent)
    control(client, "KillAll")
    assert list(status(client)) == ["o0", "o2"]


@pytest.mark.parametrize(
    ("one", "other"),
    [("0,0,-2", "4,4,0"), ("4,4,0", "0,0,-2"), ("0,4,0", "4,0,-2"), ("4, 0, -2", "0, 4, 0")],
)
def test_kill_all_in_a_box(client: RehearsedClient, one: str, other: str) -> None:
    """Only what is strictly inside goes, whichever corners are given (protocol 170)."""
    places = {"in": "2,2,-1", "high": "2,2,-3", "far": "5,2,-1", "edge": "4,2,-1", "kept": "1,1,-1"}
    for name, place in places.items():
        create(client, name, place, Scale="0.1,0.1,0.1", Permanent=str(name == "kept"))
    control(client, "KillAll", MinPos=one, MaxPos=other)
    assert set(status(client)) == {"high", "far", "edge", "kept"}


def test_half_a_box_is_no_box(client: RehearsedClient) -> None:
    """A KillAll with one corner only removes nothing."""
    create(client, "a", "0,0,-0.15")
    control(client, "KillAll", MinPos="-1,-1,-1")
    control(client, "KillAll", MaxPos="1,1,1")
    assert len(status(client)) == 1


def test_closing_cleans_up(stage: Rehearsal, client: RehearsedClient) -> None:
    """Objects leave with the connection that created them, and only they (protocol 172)."""
    other = controller(stage)
    create(client, "mine", "0,0,-0.15")
    create(other, "fixed", "2,0,-0.15", Permanent="true")
    create(other, "loose", "4,0,-0.15", Physics="RigidBody")
    control(other, "AddWP", Name="loose", WP="9,9,-0.15")
    assert len(status(client)) == 3
    other.close()
    stage.settle()
    assert list(status(client)) == ["mine"]
    stage.run(0.1)
    assert len(stage.assembly.simulation.look().layouts) == 1


def test_cleaning_can_be_switched_off() -> None:
    """With clean_on_close = false they stay, for everybody to use (protocol 172)."""
    with Rehearsal(world="empty", clean_on_close=False) as stage:
        one = controller(stage)
        create(one, "a", "0,0,-0.15")
        one.close()
        stage.settle()
        other = controller(stage)
        assert list(status(other)) == ["a"]
        control(other, "KillAll")
        assert status(other) == {}


# -- asking ----------------------------------------------------------------------------------------


def test_filters(client: RehearsedClient) -> None:
    """By name, by class with or without package, by alias, by both; in any case."""
    create(client, "a", "0,0,-0.5", ClassName="USARPhysObj.WCCrate")
    create(client, "b", "2,0,-0.15", ClassName="Box")
    assert list(status(client, Name="B")) == ["b"]
    for kind in ("WCCrate", "usarphysobj.wccrate", "Crate"):
        assert list(status(client, ClassName=kind)) == ["a"]
    assert status(client, Name="b", ClassName="WCCrate") == {}
    assert status(client, ClassName="Pallet") == {}


def test_facts_about_objects_bear_their_names(stage: Rehearsal, client: RehearsedClient) -> None:
    """Sensors that recognise objects are told the name of the object."""
    create(client, "Target", "0,0,-0.15", Material="Red")
    found = stage.assembly.roles.objects.find("target")
    assert found is not None
    snapshot = stage.assembly.simulation.look()
    layout = snapshot.layouts[found.body]
    facts = stage.assembly.robots.object_facts(f"robot{layout.slot}:base", snapshot)
    assert facts is not None
    assert (facts.name, facts.material) == ("Target", "Red")


# -- the whole -------------------------------------------------------------------------------------


def test_a_full_world_refuses() -> None:
    """max_objects is kept."""
    with Rehearsal(world="empty", max_objects=2) as stage:
        client = controller(stage)
        for n in range(4):
            create(client, f"o{n}", f"{n},0,-0.15")
        assert list(status(client)) == ["o0", "o1"]
        control(client, "Kill", Name="o0")
        create(client, "o9", "9,0,-0.15")
        assert list(status(client)) == ["o1", "o9"]


def test_random_requests_do_no_harm(stage: Rehearsal, client: RehearsedClient) -> None:
    """Whatever segments a CONTROL has, the next one is obeyed and every line is well formed."""
    chance = random.Random(11)
    kinds = [
        "Create",
        "Create",
        "Create",
        "Kill",
        "KillAll",
        "AbsMove",
        "RelMove",
        "Rotate",
        "SetWP",
        "AddWP",
        "ClearWP",
        "GetSTA",
    ]
    values = [
        "0,0,0",
        "1,2,-3",
        "nan,inf,-inf",
        "1e30,0,0",
        "-1,-1,-0.5",
        "true",
        "RigidBody",
        "Falling",
        "Ground",
        "a",
        "b",
        "c",
        "Ball",
        "Box",
        "Pallet",
        "TrafficCone",
        "0.5,2,1",
        "5",
        "-5",
        "0",
        ";;",
        "1,1,-1;2,2,-1",
        "x}y",
        "{",
    ]
    keys = [
        "ClassName",
        "Name",
        "Location",
        "Rotation",
        "Scale",
        "Physics",
        "Permanent",
        "Material",
        "Memory",
        "MinPos",
        "MaxPos",
        "Speed",
        "Loop",
        "Moving",
        "ResetOnClear",
        "Time",
        "WP",
        "Start",
    ]
    for _ in range(150):
        chosen = chance.sample(keys, 6)
        segments = [f"{{{key} {chance.choice(values)}}}" for key in ("ClassName", "Name", *chosen)]
        client.send(f"CONTROL {{Type {chance.choice(kinds)}}} {' '.join(segments)}")
        stage.run(0.02)
    for line in client.take():
        assert re.fullmatch(r"STA( \{[^{}]*\})*", line)
        assert not re.search(r"nan|inf|\de[+-]?\d", line.replace("{Memory nan,inf,-inf}", ""))
    create(client, "after_all", "50,50,-0.15")
    assert where(client, "after_all") == near(50, 50, HEIGHT)


def play() -> list[str]:
    """A scene with everything that moves; returns all lines of all clients."""
    with Rehearsal(world="empty") as stage:
        client, robot = controller(stage), stage.connect()
        robot.send("INIT {ClassName P2AT} {Location 0,0,-0.3}", "DRIVE {Left 3} {Right 2.8}")
        create(client, "crate", "1,0,-0.25", ClassName="WCCrate", Physics="RigidBody")
        create(client, "ball", "1.6,0.3,-2", ClassName="Ball", Physics="RigidBody")
        create(client, "round", "2,1,-0.15")
        control(client, "SetWP", Name="round", Speed="1.3", Loop="true")
        control(client, "AddWP", Name="round", WP="3,1,-0.15;3,-1,-0.15;2,-1,-0.15;2,1,-0.15")
        control(client, "Rotate", Name="round", Speed="0,0,2")
        lines = []
        for _ in range(16):
            stage.run(0.25)
            lines += control(client, "GetSTA")
        return lines + robot.lines


def test_runs_repeat_bit_for_bit() -> None:
    """The same script gives the same lines, twice."""
    first, second = play(), play()
    assert len(first) > 50
    assert first == second


@pytest.mark.parametrize(
    ("kind", "segments"),
    [
        ("Rotate", {"Speed": "1,0,0"}),
        ("AddWP", {"WP": "3,3,-1"}),
        ("SetWP", {"Speed": "2"}),
        ("ClearWP", {}),
        ("AbsMove", {"Location": "4,4,-1"}),
    ],
)
def test_what_has_just_left_is_no_trouble(
    stage: Rehearsal, client: RehearsedClient, kind: str, segments: dict[str, str]
) -> None:
    """An object that the physics took away a moment ago is refused, and the controller lives."""
    create(client, "a", "1,0,-0.15", Physics="RigidBody")
    control(client, "AddWP", Name="a", WP="2,0,-0.15")
    found = stage.assembly.roles.objects.find("a")
    assert found is not None
    stage.assembly.simulation.remove(found.body)
    stage.settle()
    assert control(client, kind, Name="a", **segments) == []
    create(client, "a", "1,0,-0.15")
    assert where(client, "a") == near(1, 0, HEIGHT)


def test_a_second_init_can_change_the_role() -> None:
    """With second_init=replace a controller becomes a robot and a robot an avatar
    (protocol 1.1)."""
    with Rehearsal(world="empty", second_init="replace") as stage:
        client = controller(stage)
        create(client, "a", "5,0,-0.15")
        client.send("INIT {ClassName P2AT} {Location 0,0,-0.3}")
        stage.run(0.5)
        assert client.take("STA {Type GroundVehicle}")
        assert stage.assembly.roles.objects.present() == []
        client.send("INIT {ClassName USARAvatar.Worker} {Location 0,3,-1}")
        stage.run(0.5)
        assert "{Type USARAvatarWorker}" in client.take("STA")[-1]
        assert stage.assembly.robots.vehicles == ()
        client.send("INIT {ClassName USARBot.WorldController}")
        assert status(client) == {}
        assert stage.assembly.roles.avatars.present() == []


def test_controllers_and_avatars_together(stage: Rehearsal) -> None:
    """An avatar is no object: it is neither listed nor removed, and blocks a place."""
    wc, client = controller(stage), avatar(stage, "50,0,-1", Name="Walker")
    stage.run(0.4)
    assert control(wc, "GetSTA") == ["STA"]
    control(wc, "Create", ClassName="Box", Name="b", Location="50,0,-0.9")
    assert control(wc, "GetSTA") == ["STA"]
    control(wc, "KillAll")
    assert statuses(client)
    assert [one.name for one, _ in stage.assembly.roles.avatars.present()] == ["Walker"]
