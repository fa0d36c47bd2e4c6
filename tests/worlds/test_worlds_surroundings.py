"""The live facts of a world."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.worlds.description import (
    PARTS,
    Noise,
    RfidTag,
    SoundSource,
    StartPose,
    Victim,
    WorldDescription,
)
from usarsim_server.worlds.life import Walk, traits_of
from usarsim_server.worlds.loader import find_world, load_world
from usarsim_server.worlds.scene import build_scene
from usarsim_server.worlds.surroundings import MAX_TAGS, Surroundings, beginnings
from usarsim_server.worlds.victims import add_victim, part_of

WORLD = WorldDescription(
    name="yard",
    level="yard",
    title="Yard",
    description="",
    folder=Path("yard"),
    scene=Path("yard/scene.xml"),
    starts=(StartPose("A", Pose()),),
)
WALK = {"kind": "walk", "to": [6.0, 2.0, 0.93], "speed": 0.5, "pause": 2.0}


def person(name: str, posture: str = "standing", **properties: Any) -> Victim:
    """Somebody 1 m ahead and 2 m to the left, turned."""
    pose = Pose((1.0, 2.0, 0.93), quaternion_from_rpy(0.0, 0.0, 0.7))
    return Victim(name, pose, posture, "Alive", properties)


def surroundings(*victims: Victim, **facts: Any) -> Surroundings:
    """Those of a world with these facts."""
    return Surroundings(replace(WORLD, victims=victims, **facts))


def centres(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> dict[str, np.ndarray]:
    """Mean positions of a victim's geoms by part, sides together."""
    found: dict[str, list[np.ndarray]] = {}
    for geom in range(model.ngeom):
        part = part_of(model.geom(geom).name)
        if part is not None and part[0] == name:
            found.setdefault(part[1], []).append(data.geom_xpos[geom])
    return {part: np.mean(places, axis=0) for part, places in found.items()}


# ---- people -------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", [None, "wave", WALK])
@pytest.mark.parametrize("time", [0.0, 1.3, 9.0])
def test_parts_are_where_the_physics_has_them(motion: Any, time: float) -> None:
    """Parts of still, waving and walking victims agree with the bodies that the movers place."""
    victim = person("MaleVictim_7", motion=motion or False)
    live = surroundings(victim).victims[0]
    spec = mujoco.MjSpec()
    movers = add_victim(spec, victim)
    model = spec.compile()
    data = mujoco.MjData(model)
    for mover in movers:
        index, pose = model.body(mover.body).mocapid[0], mover.pose(time)
        data.mocap_pos[index], data.mocap_quat[index] = pose.position, pose.quaternion
    mujoco.mj_kinematics(model, data)
    true = centres(model, data, victim.name)
    parts = live.parts(time)
    assert {part.name for part in parts} == set(PARTS)
    assert len(movers) == (motion is not None)
    for name, place in true.items():
        mean = np.mean([part.position for part in parts if part.name == name], axis=0)
        assert mean == pytest.approx(place, abs=1e-9)
    limbs = {"Arm", "Hand", "Leg", "Foot"}
    assert all(bool(part.side) is (part.name in limbs) for part in parts)
    assert live.head(time) == pytest.approx(tuple(true["Head"]))
    assert live.position(time) == pytest.approx(tuple(true["Chest"]))


@pytest.mark.parametrize("name", ["arena", "office"])
def test_movers_fit_the_scenes_of_shipped_worlds(name: str) -> None:
    """Every mover finds a mocap body of its name, and every mocap body has a mover."""
    world = load_world(find_world(name))
    model = build_scene(world).compile()
    movers = Surroundings(world).movers
    mocap = {model.body(body).name for body in range(model.nbody) if model.body_mocapid[body] >= 0}
    assert {mover.body for mover in movers} == mocap
    assert len(mocap) == len(movers)
    for mover in movers:
        body = model.body(mover.body)
        assert mover.pose(0.0).position == pytest.approx(tuple(body.pos))
        assert mover.pose(0.0).quaternion == pytest.approx(tuple(body.quat))


def test_speed_tells_who_moves() -> None:
    """Zero for the still; the walking speed on the way; a waving hand never rests for long."""
    still = surroundings(person("A")).victims[0]
    assert not still.moves
    assert still.motion(5.0) == (still.position(5.0), 0.0)
    walker = surroundings(person("B", motion=WALK)).victims[0]
    assert walker.moves
    place, speed = walker.motion(4.0)
    assert speed == pytest.approx(0.5, rel=1e-6)
    assert place[0] == pytest.approx(3.0, abs=0.1)
    waver = surroundings(person("C", motion="wave")).victims[0]
    speeds = [waver.motion(1.0 + step * 0.05)[1] for step in range(60)]
    assert 0.1 < min(speeds) < max(speeds) < 1.5


def test_the_walker_starts_facing_his_goal() -> None:
    """A walk overrides the yaw of the victim; the pelvis is where the file has it."""
    (mover,) = surroundings(person("B", motion=WALK)).movers
    assert mover.body == "victim:B"
    pose = mover.pose(0.0)
    assert pose.position == (1.0, 2.0, 0.93)
    assert pose.quaternion == pytest.approx((1.0, 0.0, 0.0, 0.0))
    assert isinstance(traits_of(person("B", motion=WALK)).motion, Walk)


# ---- sounds -------------------------------------------------------------------------------


def test_sounds_begin_once_each() -> None:
    """Consecutive intervals together hold every beginning exactly once, in order."""
    around = surroundings(
        person("A", sound={"period": 3.0, "delay": 0.7}),
        sounds=(
            SoundSource((9.0, 0.0, 0.0), Noise(80.0, 0.5, 2.0, 0.1)),
            SoundSource((8.0, 0.0, 0.0), Noise(80.0, 0.5, 0.0, 4.0)),
        ),
    )
    found = [
        (round(sound.start, 6), sound.victim)
        for turn in range(40)
        for sound in around.sounds(turn * 0.25, turn * 0.25 + 0.25)
    ]
    calls = [(start, "A") for start in (0.7, 3.7, 6.7, 9.7)]
    others = [(start, None) for start in (0.1, 2.1, 4.0, 4.1, 6.1, 8.1)]
    assert found == sorted([*calls, *others])


def test_sounding_is_what_has_begun_and_not_ended() -> None:
    """From the beginning on, up to but not including the end."""
    source = SoundSource((9.0, 0.0, 0.0), Noise(80.0, 0.5, 2.0, 1.0))
    around = surroundings(sounds=(source,))
    times = (0.9, 1.0, 1.49, 1.5, 2.9, 3.2)
    assert [len(around.sounding(time)) for time in times] == [0, 1, 1, 0, 0, 1]
    assert around.sounding(3.2)[0].start == pytest.approx(3.0)
    endless = surroundings(sounds=(SoundSource((0.0, 0.0, 0.0), Noise(80.0, 1.0, 1.0)),))
    assert all(len(endless.sounding(0.37 * n)) == 1 for n in range(50))


def test_somebody_who_is_made_to_call() -> None:
    """From then on, as often as by itself or as people do, until then; again, and anew."""
    around = surroundings(person("A", sound={"period": 4.0, "delay": 90.0}), person("B"))
    assert not around.call("C", 1.0)
    assert around.call("A", 2.5, 10.5)
    assert around.call("B", 3.0)
    found = [(sound.start, sound.victim) for sound in around.sounds(0.0, 16.0)]
    assert found == [(2.5, "A"), (3.0, "B"), (6.5, "A"), (9.0, "B"), (15.0, "B")]
    assert [sound.victim for sound in around.sounding(3.9)] == ["A", "B"]
    assert around.call("B", 16.0)
    assert [sound.start for sound in around.sounds(14.0, 23.0)] == [16.0, 22.0]
    around.restart(50.0)
    assert around.sounds(50.0, 100.0) == []


def test_calls_come_from_the_head() -> None:
    """Also of somebody who walks: from where it is now."""
    around = surroundings(person("B", motion=WALK, sound={"delay": 0.0, "duration": 3}))
    (victim,) = around.victims
    for time in (0.0, 1.0, 2.5):
        (sound,) = around.sounding(time)
        assert sound.position == victim.head(time)
        assert sound.victim == "B"
    assert math.dist(victim.head(0.0), victim.head(2.5)) == pytest.approx(1.25)


@given(
    st.floats(0.0, 50.0),
    st.floats(0.1, 20.0),
    st.lists(st.floats(0.0, 200.0), min_size=2, max_size=6),
)
def test_no_beginning_is_lost_or_doubled(delay: float, period: float, cuts: list[float]) -> None:
    """However time is cut into intervals, the beginnings are the same."""
    noise = Noise(70.0, 0.05, period, delay)
    cuts = sorted(cuts)
    whole = beginnings(noise, cuts[0], cuts[-1])
    parts = [
        start for low, high in itertools.pairwise(cuts) for start in beginnings(noise, low, high)
    ]
    assert parts == whole
    assert all(start >= delay for start in whole)


# ---- tags ---------------------------------------------------------------------------------


def test_tags_are_found_by_distance() -> None:
    """Within the radius, the nearest first, equal distances by number."""
    tags = tuple(RfidTag(n, (float(x), 0.0, 0.0)) for n, x in ((5, 3), (9, 1), (7, -1), (1, 8)))
    around = surroundings(tags=tags)
    assert [tag.id for tag in around.tags((0.0, 0.0, 0.0), 3.0)] == [7, 9, 5]
    assert around.tags((0.0, 100.0, 0.0), 3.0) == []


def test_memory_can_be_written_and_read() -> None:
    """A write replaces the text; unknown numbers are refused."""
    around = surroundings(tags=(RfidTag(5, (0.0, 0.0, 0.0), "old"),))
    before = around.tag(5)
    assert around.write(5, "new text")
    after = around.tag(5)
    assert before is not None
    assert after is not None
    assert (before.memory, after.memory) == ("old", "new text")
    assert not around.write(6, "x")
    assert around.tag(6) is None


def test_new_tags_get_numbers_that_nobody_has() -> None:
    """Beyond all numbers of the file; victims that ask for any number come before dropped tags."""
    around = surroundings(
        person("A", rfid=40), person("B", rfid=True), tags=(RfidTag(12, (0.0, 0.0, 0.0)),)
    )
    assert [victim.tag for victim in around.victims] == [40, 41]
    first, second = around.drop((1.0, 0.0, 0.0)), around.drop((2.0, 0.0, 0.0))
    assert first == RfidTag(42, (1.0, 0.0, 0.0))
    assert second is not None
    assert second.id == 43
    assert around.tag(40) is None


def test_a_world_holds_a_limited_number_of_tags() -> None:
    """Nobody can fill the memory of the server with tags."""
    around = surroundings()
    dropped = [around.drop((0.0, 0.0, 0.0)) for _ in range(MAX_TAGS + 2)]
    assert dropped[-2:] == [None, None]
    assert len({tag.id for tag in dropped if tag is not None}) == MAX_TAGS


def test_numbers_end_where_clients_cannot_read_on() -> None:
    """After the largest 32-bit number no tag can be dropped."""
    around = surroundings(tags=(RfidTag(2**31 - 2, (0.0, 0.0, 0.0)),))
    last = around.drop((0.0, 0.0, 0.0))
    assert last is not None
    assert last.id == 2**31 - 1
    assert around.drop((0.0, 0.0, 0.0)) is None
