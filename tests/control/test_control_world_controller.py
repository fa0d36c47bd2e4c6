"""World controllers, played by hand (protocol reference 3.14, 4.11; checklist 46, 167 to 172)."""

from __future__ import annotations

import math
import random
import re
from collections.abc import Iterator

import pytest

from usarsim_server.testing import Rehearsal, RehearsedClient

HEIGHT = -0.15
"""z of the middle of a Box on the floor."""


@pytest.fixture(scope="module")
def stage() -> Iterator[Rehearsal]:
    """One empty world for all tests of this file."""
    with Rehearsal(world="empty", max_robots=32) as rehearsal:
        yield rehearsal


@pytest.fixture
def client(stage: Rehearsal) -> Iterator[RehearsedClient]:
    """A world controller; whatever it created is gone after the test."""
    connection = controller(stage)
    yield connection
    connection.send("CONTROL {Type GetSTA}")
    connection.close()
    stage.settle()


def controller(stage: Rehearsal, name: str = "USARBot.WorldController") -> RehearsedClient:
    """A new connection that is a world controller."""
    connection = stage.connect()
    connection.send(f"INIT {{ClassName {name}}} {{Name WC}} {{Location 0,0,0}}")
    return connection


def control(client: RehearsedClient, kind: str, **segments: str) -> list[str]:
    """Send one CONTROL; returns the answers."""
    client.take()
    text = " ".join(f"{{{key} {value}}}" for key, value in segments.items())
    client.send(f"CONTROL {{Type {kind}}} {text}")
    return client.take()


def create(client: RehearsedClient, name: str, location: str, **segments: str) -> None:
    """Create a box, or another class."""
    kind = segments.pop("ClassName", "Box")
    assert control(client, "Create", ClassName=kind, Name=name, Location=location, **segments) == []


def status(client: RehearsedClient, **filters: str) -> dict[str, dict[str, str]]:
    """GetSTA as a table by name; the line has to be well formed (171)."""
    (line,) = control(client, "GetSTA", **filters)
    assert re.fullmatch(r"STA( \{[^{}]*\})*", line)
    pairs = [pair.partition(" ")[::2] for pair in re.findall(r"\{([^{}]*)\}", line)]
    assert [key for key, _ in pairs] == (
        ["Name", "Size", "Location", "Memory", "Rotation"] * (len(pairs) // 5)
    )
    rows = [dict(pairs[start : start + 5]) for start in range(0, len(pairs), 5)]
    return {row["Name"]: row for row in rows}


def vector(text: str) -> list[float]:
    """The numbers of a vector as the server prints it."""
    return [float(part) for part in text.split(",")]


def where(client: RehearsedClient, name: str) -> list[float]:
    """Location of an object, wire frame."""
    return vector(status(client, Name=name)[name]["Location"])


def turned(client: RehearsedClient, name: str) -> list[float]:
    """Rotation of an object, wire frame."""
    return vector(status(client, Name=name)[name]["Rotation"])


def near(*place: float, within: float = 2e-3) -> object:
    """A place to compare with; printing cuts digits off."""
    return pytest.approx(place, abs=within)


# -- who may control -------------------------------------------------------------------------------


def test_only_world_controllers_control(stage: Rehearsal, client: RehearsedClient) -> None:
    """Without INIT, and with a robot, CONTROL does nothing and is not answered (167)."""
    nobody, robot = stage.connect(), stage.connect()
    robot.send("INIT {ClassName P2AT} {Location 40,0,-0.3}")
    for one in (nobody, robot):
        one.send("CONTROL {Type Create} {ClassName Box} {Name Sly} {Location 30,0,-0.15}")
        one.send("CONTROL {Type GetSTA}")
        assert one.take("STA {Name") == []
        assert "STA" not in one.take()
    assert status(client) == {}
    robot.close()


@pytest.mark.parametrize(
    "name", ["USARBot.WorldController", "USARBotAPI.WorldController", "worldcontroller"]
)
def test_names_of_the_class(stage: Rehearsal, name: str) -> None:
    """Both packages, none at all, in any case (3.2, 72)."""
    assert status(controller(stage, name)) == {}


def test_a_controller_is_no_robot(stage: Rehearsal, client: RehearsedClient) -> None:
    """It has no body, streams nothing, and ignores what is meant for robots."""
    before = len(stage.assembly.fleet.vehicles)
    stage.run(0.6)
    client.send("DRIVE {Left 1} {Right 1}", "SET {Type INS} {Opcode POSE}", "GETCONF {Type Robot}")
    assert client.take() == []
    client.send("INIT {ClassName P2AT} {Location 0,0,-0.3}")
    assert len(stage.assembly.fleet.vehicles) == before
    client.send("GETSTARTPOSES")
    assert client.take("NFO {StartPoses")


def test_the_command_is_read_tolerantly(client: RehearsedClient) -> None:
    """Case of words, keys and types does not matter; unknown types are not answered (1.6)."""
    client.send("control {TYPE create}{CLASSNAME usarphysobj.BOX}{name a}{LOCATION 1,1,-0.15}")
    client.send("Control {type getsta} {NAME A}")
    assert client.take("STA {Name a}")
    assert control(client, "Explode", Name="a") == []
    assert control(client, "") == []


# -- Create ----------------------------------------------------------------------------------------


def test_create_and_ask(client: RehearsedClient) -> None:
    """What was created is reported with its size, place, memory and rotation (168, 171)."""
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
    """All the shapes of 2.3 put the object at the same place (47 to 50)."""
    create(client, "a", text)
    assert where(client, "a") == near(1, 2, HEIGHT)


def test_an_existing_name_is_left_alone(stage: Rehearsal, client: RehearsedClient) -> None:
    """A second object of a name is refused, whatever its case and whoever asks (169)."""
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


def ahead(robot: RehearsedClient) -> float:
    """What the middle beam of the newest scan says, m."""
    line = [line for line in robot.lines if "{Type RangeScanner}" in line][-1]
    found = re.search(r"\{Range ([^}]*)\}", line)
    assert found is not None
    values = vector(found.group(1))
    return values[len(values) // 2]


# -- Physics ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("physics", "after", "later"),
    [
        ("None", -2.0, -2.0),
        ("", -2.0, -2.0),
        ("Levitation", -2.0, -2.0),
        ("RigidBody", -2.0 + 4.905 * 0.09, HEIGHT),
        ("Falling", -2.0 + 4.905 * 0.09, HEIGHT),
        ("Ground", HEIGHT, HEIGHT),
        ("GROUND", HEIGHT, HEIGHT),
    ],
)
def test_physics(
    stage: Rehearsal, client: RehearsedClient, physics: str, after: float, later: float
) -> None:
    """None hangs, RigidBody and Falling fall, Ground is on the floor at once."""
    create(client, "a", "0,0,-2", Physics=physics)
    stage.run(0.3)
    assert where(client, "a")[2] == pytest.approx(after, abs=0.03)
    stage.run(1.2)
    assert where(client, "a")[2] == pytest.approx(later, abs=3e-3)


def test_ground_and_falling_come_to_rest_on_what_is_below(
    stage: Rehearsal, client: RehearsedClient
) -> None:
    """An object stops on top of another one, and moves there when it is moved over it."""
    create(client, "table", "0,0,-0.375", ClassName="Table")
    create(client, "set", "0.2,0,-3", Physics="Ground")
    create(client, "fell", "-0.3,0,-3", Physics="Falling")
    stage.run(1.5)
    top = -0.75 - 0.15
    assert where(client, "set") == near(0.2, 0, top)
    assert where(client, "fell") == near(-0.3, 0, top)
    control(client, "AbsMove", Name="set", Location="5,0,-1")
    control(client, "AbsMove", Name="fell", Location="6,0,-1")
    assert where(client, "set") == near(5, 0, HEIGHT)
    assert where(client, "fell") == near(6, 0, -1)
    stage.run(1.0)
    assert where(client, "fell") == near(6, 0, HEIGHT)


def test_a_robot_pushes_a_crate(stage: Rehearsal, client: RehearsedClient) -> None:
    """A rigid crate gives way, one without physics does not."""
    create(client, "loose", "21,0,-0.25", ClassName="WCCrate", Physics="RigidBody")
    create(client, "fast", "21,4,-0.25", ClassName="WCCrate")
    robots = [stage.connect() for _ in range(2)]
    for robot, y in zip(robots, (0, 4), strict=True):
        robot.send(f"INIT {{ClassName P2AT}} {{Name R{y}}} {{Location 20,{y},-0.3}}")
        robot.send("DRIVE {Left 3} {Right 3}")
    stage.run(5.0)
    loose, fast = where(client, "loose"), where(client, "fast")
    for robot in robots:
        robot.close()
    stage.run(0.1)
    assert 22.0 < loose[0] < 23.5
    assert loose[2] == pytest.approx(-0.25, abs=0.02)
    assert fast == near(21, 4, -0.25)


def test_what_falls_out_of_the_world_is_gone(stage: Rehearsal, client: RehearsedClient) -> None:
    """A lost object is not reported any more, and its name is free."""
    create(client, "a", "0,0,-1", Physics="RigidBody")
    body = stage.assembly.objects.find("a")
    assert body is not None
    stage.assembly.simulation.remove(body.body)
    stage.settle()
    assert status(client) == {}
    create(client, "a", "1,0,-1")
    assert where(client, "a") == near(1, 0, -1)


# -- moving ----------------------------------------------------------------------------------------


def test_moving(client: RehearsedClient) -> None:
    """AbsMove sets, RelMove adds in world axes; what is not given stays (168)."""
    create(client, "a", "1,0,-1", Rotation="0,0,1.5708")
    control(client, "AbsMove", Name="A", Location="5,6,-2")
    assert where(client, "a") == near(5, 6, -2)
    assert turned(client, "a") == near(0, 0, 1.5708)
    control(client, "AbsMove", Name="a", Rotation="0,0.5,0")
    assert turned(client, "a") == near(0, 0.5, 0)
    assert where(client, "a") == near(5, 6, -2)
    control(client, "RelMove", Name="a", Location="1,0,-0.5", Rotation="0,0,0.25")
    assert where(client, "a") == near(6, 6, -2.5)
    assert turned(client, "a") == near(0, 0.5, 0.25)
    control(client, "RelMove", Name="a")
    assert where(client, "a") == near(6, 6, -2.5)


def test_a_blocked_move_is_refused(client: RehearsedClient) -> None:
    """An object does not go where something is."""
    create(client, "a", "1,0,-0.15")
    create(client, "b", "3,0,-0.15")
    control(client, "AbsMove", Name="a", Location="3.1,0,-0.15")
    assert where(client, "a") == near(1, 0, HEIGHT)


def test_robots_are_moved_by_name(stage: Rehearsal, client: RehearsedClient) -> None:
    """The name of INIT, in any case; a robot whose place is taken stands beside it."""
    robot = stage.connect()
    robot.send("INIT {ClassName P2AT} {Name Rover 7} {Location -20,0,-0.3}")
    stage.run(1.0)
    control(client, "AbsMove", Name="rover 7", Location="-20,10,-0.3", Rotation="0,0,1.5708")
    stage.run(1.0)
    line = [line for line in robot.lines if "{Type GroundTruth}" in line][-1]
    assert "{Location -20.0" in line or "{Location -19.9" in line
    found = re.search(r"\{Orientation ([^}]*)\}", line)
    assert found is not None
    assert vector(found.group(1))[2] == pytest.approx(1.57, abs=0.03)
    create(client, "a", "-20,5,-0.15")
    control(client, "AbsMove", Name="Rover 7", Location="-20,5,-0.3")
    stage.run(1.0)
    state = stage.assembly.fleet.vehicles[-1].look()
    assert state is not None
    x, y, _ = state.pose.position
    assert 0.25 < math.dist((x, -y), (-20, 5)) < 1.5
    robot.close()
    stage.run(0.1)


def test_unknown_names_do_nothing(client: RehearsedClient) -> None:
    """No request about a name that nobody has is answered or does harm."""
    for kind in ("AbsMove", "RelMove", "Rotate", "SetWP", "AddWP", "ClearWP", "Kill", "Conveyor"):
        for segments in ({}, {"Name": "ghost"}, {"Name": "ghost", "Speed": "1", "WP": "1,1,1"}):
            assert control(client, kind, **segments) == []
    assert control(client, "GetSTA", Name="ghost") == ["STA"]


def test_rotation(stage: Rehearsal, client: RehearsedClient) -> None:
    """Rotate turns for ever at rates of roll, pitch and yaw; zero ends it where it is."""
    create(client, "a", "0,0,-1", Rotation="0,0,0.5")
    control(client, "Rotate", Name="a", Speed="0,0,0.5")
    stage.run(2.0)
    assert turned(client, "a") == near(0, 0, 1.5)
    assert where(client, "a") == near(0, 0, -1)
    control(client, "Rotate", Name="a", Speed="0,0,0")
    stage.run(1.0)
    assert turned(client, "a") == near(0, 0, 1.5)
    control(client, "Rotate", Name="a", Speed="0.25,0,0")
    stage.run(2.0)
    assert turned(client, "a") == near(0.5, 0, 1.5)


# -- paths -----------------------------------------------------------------------------------------


def test_a_path_takes_simulated_time(stage: Rehearsal, client: RehearsedClient) -> None:
    """Way points are passed at the speed told, and the object stops at the last one."""
    create(client, "a", "0,0,-0.15")
    control(client, "SetWP", Name="a", Speed="0.5")
    control(client, "AddWP", Name="a", WP="1,0,-0.15; 1, 1, -0.15")
    control(client, "AddWP", Name="a", WP="1,2,-1.15")
    stage.run(1.0)
    assert where(client, "a") == near(0.5, 0, HEIGHT)
    stage.run(2.0)
    assert where(client, "a") == near(1, 0.5, HEIGHT)
    stage.run(10.0)
    assert where(client, "a") == near(1, 2, -1.15)


@pytest.mark.parametrize(
    ("text", "goes_round"),
    [("true", True), ("True", True), ("TRUE", True), ("1", True), ("false", False), ("x", False)],
)
def test_loop(stage: Rehearsal, client: RehearsedClient, text: str, goes_round: bool) -> None:
    """With Loop the object goes back to its first way point and round again (46)."""
    create(client, "a", "0,0,-0.15")
    control(client, "SetWP", Name="a", Speed="2", Loop=text)
    control(client, "AddWP", Name="a", WP="1,0,-0.15;1,1,-0.15;0,1,-0.15;0,0,-0.15")
    stage.run(2.25)
    first, second = ((0.5, 0), (1, 0.5)) if goes_round else ((0, 0), (0, 0))
    assert where(client, "a") == near(*first, HEIGHT, within=0.01)
    stage.run(0.5)
    assert where(client, "a") == near(*second, HEIGHT, within=0.01)


def test_standing_time_and_the_way_back(stage: Rehearsal, client: RehearsedClient) -> None:
    """Moving stops and goes on, Time jumps along the path, ResetOnClear leads home."""
    create(client, "a", "0,0,-0.15")
    control(client, "AddWP", Name="a", WP="10,0,-0.15")
    stage.run(1.0)
    control(client, "SetWP", Name="a", Moving="false")
    stage.run(1.0)
    assert where(client, "a") == near(1, 0, HEIGHT)
    control(client, "SetWP", Name="a", Time="4", Speed="2", Moving="true", ResetOnClear="1")
    assert where(client, "a") == near(8, 0, HEIGHT)
    stage.run(0.5)
    assert where(client, "a") == near(9, 0, HEIGHT)
    control(client, "ClearWP", Name="a")
    assert where(client, "a") == near(0, 0, HEIGHT)
    control(client, "AddWP", Name="a", WP="0,3,-0.15")
    control(client, "SetWP", Name="a", ResetOnClear="false", Speed="1")
    stage.run(1.0)
    control(client, "ClearWP", Name="a")
    stage.run(1.0)
    assert where(client, "a") == near(0, 1, HEIGHT)


def test_moved_on_its_path_it_goes_on(stage: Rehearsal, client: RehearsedClient) -> None:
    """AbsMove on the way changes the place, not the errand; rotation goes on, too."""
    create(client, "a", "0,0,-1")
    control(client, "AddWP", Name="a", WP="2,0,-1")
    control(client, "Rotate", Name="a", Speed="0,0,0.5")
    stage.run(1.0)
    control(client, "AbsMove", Name="a", Location="2,2,-1")
    stage.run(1.0)
    assert where(client, "a") == near(2, 1, -1)
    assert turned(client, "a") == near(0, 0, 1.0)
    stage.run(1.0)
    assert where(client, "a") == near(2, 0, -1)


def test_a_rigid_object_on_a_path(stage: Rehearsal, client: RehearsedClient) -> None:
    """While it has way points it goes its way in the air; then forces move it again."""
    create(client, "a", "0,0,-0.15", Physics="RigidBody")
    control(client, "AddWP", Name="a", WP="1,0,-1.15")
    stage.run(3.0)
    assert where(client, "a") == near(1, 0, -1.15)
    control(client, "ClearWP", Name="a")
    stage.run(1.5)
    assert where(client, "a") == near(1, 0, HEIGHT, within=0.01)
    assert len(status(client)) == 1


def test_an_object_on_a_path_pushes_a_robot(stage: Rehearsal, client: RehearsedClient) -> None:
    """What stands in the way is shoved along."""
    robot = stage.connect()
    robot.send("INIT {ClassName P2AT} {Location -10,0,-0.3}")
    stage.run(1.0)
    create(client, "a", "-11.5,0,-0.25", ClassName="WCCrate")
    control(client, "SetWP", Name="a", Speed="0.5")
    control(client, "AddWP", Name="a", WP="-9.5,0,-0.25")
    stage.run(5.0)
    state = stage.assembly.fleet.vehicles[-1].look()
    robot.close()
    stage.run(0.1)
    assert where(client, "a") == near(-9.5, 0, -0.25)
    assert state is not None
    assert state.pose.position[0] > -9.5 + 0.25 + 0.15


@pytest.mark.parametrize("points", ["", ";;", "1e9,0,0", "0,0,99999;1,0,0"])
def test_silly_way_points(stage: Rehearsal, client: RehearsedClient, points: str) -> None:
    """Nothing, or a place outside the world: the object stays where it is."""
    create(client, "a", "0,0,-0.15")
    control(client, "AddWP", Name="a", WP=points)
    control(client, "SetWP", Name="a", Speed="1e9")
    stage.run(0.5)
    assert where(client, "a") == near(0, 0, HEIGHT)


# -- removing --------------------------------------------------------------------------------------


def test_kill(stage: Rehearsal, client: RehearsedClient) -> None:
    """Kill removes one object, whoever created it, permanent or not (168)."""
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
    """Only what is strictly inside goes, whichever corners are given (170)."""
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
    """Objects leave with the connection that created them, and only they (172)."""
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
    """With clean_on_close = false they stay, for everybody to use (172)."""
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


def test_sensors_see_objects(stage: Rehearsal, client: RehearsedClient) -> None:
    """A laser measures the true distance to an object, and nothing once it is gone."""
    robot = stage.connect()
    robot.send("INIT {ClassName P2AT} {Location 60,0,-0.3}")
    stage.run(1.0)
    far = ahead(robot)
    assert far > 10.0
    create(client, "a", "64,0,-0.6", ClassName="Wall")
    stage.run(0.5)
    seen = ahead(robot)
    control(client, "RelMove", Name="a", Location="1,0,0")
    stage.run(0.5)
    assert ahead(robot) - seen == pytest.approx(1.0, abs=0.05)
    control(client, "Kill", Name="a")
    stage.run(0.5)
    assert ahead(robot) == pytest.approx(far, abs=0.1)
    robot.close()
    stage.run(0.1)


def test_facts_about_objects_bear_their_names(stage: Rehearsal, client: RehearsedClient) -> None:
    """Sensors that recognise objects are told the name of the object."""
    create(client, "Target", "0,0,-0.15", Material="Red")
    found = stage.assembly.objects.find("target")
    assert found is not None
    snapshot = stage.assembly.simulation.look()
    layout = snapshot.layouts[found.body]
    facts = stage.assembly.fleet.object_facts(f"robot{layout.slot}:base", snapshot)
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
    kinds = (
        "Create Create Create Kill KillAll AbsMove RelMove Rotate SetWP AddWP ClearWP GetSTA"
    ).split()
    values = (
        "0,0,0|1,2,-3|nan,inf,-inf|1e30,0,0|-1,-1,-0.5|true|RigidBody|Falling|Ground|a|b|c|Ball|Box"
        "|Pallet|TrafficCone|0.5,2,1|5|-5|0|;;|1,1,-1;2,2,-1|x}y|{"
    ).split("|")
    keys = (
        "ClassName Name Location Rotation Scale Physics Permanent Material Memory MinPos MaxPos "
        "Speed Loop Moving ResetOnClear Time WP Start"
    ).split()
    for _ in range(150):
        chosen = chance.sample(keys, 6)
        segments = [f"{{{key} {chance.choice(values)}}}" for key in ("ClassName", "Name", *chosen)]
        client.send(f"CONTROL {{Type {chance.choice(kinds)}}} {' '.join(segments)}")
        stage.run(0.02)
    for line in client.take():
        assert re.fullmatch(r"STA( \{[^{}]*\})*", line)
        assert not re.search(r"nan|inf|\de[+-]?\d", line.replace("{Memory nan,inf,-inf}", ""))
    create(client, "after all", "50,50,-0.15")
    assert where(client, "after all") == near(50, 50, HEIGHT)


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
