"""Avatars, played by hand (protocol reference 3.2, 3.13, 4.4, 4.13, 84)."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator

import pytest
from control_harness import Status, avatar, leave, near, statuses

from usarsim_server.sessions import avatar as walker
from usarsim_server.simulation.frames import Vector
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.testing import Rehearsal, RehearsedClient
from usarsim_server.worlds.avatars.ways import Survey, survey

BONES = re.compile(
    r"BSTA \{Time \d+\.\d{4}\} \{Name ([^}]*)\}( \{Bone \w+\} \{Rotation [^ }]*\}){4}"
)


@pytest.fixture(scope="module")
def office() -> Iterator[Rehearsal]:
    """A world with walls and path nodes."""
    with Rehearsal(world="office") as rehearsal:
        yield rehearsal


def now(stage: Rehearsal, client: RehearsedClient) -> Status:
    """Where an avatar is; takes a tenth of a second."""
    client.take()
    stage.run(0.1)
    return statuses(client)[-1]


# -- coming and reporting --------------------------------------------------------------------------


def test_init_and_reports(stage: Rehearsal) -> None:
    """INIT is silent; then STA and BSTA come in pairs every 0.05 s, on the ground, facing ahead."""
    client = avatar(stage, "3,4,-2", Name="Worker1", Rotation="0,0,1.5708")
    assert client.lines == []
    stage.run(0.25)
    assert client.lines == []
    stage.run(1.0)
    heads = [line.split()[0] for line in client.lines]
    assert heads == ["STA", "BSTA"] * (len(heads) // 2)
    assert all(BONES.fullmatch(line) for line in client.lines[1::2])
    seen = statuses(client)
    assert [b.time - a.time for a, b in itertools.pairwise(seen)] == pytest.approx(
        [0.05] * (len(seen) - 1), abs=0.005
    )
    one = seen[-1]
    assert (one.kind, one.name, one.walking) == ("USARAvatarNewMale", "Worker1", False)
    assert one.place == near(3, 4, -0.96, within=0.01)
    assert one.turn == near(0, 0, 1.57, within=0.01)


@pytest.mark.parametrize(
    "kind", ["USARAvatar.usaravatarfemale", "USARAvatar.Worker", "USARAvatarNewMale"]
)
def test_classes(stage: Rehearsal, kind: str) -> None:
    """By name or alias, with the package; without it only by the full name."""
    client = avatar(stage, ClassName=kind)
    assert now_or_never(stage, client)


@pytest.mark.parametrize("kind", ["USARAvatar.Nobody", "Worker", "USARBot.Worker"])
def test_unknown_classes(stage: Rehearsal, kind: str) -> None:
    """No avatar, no answer; the connection can try again (protocol 71)."""
    client = avatar(stage, ClassName=kind)
    assert not now_or_never(stage, client)
    client.send("INIT {ClassName USARAvatar.Worker}")
    assert now_or_never(stage, client)


def now_or_never(stage: Rehearsal, client: RehearsedClient) -> bool:
    """Whether the avatar is there."""
    stage.run(0.4)
    return bool(statuses(client))


def test_names_are_unique(stage: Rehearsal) -> None:
    """Two of one name get two, as robots do; without a name it is the class."""
    clients = [avatar(stage, f"{x},0,-1", Name="W") for x in (0, 2)] + [avatar(stage, "4,0,-1")]
    stage.run(0.4)
    names = [statuses(client)[-1].name for client in clients]
    assert names == ["W", "W_2", "USARAvatarNewMale"]


@pytest.mark.parametrize("height", ["-30", "0", "1.8", "-0.2"])
def test_people_stand_on_the_ground(stage: Rehearsal, height: str) -> None:
    """Whatever z INIT names, too high or too low."""
    client = avatar(stage, f"1,1,{height}")
    stage.run(0.4)
    assert statuses(client)[-1].place == near(1, 1, -0.96, within=0.01)


def test_people_make_room(stage: Rehearsal) -> None:
    """Nobody comes into the world inside a robot or somebody else."""
    robot = stage.connect()
    robot.send("INIT {ClassName P2AT} {Location 8,0,-0.3}")
    stage.run(0.3)
    clients = [avatar(stage, "8,0,-1") for _ in range(2)]
    stage.run(0.4)
    places = [statuses(client)[-1].place[:2] for client in clients]
    state = stage.robot_state(-1)
    assert state.pose.position[:2] == pytest.approx((8, 0), abs=0.02)
    assert 0.3 < math.dist(places[0], (8, 0)) < 1.5
    assert 0.3 < math.dist(*places) < 3.0


def test_an_avatar_leaves_with_its_connection(stage: Rehearsal) -> None:
    """Its body goes, its name is free."""
    before = len(stage.assembly.simulation.look().layouts)
    for _ in range(2):
        client = avatar(stage, Name="Ghost")
        stage.run(0.4)
        assert statuses(client)[-1].name == "Ghost"
        leave(stage, client)
        assert len(stage.assembly.simulation.look().layouts) == before
        assert stage.assembly.roles.avatars.present() == []


def test_other_requests_are_ignored(stage: Rehearsal) -> None:
    """DRIVE, SET, GETCONF and CONTROL mean nothing to a person."""
    client = avatar(stage)
    stage.run(0.3)
    client.take()
    client.send(
        "DRIVE {Left 1} {Right 1}",
        "GETCONF {Type Robot}",
        "GETGEO {Type Robot}",
        "CONTROL {Type GetSTA}",
        "SET {Type INS} {Opcode POSE}",
        "MOVE",
        "MOVE {Action Dance} {Location 1,1}",
        "GOTO",
        "GOTO {Name Nowhere}",
    )
    assert client.take() == []
    assert not now(stage, client).walking


# -- walking ---------------------------------------------------------------------------------------


def test_walking_forward(stage: Rehearsal) -> None:
    """Straight to the place, at walking speed, facing ahead; the arms swing and come to rest."""
    client = avatar(stage)
    stage.run(0.3)
    client.send("MOVE {Type Walk_Forward} {Action New} {Location 0, 4}")
    stage.run(2.0)
    bones = [line for line in client.lines if line.startswith("BSTA")]
    assert len(set(re.findall(r"LeftArm\} \{Rotation ([^}]*)", " ".join(bones)))) > 5
    one = statuses(client)[-1]
    assert one.walking
    assert one.turn[2] == pytest.approx(1.57, abs=0.02)
    assert 1.5 < one.place[1] < 2.2, "half a second to turn round, then 1.3 m/s"
    stage.run(3.0)
    there = now(stage, client)
    assert (there.place[:2], there.walking) == (near(0, 4, within=0.02), False)
    assert now(stage, client).place == there.place


def test_running_is_faster_and_backward_is_slower(stage: Rehearsal) -> None:
    """Run, walk and walk backward cover different ways; backward the face points back."""
    ways = {}
    for kind in ("Run", "walk_forward", "WALK_BACKWARD"):
        client = avatar(stage, Rotation="0,0,3.1415" if kind == "WALK_BACKWARD" else "0,0,0")
        stage.run(0.3)
        client.send(f"MOVE {{Type {kind}}} {{Action New}} {{Location 20,0}}")
        stage.run(2.0)
        one = statuses(client)[-1]
        ways[kind] = one.place[0]
        assert abs(one.turn[2]) == pytest.approx(3.14 if "BACK" in kind else 0.0, abs=0.02)
        leave(stage, client)
    assert ways["Run"] == pytest.approx(6.0, abs=0.2)
    assert ways["walk_forward"] == pytest.approx(2.6, abs=0.1)
    assert ways["WALK_BACKWARD"] == pytest.approx(1.3, abs=0.1)


def test_new_append_pause_resume(stage: Rehearsal) -> None:
    """Append waits its turn, Pause stops on the spot, Resume goes on, New forgets the rest."""
    client = avatar(stage)
    stage.run(0.3)
    client.send(
        "MOVE {Type Walk_Forward} {Action New} {Location 2,0}",
        "MOVE {Type Walk_Forward} {Action Append} {Location 2,2}",
    )
    stage.run(1.0)
    client.send("MOVE {Action Pause}")
    paused = now(stage, client)
    assert not paused.walking
    assert 1.0 < paused.place[0] < 1.5
    stage.run(1.0)
    assert now(stage, client).place == paused.place
    client.send("MOVE {Action Resume}")
    stage.run(4.0)
    assert now(stage, client).place[:2] == near(2, 2, within=0.02)
    client.send(
        "MOVE {Action New} {Location 9,2}",
        "MOVE {Action Append} {Location 9,9}",
        "MOVE {Action New} {Location 2,1}",
    )
    stage.run(4.0)
    assert now(stage, client).place[:2] == near(2, 1, within=0.02)


def test_places_that_wait_are_not_looked_at_again(
    stage: Rehearsal, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One more place costs one more way, and that from where one is; the whole is bounded."""
    asked: list[tuple[float, float]] = []

    def counted(simulation: Simulation, start: Vector, goal: tuple[float, float]) -> Survey:
        asked.append(goal)
        return survey(simulation, start, goal)

    monkeypatch.setattr(walker, "survey", counted)
    client = avatar(stage)
    stage.run(0.3)
    for number in range(30):
        client.send(f"MOVE {{Type Run}} {{Action Append}} {{Location {number % 2},{number % 7}}}")
        stage.run(0.05)
    assert len(asked) <= 2 * 30
    monkeypatch.setattr(walker, "MOST_POINTS", 300)
    client.send("MOVE {Action Append} {Location 9,9}")
    stage.run(0.05)
    before = len(asked)
    client.send(*["MOVE {Action Append} {Location 0,9}", "MOVE {Action Append} {Location 9,0}"] * 5)
    stage.run(0.05)
    assert len(asked) - before <= 2 * 10


def test_changing_ones_mind_is_no_jump(stage: Rehearsal) -> None:
    """A new target in the middle of a walk leads on from where one is."""
    client = avatar(stage)
    stage.run(0.3)
    places = []
    for n in range(12):
        client.send(f"MOVE {{Type Walk_Forward}} {{Action New}} {{Location {n % 3},{n % 2 * 4}}}")
        stage.run(1.3)
        places += [one.place[:2] for one in statuses(client)]
    steps = [math.dist(a, b) for a, b in itertools.pairwise(places)]
    assert max(steps) < 1.3 * 0.05 + 0.021
    assert sum(steps) > 2.0


def test_walls_are_respected(office: Rehearsal) -> None:
    """Somebody who is sent through a wall stops before it, and says that he stands."""
    client = avatar(office, "-9,0,-1")
    office.run(0.3)
    client.send("MOVE {Type Walk_Forward} {Action New} {Location -9,20}")
    office.run(12.0)
    one = now(office, client)
    assert not one.walking
    assert 2.5 < one.place[1] < 4.0 - 0.3
    client.send("MOVE {Type Walk_Forward} {Action New} {Location -9,0}")
    office.run(4.0)
    assert now(office, client).place[:2] == near(-9, 0, within=0.02)
    leave(office, client)


def test_goto_follows_the_path_nodes(office: Rehearsal) -> None:
    """From the lobby through doors to the lounge, along the shortest way."""
    client = avatar(office, "-10,1,-1")
    office.run(0.3)
    client.send("GOTO {Name LOUNGE}")
    places = []
    for _ in range(24):
        office.run(1.0)
        places += [one.place for one in statuses(client)]
    lounge = next(one for one in office.assembly.world.path_nodes if one.tag == "Lounge")
    assert places[-1][:2] == near(lounge.position[0], -lounge.position[1], within=0.02)
    door = [place for place in places if abs(place[1] - 1.1) < 0.1]
    assert all(4.6 < place[0] < 5.6 for place in door), "through the doorway of the lounge"
    corridor = [place for place in places if -5.5 < place[0] < 4.5]
    assert corridor
    assert all(abs(place[1]) < 0.9 for place in corridor)
    leave(office, client)


def test_move_to_a_path_node_and_append(office: Rehearsal) -> None:
    """MOVE knows path nodes too, and they can be appended."""
    client = avatar(office, "-9,0,-1")
    office.run(0.3)
    client.send(
        "MOVE {Type Run} {Action New} {Pathnode West}",
        "MOVE {Type Run} {Action Append} {Pathnode North1}",
    )
    office.run(5.0)
    assert now(office, client).place[:2] == near(-5.9, -1.9, within=0.02)
    leave(office, client)


# -- in the world ----------------------------------------------------------------------------------


def test_lasers_see_people(stage: Rehearsal) -> None:
    """Somebody who walks by is seen where he is, and his legs swing at the height of a laser."""
    robot = stage.connect()
    robot.send("INIT {ClassName P2AT} {Location 30,0,-0.3}")
    client = avatar(stage, "33,-3,-1")
    stage.run(0.4)
    client.send("MOVE {Type Walk_Forward} {Action New} {Location 33,3}")
    robot.take()
    stage.run(6.0)
    nearest = []
    for line in robot.take("SEN"):
        found = re.search(r"\{Type RangeScanner\}.*\{Range ([^}]*)\}", line)
        if found:
            nearest.append(min(float(part) for part in found.group(1).split(",")))
    assert min(nearest) == pytest.approx(2.75, abs=0.2)
    assert len({round(one, 2) for one in nearest}) > 10


def test_a_person_pushes_a_robot_aside_softly(stage: Rehearsal) -> None:
    """A robot in the way is shoved along; it neither stops the person nor flies off."""
    robot = stage.connect()
    robot.send("INIT {ClassName P2AT} {Location 42,0,-0.3}")
    client = avatar(stage, "40,0,-1")
    stage.run(0.5)
    client.send("MOVE {Type Walk_Forward} {Action New} {Location 44,0}")
    highest = 0.0
    vehicle = stage.assembly.robots.vehicles[-1]
    for _ in range(50):
        stage.run(0.1)
        state = vehicle.body.look()
        assert state is not None
        highest = max(highest, state.pose.position[2])
    assert now(stage, client).place[:2] == near(44, 0, within=0.02)
    x, y, _ = state.pose.position
    assert math.dist((x, y), (42, 0)) > 0.2, "it was moved"
    assert math.dist((x, y), (42, 0)) < 4.0
    assert highest < 0.5


def test_facts_bear_the_name(stage: Rehearsal) -> None:
    """Sensors that recognise what they see are told who it is, whichever limb they hit."""
    avatar(stage, "60,0,-1", Name="Anna")
    stage.run(0.1)
    (found,) = (one for one, _ in stage.assembly.roles.avatars.present())
    snapshot = stage.assembly.simulation.look()
    slot = snapshot.layouts[found.body].slot
    for body in ("base", "shin_left"):
        facts = stage.assembly.robots.object_facts(f"robot{slot}:{body}", snapshot)
        assert facts is not None
        assert facts.name == "Anna"


def walk_about() -> list[str]:
    """A robot and a person who meet."""
    with Rehearsal(world="empty") as stage:
        robot = stage.connect()
        robot.send("INIT {ClassName P2AT} {Location 4,0.1,-0.3}", "DRIVE {Left -3} {Right -3}")
        client = avatar(stage, "0,0,-1")
        stage.run(0.2)
        client.send("MOVE {Type Run} {Action New} {Location 6,0}")
        stage.run(4.0)
        return robot.lines + client.lines


def test_runs_repeat_bit_for_bit() -> None:
    """The same script gives the same lines, twice."""
    first, second = walk_about(), walk_about()
    assert len(first) > 200
    assert first == second
