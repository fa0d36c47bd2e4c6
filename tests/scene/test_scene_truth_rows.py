"""Rows of the truth channel: complete, true, equal for equal runs, without effect on the world."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from control_harness import controller, create

from usarsim_client.truth import TrueRobot, TruthRow, truth_row
from usarsim_server.services.scene_port import ScenePort
from usarsim_server.testing import Rehearsal, RehearsedClient

WORLD = """
title = "Yard"
level = "yard"

[bounds]
lower = [-40.0, -40.0, -2.0]
upper = [40.0, 40.0, 20.0]

[[start]]
tag = "Start"
position = [0.0, 0.0, 0.3]

[[victim]]
name = "Ahead"
position = [3.0, 0.0, 0.12]
posture = "lying"

[[victim]]
name = "Hidden"
position = [-9.0, 10.0, 0.12]
posture = "sitting"

[[victim]]
name = "Glazed"
position = [9.0, 20.0, 0.93]
posture = "standing"

[[victim]]
name = "Far"
position = [35.0, 20.0, 0.93]
posture = "standing"
"""
SCENE = """
<mujoco>
  <asset>
    <material name="glass" rgba="0.8 0.9 1 0.3"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="50 50 1"/>
    <geom name="ramp" type="box" pos="0 -20 0" size="3 3 0.05" euler="0 -12 0"/>
    <geom name="wall" type="box" pos="-6 10 1" size="0.1 3 1"/>
    <geom name="pane" type="box" pos="6 20 1" size="0.05 2 1" material="glass"/>
    <body name="crate" pos="-3 -10 0.4">
      <freejoint/>
      <geom type="box" size="0.4 0.4 0.4" mass="200"/>
    </body>
  </worldbody>
</mujoco>
"""


class Stage(Rehearsal):
    """A world whose rows are kept."""

    def __init__(self, world: str, **settings: Any) -> None:
        super().__init__(world=world, scene_port=0, **settings)
        self.frames: list[bytes] = []
        self.watch()

    def watch(self) -> None:
        """Read the rows."""
        truth_feed(self).start(self)

    def take(self, row: bytes) -> None:
        """Keep it."""
        self.frames.append(row)

    def crowded(self) -> bool:
        """Never."""
        return False

    def end(self) -> None:
        """Is not expected."""

    @property
    def rows(self) -> list[TruthRow]:
        """All of them so far."""
        return [truth_row(json.loads(one[5:])) for one in self.frames]

    def robot(self, name: str, pose: str, kind: str = "P3AT_real") -> RehearsedClient:
        """A robot at `x,y,z} {Rotation r,p,y`, in the frame of the wire."""
        client = self.connect()
        client.send(f"INIT {{ClassName USARBot.{kind}}} {{Name {name}}} {{Location {pose}}}")
        return client


def truth_feed(stage: Rehearsal) -> Any:
    """The feed behind the channel."""
    (port,) = (one for one in stage.assembly.services if isinstance(one, ScenePort))
    return port._channels["truth"]._feed  # type: ignore[attr-defined]


def of(row: TruthRow, name: str) -> TrueRobot:
    """A robot of a row."""
    return next(one for one in row.robots if one.name == name)


def touched(rows: list[TruthRow], name: str) -> list[tuple[str, str]]:
    """Whom a robot has touched, in order, repetitions left out."""
    found = [(one.kind, one.name) for row in rows for one in of(row, name).contacts]
    return list(dict.fromkeys(found))


@pytest.fixture
def yard(tmp_path: Path) -> str:
    """A world with victims, a wall, a pane of glass, a ramp and a crate."""
    (tmp_path / "world.toml").write_text(WORLD)
    (tmp_path / "scene.xml").write_text(SCENE)
    return str(tmp_path)


@pytest.fixture
def stage(yard: str) -> Iterator[Stage]:
    """It, running."""
    with Stage(yard) as one:
        yield one


def test_there_is_a_row_for_every_tenth_of_a_second(stage: Stage) -> None:
    """From the moment of the subscription on, and true: the pose is that of the physics."""
    client = stage.robot("R1", "0,-5,-0.3")
    client.send("DRIVE {Left 2} {Right 2.5}")
    stage.run(3.0)
    rows = stage.rows
    assert [row.time for row in rows] == [round(0.1 * n, 6) for n in range(31)]
    assert not rows[0].robots
    state, robot = stage.robot_state("R1"), of(rows[-1], "R1")
    assert robot.pos == pytest.approx(state.pose.position, abs=1e-6)
    assert robot.quat == pytest.approx(state.pose.quaternion, abs=1e-6)
    assert robot.linear == pytest.approx(state.linear_velocity, abs=1e-6)
    assert robot.angular[2] == pytest.approx(state.angular_velocity[2], abs=1e-3)
    assert math.hypot(*robot.linear[:2]) > 0.1
    assert robot.battery == pytest.approx(1.0 - 3.0 / 1200.0, abs=1e-3)
    assert [one.name for one in rows[0].victims] == ["Ahead", "Hidden", "Glazed", "Far"]
    assert rows[0].victims[0].pos == (3.0, 0.0, 0.12)


def test_contacts_have_a_name_a_kind_and_a_time(stage: Stage) -> None:
    """O-12: a victim, a wall, a crate and another robot; the floor and a ramp are none."""
    runs = {
        "AtVictim": ("1.2,0,-0.3", ("victim", "Ahead")),
        "AtWall": ("-7.2,-10,-0.3", ("world", "wall")),
        "AtCrate": ("-5,10,-0.3", ("world", "crate")),
        "OnRamp": ("-1,20,-0.3", None),
        "AtRobot": ("20,0,-0.3", ("robot", "Parked")),
    }
    for name, (place, _) in runs.items():
        stage.robot(name, place).send("DRIVE {Left 4} {Right 4}")
    stage.robot("Parked", "21.5,0,-0.3")
    stage.run(8.0)
    rows = [row for row in stage.rows if len(row.robots) == 6]
    for name, (_, expected) in runs.items():
        assert touched(rows, name) == ([] if expected is None else [expected]), name
    assert touched(rows, "Parked") == [("robot", "AtRobot")]
    assert of(rows[-1], "OnRamp").pos[2] > 0.3
    row = next(row for row in rows if of(row, "AtWall").contacts)
    (contact,) = of(row, "AtWall").contacts
    assert row.time - 0.1 < contact.time <= row.time


def test_what_stands_on_something_does_not_collide_with_it(stage: Stage) -> None:
    """A table that a client has made bears a robot; its edge is run against."""
    control = controller(stage)
    create(control, "table", "0,-30,-0.3", Scale="6,6,2")
    create(control, "block", "3,-30,-0.3", Scale="2,2,2")
    stage.robot("Above", "0,-30,-0.9")
    stage.run(2.0)
    assert of(stage.rows[-1], "Above").pos[2] > 0.6
    assert touched(stage.rows[1:], "Above") == []
    stage.robot("Below", "2,-30,-0.3").send("DRIVE {Left 4} {Right 4}")
    stage.run(3.0)
    assert touched(stage.rows[-5:], "Below") == [("world", "block")]


def test_who_sleeps_against_a_wall_touches_it(stage: Stage) -> None:
    """MuJoCo drops the contacts of what sleeps; the rows do not."""
    client = stage.robot("R1", "-7,-10,-0.3")
    client.send("DRIVE {Left 3} {Right 3}")
    stage.run(3.0)
    client.send("DRIVE {Left 0} {Right 0}")
    stage.run(20.0)
    world = stage.assembly.simulation._engine
    slot = world.active[stage.assembly.robots.vehicles[0].robot]
    tree = world.world.model.dof_treeid[world.world.layouts[slot].dof]
    assert world.data.tree_asleep[tree] >= 0, "it has to sleep for this test"
    assert [one.name for one in of(stage.rows[-1], "R1").contacts] == ["wall"]


def test_views_are_cut_off_by_walls_and_not_by_glass(stage: Stage) -> None:
    """O-10: angle and distance from the camera's eye; 60 degrees, 30 m."""
    stage.robot("R1", "0,-10,-0.3} {Rotation 0,0,3.14159")
    stage.robot("R2", "0,-20,-0.3")
    stage.run(0.5)
    row = stage.rows[-1]
    found = {(one.robot, one.victim): one for one in row.views}
    assert set(found) == {("R1", "Hidden"), ("R2", "Glazed")}
    assert not found["R1", "Hidden"].clear
    seen = found["R2", "Glazed"]
    assert seen.clear
    camera = next(
        one for one in stage.assembly.robots.vehicles[1].description.cameras if one.link is None
    )
    eye = stage.robot_state("R2").pose @ camera.pose
    ahead, victim = eye.rotate((1.0, 0.0, 0.0)), row.victims[2].pos
    way = [a - b for a, b in zip(victim, eye.position, strict=True)]
    length = math.hypot(*way)
    along = sum(a * b for a, b in zip(way, ahead, strict=True)) / length
    assert seen.distance == pytest.approx(length, abs=1e-4)
    assert seen.angle == pytest.approx(math.acos(along), abs=1e-4)


def play(world: str, watched: bool, left: float = 3.0) -> tuple[list[bytes], bytes, list[str]]:
    """Robots that collide; rows, the final coordinates, and what the robots were told."""
    with Stage(world) as stage:
        if not watched:
            truth_feed(stage).stop()
        clients = [stage.robot("A", "0,0,-0.3"), stage.robot("B", "1.5,0.3,-0.3", "P2AT")]
        clients[0].send(f"DRIVE {{Left {left}}} {{Right 3}}")
        stage.run(4.0)
        clients.append(stage.robot("C", "-8,-10,-0.3"))
        clients[2].send("DRIVE {Left 4} {Right 4}")
        stage.run(4.0)
        qpos = stage.assembly.simulation.look().qpos.tobytes()
        return stage.frames, qpos, [line for one in clients for line in one.lines]


def test_equal_runs_give_equal_rows_and_nobody_notices(yard: str) -> None:
    """O-55: the same bytes, digest included; without a reader the world is the same to the last
    bit; another command gives other rows."""
    frames, qpos, lines = play(yard, True)
    assert play(yard, True) == (frames, qpos, lines)
    unseen = play(yard, False)
    assert len(unseen[0]) <= 1
    assert unseen[1:] == (qpos, lines)
    other = play(yard, True, 3.0001)[0]
    assert truth_row(json.loads(other[-1][5:])).state != truth_row(json.loads(frames[-1][5:])).state


def test_nothing_is_done_while_nobody_reads(stage: Stage) -> None:
    """No thread, no look at contacts, no snapshots before the first and after the last."""
    simulation: Any = stage.assembly.simulation

    def busy() -> bool:
        return bool(simulation._engine.after_step) or simulation._stepper._witness is not None

    stage.settle()
    assert busy()
    truth_feed(stage).stop()
    stage.settle()
    before = len(stage.frames)
    stage.robot("R1", "0,-5,-0.3")
    stage.run(1.0)
    assert not busy()
    assert len(stage.frames) == before
    stage.watch()
    stage.run(0.05)
    assert [row.time for row in stage.rows[before:]] == [1.0]
