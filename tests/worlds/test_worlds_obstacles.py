"""Moving obstacles and belts, and robots among them in the plant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from machine_stage import Stage

from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.testing import Rehearsal, RehearsedClient

CART = '[[obstacle]]\nname = "cart"\nsize = [0.6, 0.4, 0.5]\n'
LINE = "points = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]\n"
CORNER = "points = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]]\n"
BELT = '[[belt]]\nname = "line"\nposition = [0.0, 0.0, 0.3]\nsize = [6.0, 0.8, 0.2]\nspeed = 0.4\n'


def where(stage: Stage, seconds: float) -> list[float]:
    """Place of the cart after some time."""
    stage.run(seconds)
    x, y, z = stage.place("cart").tolist()
    return [x, y, z]


class TestWays:
    """Back and forth, round, once."""

    def test_back_and_forth(self, tmp_path: Path) -> None:
        """At 0.5 m/s it takes 4 s for 2 m, waits, and comes back, for ever."""
        stage = Stage(tmp_path, CART + LINE + "pause = 1.0\n")
        assert where(stage, 2.0) == pytest.approx([1.0, 0.0, 0.0])
        assert where(stage, 2.5) == pytest.approx([2.0, 0.0, 0.0])
        assert where(stage, 2.5) == pytest.approx([1.0, 0.0, 0.0])
        assert where(stage, 10.0) == pytest.approx([1.0, 0.0, 0.0])

    def test_speeds_of_each_way(self, tmp_path: Path) -> None:
        """Every way has its own speed; on the way back it is the same one."""
        stage = Stage(tmp_path, CART + CORNER + "speed = [1.0, 0.25]\n")
        assert where(stage, 1.0) == pytest.approx([1.0, 0.0, 0.0])
        assert where(stage, 3.0) == pytest.approx([2.0, 0.5, 0.0])
        assert where(stage, 4.0) == pytest.approx([2.0, 0.5, 0.0])
        assert where(stage, 3.0) == pytest.approx([1.0, 0.0, 0.0])

    def test_a_ring_closes_itself(self, tmp_path: Path) -> None:
        """From the last point it goes straight to the first."""
        stage = Stage(tmp_path, CART + CORNER + 'way = "ring"\nspeed = 1.0\n')
        assert where(stage, 3.0) == pytest.approx([2.0, 1.0, 0.0])
        assert where(stage, math.sqrt(5.0) / 2.0) == pytest.approx([1.0, 0.5, 0.0], abs=0.01)
        assert where(stage, math.sqrt(5.0) / 2.0 + 1.0) == pytest.approx([1.0, 0.0, 0.0], abs=0.01)

    def test_once_and_late(self, tmp_path: Path) -> None:
        """It sets out after its delay and stays at the end."""
        stage = Stage(tmp_path, CART + LINE + 'way = "once"\ndelay = 3.0\n')
        assert where(stage, 2.9) == [0.0, 0.0, 0.0]
        assert where(stage, 10.0) == pytest.approx([2.0, 0.0, 0.0])

    def test_it_faces_where_it_goes(self, tmp_path: Path) -> None:
        """It turns to the next point in the pause, the short way round."""
        stage = Stage(tmp_path, CART + CORNER + "faces_ahead = true\npause = 2.0\n")
        stage.run(3.0)
        assert stage.yaw("cart") == pytest.approx(0.0)
        stage.run(2.0)
        assert stage.yaw("cart") == pytest.approx(math.pi / 4)
        stage.run(2.0)
        assert stage.yaw("cart") == pytest.approx(math.pi / 2)


class TestPushing:
    """What obstacles do to what they meet."""

    def test_it_pushes_with_its_speed(self, tmp_path: Path) -> None:
        """A crate before it is pushed along, not shot off, and is left where the way ends."""
        stage = Stage(tmp_path, CART + LINE, (0.8, 0.0, 0.15))
        stage.run(3.0)
        assert stage.velocity("crate0")[0] == pytest.approx(0.5, abs=0.05)
        assert stage.place("crate0")[0] == pytest.approx(1.5 + 0.45, abs=0.01)
        stage.run(3.0)
        assert stage.place("crate0")[0] == pytest.approx(2.45, abs=0.03)

    def test_it_waits_for_who_is_in_front(self, tmp_path: Path) -> None:
        """With a distance it stops that far before a crate, and goes on when that is gone."""
        stage = Stage(tmp_path, CART + LINE + "distance = 0.5\n", (1.8, 0.0, 0.15))
        stage.run(8.0)
        gap = stage.place("crate0")[0] - 0.15 - (stage.place("cart")[0] + 0.3)
        assert gap == pytest.approx(0.5, abs=0.05)
        stage.put("crate0", (0.0, 3.0, 0.15))
        stage.run(1.0)
        assert stage.place("cart")[0] == pytest.approx(1.8 - 0.15 - 0.5 - 0.3 + 0.5, abs=0.06)

    def test_what_is_behind_does_not_matter(self, tmp_path: Path) -> None:
        """It looks ahead only."""
        stage = Stage(tmp_path, CART + LINE + 'distance = 0.5\nway = "once"\n', (-0.6, 0.0, 0.15))
        stage.run(5.0)
        assert stage.place("cart")[0] == pytest.approx(2.0)


class TestBelts:
    """Conveyor belts of world files."""

    def test_a_belt_carries_at_its_speed(self, tmp_path: Path) -> None:
        """A crate on a belt of 0.4 m/s goes along it at 0.4 m/s, whatever its heading."""
        stage = Stage(tmp_path, BELT + "yaw_degrees = 90.0\n", (0.0, -2.0, 0.45))
        stage.run(1.0)
        start = stage.place("crate0")
        stage.run(2.0)
        assert stage.place("crate0") - start == pytest.approx([0.0, 0.8, 0.0], abs=0.005)

    def test_a_slope_is_climbed(self, tmp_path: Path) -> None:
        """A belt that rises by 15 degrees takes a crate up at its speed along the slope."""
        slope = math.radians(15.0)
        sheet = BELT.replace("0.0, 0.3]", "0.0, 1.5]") + "slope_degrees = 15.0\n"
        high = 1.5 + 0.2 / math.cos(slope) - 2.0 * math.tan(slope)
        stage = Stage(tmp_path, sheet, (-2.0, 0.0, high))
        stage.run(1.5)
        start = stage.place("crate0")
        stage.run(2.0)
        way = [0.8 * math.cos(slope), 0.0, 0.8 * math.sin(slope)]
        assert stage.place("crate0") - start == pytest.approx(way, abs=0.01)

    def test_belts_of_a_tag_obey_together(self, tmp_path: Path) -> None:
        """A factor for a tag changes all its belts, one for a name the belt of that name."""
        more = BELT.replace("0.0, 0.0, 0.3", "0.0, 3.0, 0.3")
        sheet = BELT + 'tag = "hall"\n' + more.replace('"line"', '"other"') + 'tag = "hall"\n'
        sheet += more.replace('"line"', '"third"').replace("3.0, 0.3", "6.0, 0.3")
        stage = Stage(tmp_path, sheet, (0.0, 0.0, 0.45), (0.0, 3.0, 0.45), (0.0, 6.0, 0.45))
        assert stage.engine.run_belts("Hall", -2.0) == 2
        assert stage.engine.run_belts("third", 0.0) == 1
        assert stage.engine.run_belts("nobody", 0.0) == 0
        stage.run(1.0)
        speeds = [float(stage.velocity(f"crate{n}")[0]) for n in range(3)]
        assert speeds == pytest.approx([-0.8, -0.8, 0.0], abs=0.01)


def test_runs_repeat_whatever_the_batches(tmp_path: Path) -> None:
    """Batches of 1 and of 6 steps give the same world, bit for bit."""
    sheet = CART + CORNER + "distance = 0.3\nfaces_ahead = true\n"
    sheet += BELT.replace("0.0, 0.3]", "3.0, 0.3]")
    one, other = (Stage(tmp_path, sheet, (1.6, 0.3, 0.15), (0, 3, 0.45)) for _ in range(2))
    one.run(8.0, batch=1)
    other.run(8.0, batch=6)
    assert one.state() == other.state()


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
