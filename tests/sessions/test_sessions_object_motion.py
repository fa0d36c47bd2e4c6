"""Objects of world controllers: physics, moving, rotation and paths (protocol 3.14, 46, 168), and
what sensors notice of them and of avatars.
"""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path

import pytest
from control_harness import (
    HEIGHT,
    ahead,
    control,
    controller,
    create,
    near,
    status,
    turned,
    vector,
    where,
)

from usarsim_server.base.files import data_directory
from usarsim_server.testing import Rehearsal, RehearsedClient

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
    body = stage.assembly.roles.objects.find("a")
    assert body is not None
    stage.assembly.simulation.remove(body.body)
    stage.settle()
    assert status(client) == {}
    create(client, "a", "1,0,-1")
    assert where(client, "a") == near(1, 0, -1)


# -- moving ----------------------------------------------------------------------------------------


def test_moving(client: RehearsedClient) -> None:
    """AbsMove sets, RelMove adds in world axes; what is not given stays (protocol 168)."""
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
    state = stage.robot_state(-1)
    x, y, _ = state.pose.position
    assert 0.25 < math.dist((x, -y), (-20, 5)) < 1.5


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
    """With Loop the object goes back to its first way point and round again (protocol 46)."""
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
    state = stage.assembly.robots.vehicles[-1].body.look()
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


SOCCER = """name = "Soccer"
extends = "P2AT"

[[sensor]]
type = "Helper"
name = "Ball"
position = [0.0, 0.0, 0.3]
"""
WATCH_AT = "0,0,-0.25"


def watcher(fresh: Rehearsal) -> RehearsedClient:
    """A robot with all sensors of life, looking along x."""
    client = fresh.connect()
    client.send(f"INIT {{ClassName USARBot.RescueP2AT}} {{Location {WATCH_AT}}}")
    return client


def avatar(fresh: Rehearsal, location: str, name: str = "W") -> RehearsedClient:
    """Somebody who stands."""
    client = fresh.connect()
    client.send(f"INIT {{ClassName USARAvatar.Worker}} {{Location {location}}} {{Name {name}}}")
    return client


def readings(client: RehearsedClient, kind: str, key: str) -> list[str]:
    """Values of a key in all lines of a type since the last call."""
    lines = [line for line in client.lines if f"{{Type {kind}}}" in line]
    return [found for line in lines for found in re.findall(rf"{{{key} ([^}}]*)}}", line)]


def likely(client: RehearsedClient) -> list[float]:
    """What HumanMotion said."""
    return [float(value) for value in readings(client, "HumanMotion", "Prob")]


def test_who_walks_past_is_noticed(fresh: Rehearsal) -> None:
    """An avatar that stands gives 0, one that walks past does not, one that has stopped is 0."""
    robot, person = watcher(fresh), avatar(fresh, "3,-2,-1")
    fresh.run(2.0)
    assert set(likely(robot)) == {0.0}
    robot.take()
    person.send("MOVE {Location 3,2}")
    fresh.run(3.0)
    # At 1.3 m/s he is as fast as a sensor wants; 3 of 5 m away he is 40 % likely.
    assert max(likely(robot)) == pytest.approx(0.4, abs=0.12)
    fresh.run(3.0)
    robot.take()
    fresh.run(1.0)
    assert likely(robot)
    assert set(likely(robot)) == {0.0}


def test_walls_hide_who_walks(fresh: Rehearsal) -> None:
    """Behind a wall that a controller has put up nobody is noticed."""
    create(controller(fresh), "Screen", "1.5,0,-1", Scale="0.2,20,7")
    robot, person = watcher(fresh), avatar(fresh, "3,-2,-1")
    person.send("MOVE {Location 3,2}")
    fresh.run(4.0)
    assert likely(robot)
    assert set(likely(robot)) == {0.0}


def test_breath_of_avatars(fresh: Rehearsal) -> None:
    """Who stands near adds to the CO2, and no more when gone."""
    robot = watcher(fresh)
    fresh.run(1.6)
    before = float(readings(robot, "CO2Sensor", "Density")[-1])
    person = avatar(fresh, "0.75,0,-1")
    robot.take()
    fresh.run(1.0)
    near = float(readings(robot, "CO2Sensor", "Density")[-1])
    person.close()
    fresh.run(0.5)
    robot.take()
    fresh.run(1.0)
    after = float(readings(robot, "CO2Sensor", "Density")[-1])
    assert near > before
    assert after == before


def test_avatars_are_no_victims(fresh: Rehearsal) -> None:
    """The victim sensor finds victims, as the original did, and nobody else who is about."""
    robot = watcher(fresh)
    avatar(fresh, "2,0,-1")
    fresh.run(4.0)
    assert set(readings(robot, "VictSensor", "Status")) == {"NoVictims"}
    assert readings(robot, "VictRFID", "VictimName") == []


def test_runs_with_passers_repeat() -> None:
    """Two runs give the same lines."""
    said = []
    for _ in range(2):
        with Rehearsal(world="empty", seed=3) as fresh:
            robot, person = watcher(fresh), avatar(fresh, "3,-2,-1")
            person.send("MOVE {Location 3,2}")
            fresh.run(3.0)
            said.append(robot.take("SEN"))
    assert said[0] == said[1]
    assert said[0]


def test_a_ball_of_a_controller_is_a_ball(tmp_path: Path) -> None:
    """The ball helper finds what a world controller calls ball, where it is then."""
    (tmp_path / "Soccer.toml").write_text(SOCCER, encoding="utf-8")
    with Rehearsal(world="empty", robots=(tmp_path,)) as fresh:
        client = fresh.connect()
        client.send(f"INIT {{ClassName USARBot.Soccer}} {{Location {WATCH_AT}}}")
        fresh.run(2.0)
        assert readings(client, "Helper", "Pos3D") == []
        create(controller(fresh), "Ball", "2,1,-0.15")
        fresh.run(1.0)
        places = readings(client, "Helper", "Pos3D")
        assert places[-1] == "2.00,1.00,-0.15"
        assert readings(client, "Helper", "Visible")[-1] == "true"


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


def test_conveyors(tmp_path: Path) -> None:
    """Conveyor scales the speed of the belts of the scene by their tag."""
    shutil.copytree(data_directory("worlds") / "empty", tmp_path / "factory")
    scene = tmp_path / "factory" / "scene.xml"
    belts = "".join(
        f'<geom name="line:{n}" type="box" size="5 0.5 0.1" pos="0 {3 * n} 0.1" '
        'surfacevel="0.4 0 0 0 0 0"/>'
        for n in range(2)
    )
    scene.write_text(scene.read_text().replace("</worldbody>", f"{belts}</worldbody>"))
    with Rehearsal(world=str(tmp_path / "factory")) as stage:
        client = controller(stage)
        for n in range(2):
            create(client, f"b{n}", f"0,{-3 * n},-0.35", Physics="RigidBody")
        stage.run(2.0)
        assert [where(client, f"b{n}")[0] for n in range(2)] == pytest.approx([0.8] * 2, abs=0.05)
        control(client, "Conveyor", Name="LINE", Speed="-1")
        stage.run(2.0)
        assert [where(client, f"b{n}")[0] for n in range(2)] == pytest.approx([0.0] * 2, abs=0.1)
        control(client, "Conveyor", Name="line", Speed="0")
        stage.run(1.0)
        before = where(client, "b0")
        stage.run(1.0)
        assert where(client, "b0") == near(*before)
