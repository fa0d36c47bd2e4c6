"""Avatars: their classes and bodies, gait and walks as functions of time, ways along path nodes."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.base.errors import WorldError
from usarsim_server.base.files import data_directory
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.worlds.avatars.bodies import (
    ADULT,
    LIMBS,
    PELVIS,
    SHIN,
    SOLE,
    AvatarClass,
    avatar_model,
    joint_of,
    load_avatars,
)
from usarsim_server.worlds.avatars.walk import (
    RUNNING,
    TURN_RATE,
    WALKING,
    Gait,
    Leg,
    Performance,
    Stance,
    Walk,
    body_poses,
    limb_poses,
    posture,
)
from usarsim_server.worlds.avatars.ways import distances_to, find_node, way_to
from usarsim_server.worlds.description import PathNode

SHIPPED = load_avatars([data_directory("worlds") / "avatars.toml"])


@pytest.mark.parametrize("name", ["USARAvatarNewMale", "USARAvatarFemale", "worker"])
def test_the_usual_classes_are_shipped(name: str) -> None:
    """What clients ask for is there, in any case, and is of human size."""
    found = SHIPPED[name.lower()]
    assert 1.5 < found.height < 2.0
    assert 0.5 < found.walk_speed < found.run_speed < 8.0


def test_a_name_is_enough(tmp_path: Path) -> None:
    """All other keys have defaults; aliases lead to the class."""
    sheet = tmp_path / "avatars.toml"
    sheet.write_text('[[avatar]]\nname = "Guard"\naliases = ["Sentry"]\n', encoding="utf-8")
    found = load_avatars([sheet, tmp_path / "missing.toml"])
    assert found["sentry"] is found["guard"]
    assert found["guard"] == AvatarClass("Guard", aliases=("Sentry",))


def test_a_world_may_replace_a_class(tmp_path: Path) -> None:
    """Of two files the later one counts."""
    sheet = tmp_path / "avatars.toml"
    sheet.write_text('[[avatar]]\nname = "Worker"\nheight = 1.5\n', encoding="utf-8")
    found = load_avatars([data_directory("worlds") / "avatars.toml", sheet])
    assert found["worker"].height == 1.5
    assert found["usaravatarworker"].height == SHIPPED["usaravatarworker"].height


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[[avatar]\n", "not valid TOML"),
        ("[[avatar]]\n", "name: is missing"),
        ('[[avatar]]\nname = "A"\nheight = 5\n', "out of range"),
        ('[[avatar]]\nname = "A"\nfigure = "cat"\n', "'cat' is not known"),
        ('[[avatar]]\nname = "A"\nshirt = [1, 1, 9]\n', "from 0 to 1"),
        ('[[avatar]]\nname = "A"\nhight = 1.8\n', "did you mean height?"),
        ('[[person]]\nname = "A"\n', "unknown key"),
    ],
)
def test_slips_are_told(tmp_path: Path, text: str, says: str) -> None:
    """Every error names the file and says what is wrong."""
    sheet = tmp_path / "avatars.toml"
    sheet.write_text(text, encoding="utf-8")
    with pytest.raises(WorldError, match=r"avatars\.toml") as caught:
        load_avatars([sheet])
    assert says in str(caught.value)


@pytest.mark.parametrize("kind", sorted(set(SHIPPED.values()), key=lambda one: one.name))
def test_bodies_stand_on_their_feet(kind: AvatarClass) -> None:
    """With straight legs the soles are at the ground and the crown at the class's height."""
    model = avatar_model(kind).build().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pelvis = PELVIS * kind.height / ADULT
    reach = [
        (
            data.geom_xpos[geom][2]
            + data.geom_xmat[geom].reshape(3, 3)[2] @ (model.geom_aabb[geom, :3])
            + sign * abs(data.geom_xmat[geom].reshape(3, 3)[2]) @ model.geom_aabb[geom, 3:]
        )
        for geom in range(model.ngeom)
        for sign in (-1, 1)
    ]
    assert min(reach) + pelvis == pytest.approx(0.0, abs=0.005)
    assert max(reach) + pelvis == pytest.approx(kind.height, abs=0.06)


def test_bodies_are_the_limbs() -> None:
    """Nine bodies that are placed, each where its joint is."""
    kind = AvatarClass("A", height=ADULT)
    model = avatar_model(kind).build().compile()
    names = [model.body(body).name for body in range(1, model.nbody)]
    assert names == ["base", *LIMBS]
    assert (model.nmocap, model.nv) == (9, 0)
    hip, knee = (model.body(f"{limb}_left").pos for limb in ("thigh", "shin"))
    assert knee - hip == pytest.approx(joint_of("shin_left", ADULT))
    left, right = joint_of("upper_arm_left", ADULT), joint_of("upper_arm_right", ADULT)
    assert np.array(left) * [1, -1, 1] == pytest.approx(right)
    with pytest.raises(KeyError):
        joint_of("tail_left", ADULT)


HEIGHT = ADULT
START = Stance((0.0, 0.0, 0.0), 0.0)


def leg(
    *points: Vector,
    speed: float = 1.0,
    gait: Gait = WALKING,
    backward: bool = False,
    number: int = 0,
) -> Leg:
    """A leg along points, facing ahead or back."""
    (x, y, _), (u, v, _) = points[0], points[-1]
    heading = math.atan2(v - y, u - x) + (math.pi if backward else 0.0)
    return Leg(points, heading, speed, gait, backward, number)


FOUR = leg((0.0, 0.0, 0.0), (4.0, 0.0, 0.0))


# -- gait ------------------------------------------------------------------------------------------


def test_at_rest_limbs_hang_straight_down() -> None:
    """Without swing the way does not matter, and the hips do not sink."""
    for way in (0.0, 0.3, 17.0):
        held = posture(WALKING, way, 0.0, HEIGHT)
        assert set(held.angles) == set(LIMBS)
        assert not any(held.angles.values())
        assert held.sink == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("gait", [WALKING, RUNNING])
def test_legs_and_arms_alternate(gait: Gait) -> None:
    """Left and right are half a stride apart; an arm swings against the leg of its side."""
    for way in np.linspace(0.0, 3.0, 31):
        now = posture(gait, way, 1.0, HEIGHT).angles
        later = posture(gait, way + gait.stride / 2.0, 1.0, HEIGHT).angles
        assert now["thigh_left"] == pytest.approx(later["thigh_right"])
        assert now["thigh_left"] * now["upper_arm_left"] <= 1e-9
        assert now["shin_left"] <= 0.0 <= now["forearm_left"]


@given(st.floats(-50.0, 50.0), st.floats(0.0, 1.0), st.sampled_from([WALKING, RUNNING]))
@settings(max_examples=150, derandomize=True, deadline=None)
def test_somebody_who_walks_is_on_the_ground(way: float, swing: float, gait: Gait) -> None:
    """Whatever the moment, the lower ankle is one sole above the ground, the other not below."""
    held = posture(gait, way, swing, HEIGHT)
    poses = limb_poses(Pose((0.0, 0.0, 0.93 - held.sink)), held, HEIGHT)
    soles = [poses[1 + LIMBS.index(f"shin_{side}")] for side in ("left", "right")]
    heights = [(pose @ Pose((0.0, 0.0, -SHIN - SOLE))).position[2] for pose in soles]
    assert min(heights) == pytest.approx(0.0, abs=1e-9)
    assert 0.0 <= held.sink < 0.25


def test_limbs_hang_together() -> None:
    """Knees and elbows are where the limbs above them end, whatever the posture."""
    held = posture(RUNNING, 0.7, 1.0, 1.9)
    base = Pose((3.0, -2.0, 1.0), (math.cos(0.4), 0.0, 0.0, math.sin(0.4)))
    poses = dict(zip(("base", *LIMBS), limb_poses(base, held, 1.9), strict=True))
    scale = 1.9 / ADULT
    for upper, lower, length in (("thigh", "shin", 0.43), ("upper_arm", "forearm", 0.28)):
        for side in ("left", "right"):
            end = poses[f"{upper}_{side}"] @ Pose((0.0, 0.0, -length * scale))
            assert poses[f"{lower}_{side}"].position == pytest.approx(end.position)


# -- walks -----------------------------------------------------------------------------------------


def test_without_legs_one_stands() -> None:
    """Nothing changes with time."""
    walk = Walk(5.0, START)
    assert walk.end == 5.0
    assert walk.stance(0.0) == walk.stance(99.0) == START


def test_speed_and_heading() -> None:
    """After the turn the way is speed times time; the face points ahead."""
    walk = Walk(1.0, Stance((0.0, 0.0, 0.0), math.pi / 2), (FOUR,))
    turn = math.pi / 2 / TURN_RATE
    assert walk.stance(1.0 + turn / 2).yaw == pytest.approx(math.pi / 4)
    assert walk.stance(1.0 + turn / 2).ground == (0.0, 0.0, 0.0)
    going = walk.stance(1.0 + turn + 2.5)
    assert going.ground == pytest.approx((2.5, 0.0, 0.0))
    assert (going.yaw, going.walking, going.swing) == (0.0, True, 1.0)
    there = walk.stance(99.0)
    assert there.ground == (4.0, 0.0, 0.0)
    assert (there.walking, there.swing) == (False, 0.0)
    assert walk.end == pytest.approx(1.0 + turn + 4.0)


def test_backwards() -> None:
    """The face points away from the goal, and the way is counted down."""
    walk = Walk(0.0, START, (leg((0.0, 0.0, 0.0), (-2.0, 0.0, 0.0), backward=True),))
    going = walk.stance(1.0)
    assert going.ground == pytest.approx((-1.0, 0.0, 0.0))
    assert math.cos(going.yaw) == pytest.approx(1.0)
    assert going.way == pytest.approx(-1.0)


def test_the_ground_is_followed() -> None:
    """Height changes along the profile, speed counts along the ground plan."""
    walk = Walk(0.0, START, (leg((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.5)),))
    assert walk.stance(1.5).ground == pytest.approx((1.5, 0.0, 0.25))


def test_limbs_swing_on_round_a_small_bend_and_rest_before_a_large_one() -> None:
    """At a corner one stops, in a bend one does not."""
    one = leg((0.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    bend = Walk(0.0, START, (one, leg((2.0, 0.0, 0.0), (4.0, 0.3, 0.0), number=1)))
    corner = Walk(0.0, START, (one, leg((2.0, 0.0, 0.0), (2.0, 2.0, 0.0), number=1)))
    assert bend.stance(2.0).swing == pytest.approx(1.0)
    assert corner.stance(2.0).swing == pytest.approx(0.0, abs=1e-6)
    assert bend.leg_at(1.0) == corner.leg_at(1.0) == 0
    assert bend.leg_at(3.0) == 1
    assert bend.leg_at(99.0) == 2


places = st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-1.0, 1.0))


@given(st.lists(places, min_size=1, max_size=5), st.floats(0.0, 60.0), st.floats(-3.0, 3.0))
@settings(max_examples=150, derandomize=True, deadline=None)
def test_nobody_jumps(corners: list[Vector], time: float, yaw: float) -> None:
    """From one step of the physics to the next nothing moves or turns faster than it may."""
    points = [START.ground, *corners]
    legs = tuple(
        leg(one, other, speed=1.3, number=number)
        for number, (one, other) in enumerate(itertools.pairwise(points))
    )
    walk = Walk(0.0, Stance(START.ground, yaw), legs)
    one, other = walk.stance(time), walk.stance(time + 0.004)
    assert math.dist(one.ground[:2], other.ground[:2]) <= 1.3 * 0.004 + 1e-9
    turned = math.remainder(other.yaw - one.yaw, math.tau)
    assert abs(turned) <= TURN_RATE * 0.004 + 1e-9
    assert abs(other.swing - one.swing) <= 0.004 / 0.3 + 1e-6
    assert 0.0 <= other.swing <= 1.0


def test_all_bodies_go_along() -> None:
    """A performance gives nine poses that agree with the stance, and remembers the last moment."""
    walk = Walk(0.0, START, (FOUR,))
    performance = Performance(walk, HEIGHT)
    poses = performance.poses(2.0)
    assert poses == body_poses(walk.stance(2.0), HEIGHT)
    assert len(poses) == 9
    assert poses[0].position[:2] == pytest.approx((2.0, 0.0))
    assert performance.poses(2.0) is poses
    assert performance.poses(50.0) is performance.poses(99.0), "after the end nothing is computed"


NODES = (
    PathNode("A", (0.0, 0.0, 0.0), ("B", "C")),
    PathNode("B", (1.0, 0.0, 0.0), ("D",)),
    PathNode("C", (0.0, 3.0, 0.0), ("D",)),
    PathNode("D", (1.0, 3.0, 0.0)),
    PathNode("Alone", (9.0, 9.0, 0.0)),
)


def tags(way: list[PathNode]) -> str:
    """The way in one word."""
    return "".join(node.tag for node in way)


def test_the_shortest_way() -> None:
    """Of two ways the shorter one, and both ends are part of it."""
    assert tags(way_to(NODES, "A", "D")) in ("ABD", "ACD")
    assert tags(way_to(NODES, "C", "B")) in ("CAB", "CDB")
    assert tags(way_to(NODES, "A", "A")) == "A"


def test_connections_go_both_ways() -> None:
    """A node that names no neighbours can be left by those who name it."""
    assert tags(way_to(NODES, "D", "B")) == "DB"
    assert distances_to(NODES, "A") == pytest.approx({"A": 0, "B": 1, "C": 3, "D": 4})


def test_where_no_way_leads() -> None:
    """Nothing, and no error."""
    assert way_to(NODES, "Alone", "A") == []
    assert way_to(NODES, "A", "Alone") == []
    assert distances_to(NODES, "Alone") == {"Alone": 0.0}


def test_names_count_without_case() -> None:
    """As tags of start poses do."""
    assert find_node(NODES, " alone ") is NODES[4]
    assert find_node(NODES, "nobody") is None


def test_nodes_in_one_place() -> None:
    """Connections without length do not confuse the search."""
    same = tuple(
        PathNode(tag, (0.0, 0.0, 0.0), tuple(other for other in "PQR" if other != tag))
        for tag in "PQR"
    )
    assert way_to(same, "P", "R")[-1].tag == "R"


@st.composite
def graphs(draw: st.DrawFn) -> tuple[PathNode, ...]:
    """Up to six nodes with random connections."""
    count = draw(st.integers(2, 6))
    names = [chr(ord("A") + n) for n in range(count)]
    pairs = [pair for pair in itertools.combinations(names, 2) if draw(st.booleans())]
    return tuple(
        PathNode(
            name,
            (draw(st.floats(-5, 5)), draw(st.floats(-5, 5)), 0.0),
            tuple(b for a, b in pairs if a == name),
        )
        for name in names
    )


@given(graphs())
@settings(max_examples=100, derandomize=True, deadline=None)
def test_no_way_is_shorter(nodes: tuple[PathNode, ...]) -> None:
    """Among all ways without repetition none is shorter than the one that is found."""
    table = {node.tag: node for node in nodes}
    edges = {(node.tag, other) for node in nodes for other in node.neighbours}
    edges |= {(b, a) for a, b in edges}

    def length(way: tuple[str, ...]) -> float:
        legs = list(itertools.pairwise(way))
        if not all(pair in edges for pair in legs):
            return math.inf
        return sum(math.dist(table[a].position, table[b].position) for a, b in legs)

    goal = nodes[-1].tag
    inner = [node.tag for node in nodes[1:-1]]
    best = min(
        length((nodes[0].tag, *middle, goal))
        for size in range(len(inner) + 1)
        for middle in itertools.permutations(inner, size)
    )
    found = way_to(nodes, nodes[0].tag, goal)
    if math.isinf(best):
        assert found == []
    else:
        assert length(tuple(node.tag for node in found)) == pytest.approx(best, abs=1e-9)
        assert distances_to(nodes, goal)[nodes[0].tag] == pytest.approx(best, abs=1e-9)
