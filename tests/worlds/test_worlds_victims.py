"""Victims: parts, postures, looks, ways of moving as functions of time."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.simulation.frames import Pose, quaternion_from_rpy, rpy_from_quaternion
from usarsim_server.worlds.description import PARTS, POSTURES, Victim
from usarsim_server.worlds.life import Walk, Wave
from usarsim_server.worlds.victims import PELVIS_HEIGHT, add_victim, part_of, swinging, walking

FLOOR = '<mujoco><worldbody><geom name="floor" type="plane" size="0 0 1"/></worldbody></mujoco>'
NAMES = [f"{figure}Victim_{n}" for n in range(12) for figure in ("Male", "Female")]


def compiled(*victims: Victim) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A floor with victims on it."""
    spec = mujoco.MjSpec.from_string(FLOOR)
    for victim in victims:
        add_victim(spec, victim)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def person(name: str, posture: str, figure: str = "male", pose: Pose | None = None) -> Victim:
    """A victim on the floor at the origin, unless posed otherwise."""
    place = pose or Pose((0.0, 0.0, PELVIS_HEIGHT[posture]))
    return Victim(name, place, posture, "Alive", {"figure": figure})


def extents(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner of all victim geoms, exact for their shapes."""
    lows, highs = [], []
    for geom in range(1, model.ngeom):
        matrix = data.geom_xmat[geom].reshape(3, 3)
        size = model.geom_size[geom]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE:
            reach = np.abs(matrix[:, 2]) * size[1] + size[0]
        else:  # ellipsoid
            reach = np.sqrt(((matrix * size) ** 2).sum(axis=1))
        lows.append(data.geom_xpos[geom] - reach)
        highs.append(data.geom_xpos[geom] + reach)
    return np.min(lows, axis=0), np.max(highs, axis=0)


@pytest.mark.parametrize("posture", POSTURES)
def test_a_victim_has_the_seven_parts(posture: str) -> None:
    """Robots reference 1.12 and 2.9: all seven groups occur, limbs on both sides."""
    model, _ = compiled(person("Victim4", posture, "female"))
    names = [model.geom(geom).name for geom in range(1, model.ngeom)]
    parts = [part_of(name) for name in names]
    assert {part for _, part in filter(None, parts)} == set(PARTS)
    assert all(found is not None and found[0] == "Victim4" for found in parts)
    for limb in ("ArmUpper", "ArmLower", "Hand", "LegUpper", "LegLower", "Foot"):
        assert {f"victim:Victim4:{limb}Left", f"victim:Victim4:{limb}Right"} <= set(names)
    assert model.body("victim:Victim4").id > 0


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("victim:A:Head", ("A", "Head")),
        ("victim:A:HeadHairLong", ("A", "Head")),
        ("victim:Female.Victim-3:LegUpperLeft", ("Female.Victim-3", "Leg")),
        ("victim:A:Tail", None),
        ("victim::Head", None),
        ("robot:A:Head", None),
        ("floor", None),
        ("", None),
    ],
)
def test_geom_names_tell_victim_and_part(name: str, found: tuple[str, str] | None) -> None:
    """`part_of` reads names of victims' geoms and no others."""
    assert part_of(name) == found


@pytest.mark.parametrize("posture", POSTURES)
@pytest.mark.parametrize("name", NAMES)
def test_victims_rest_on_the_floor(posture: str, name: str) -> None:
    """At the documented pelvis height no limb hangs in the air or sinks in deeply."""
    figure = "female" if name.startswith("Female") else "male"
    low, _ = extents(*compiled(person(name, posture, figure)))
    assert -0.012 < low[2] < 0.012


def test_postures_have_human_size() -> None:
    """Standing is 1.6 to 2.2 m high (an arm may be raised), sitting 0.8 to 1.2, lying low."""
    heights = {
        posture: [extents(*compiled(person(name, posture)))[1] for name in NAMES]
        for posture in POSTURES
    }
    assert all(1.65 < high[2] < 2.25 for high in heights["standing"])
    assert all(0.8 < high[2] < 1.2 for high in heights["sitting"])
    assert all(0.2 < high[2] < 0.6 for high in heights["lying"])


def test_a_lying_victim_has_its_feet_where_it_faces() -> None:
    """The feet lie toward the pose's x axis, the head the other way."""
    _, data = compiled(person("A", "lying"))
    assert data.geom("victim:A:FootLeft").xpos[0] > 0.6
    assert data.geom("victim:A:Head").xpos[0] < -0.5


def test_left_is_left() -> None:
    """With x ahead and z up, the left hand has the larger y."""
    _, data = compiled(person("A", "standing"))
    assert data.geom("victim:A:HandLeft").xpos[1] > 0.1
    assert data.geom("victim:A:HandRight").xpos[1] < -0.1


def test_the_pose_moves_the_whole_figure() -> None:
    """Turned and shifted, every part keeps its place relative to the pelvis."""
    pose = Pose((3.0, -2.0, 1.5), quaternion_from_rpy(math.pi, 0.1, 0.7))
    _, data = compiled(person("A", "lying"))
    _, moved = compiled(person("A", "lying", pose=pose))
    pelvis = np.array([0.0, 0.0, PELVIS_HEIGHT["lying"]])
    expected = (data.geom_xpos[1:] - pelvis) @ pose.matrix().T + np.array(pose.position)
    assert moved.geom_xpos[1:] == pytest.approx(expected, abs=1e-9)


def test_victims_are_solid_and_do_not_move() -> None:
    """A ball dropped on a victim stays on top; the victim has no degree of freedom."""
    spec = mujoco.MjSpec.from_string(FLOOR)
    add_victim(spec, person("A", "lying"))
    ball = spec.worldbody.add_body(name="ball", pos=[-0.1, 0.0, 0.6])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.3, 0.05], mass=0.5)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 500)
    assert model.nv == 6
    assert data.body("ball").xpos[2] > 0.15
    assert model.body("victim:A").weldid == 0


def test_rays_hit_named_parts() -> None:
    """A horizontal ray at head height of a standing victim hits the head (robots reference 2.9)."""
    model, data = compiled(person("A", "standing"))
    head = data.geom("victim:A:Head").xpos
    geom = np.zeros(1, np.int32)
    start = np.array([3.0, head[1], head[2] - 0.03])
    distance = mujoco.mj_ray(
        model, data, start, np.array([-1.0, 0.0, 0.0]), None, 1, -1, geom, None
    )
    assert part_of(model.geom(int(geom[0])).name) == ("A", "Head")
    assert 2.8 < distance < 3.0


def test_looks_depend_on_the_name_only() -> None:
    """The same name gives the same person twice; other names give other people."""
    one, again = (compiled(person("MaleVictim_1", "sitting"))[0] for _ in range(2))
    assert np.array_equal(one.geom_rgba, again.geom_rgba)
    assert np.array_equal(one.geom_pos, again.geom_pos)
    looks = {compiled(person(name, "sitting"))[0].geom_rgba.tobytes() for name in NAMES[::2]}
    assert len(looks) >= 8


def test_the_figure_changes_the_body() -> None:
    """A female figure has longer hair and narrower shoulders than a male one of the same name."""
    male, female = (compiled(person("A", "standing", f))[0] for f in ("male", "female"))
    assert female.ngeom == male.ngeom + 1
    name = "victim:A:ChestShoulders"
    assert female.geom(name).size[1] < male.geom(name).size[1]


@settings(max_examples=40, deadline=None)
@given(
    name=st.text("abcXYZ019_.-+", min_size=1, max_size=20),
    posture=st.sampled_from(POSTURES),
    figure=st.sampled_from(["male", "female"]),
)
def test_any_name_gives_a_body_that_compiles(name: str, posture: str, figure: str) -> None:
    """Whatever the name, the parts are the same and their names can be read back."""
    model, _ = compiled(person(name, posture, figure))
    found = {part_of(model.geom(geom).name) for geom in range(1, model.ngeom)}
    assert found == {(name, part) for part in PARTS}


def test_an_unknown_posture_is_an_error_of_the_caller() -> None:
    """The loader checks postures; here a wrong one is a KeyError."""
    with pytest.raises(KeyError):
        add_victim(mujoco.MjSpec(), Victim("A", Pose(), "flying", "Alive"))


def test_scale_is_applied_to_the_figure() -> None:
    """A victim of scale 1.5 is one and a half times as tall (worlds reference 13, 28)."""
    heights = []
    for scale in (1.0, 1.5):
        pose = Pose((0.0, 0.0, scale * PELVIS_HEIGHT["standing"]))
        victim = Victim("Big", pose, "standing", "Alive", {}, scale)
        low, high = extents(*compiled(victim))
        heights.append(high[2] - low[2])
        assert low[2] == pytest.approx(0.0, abs=0.03)
    assert heights[1] == pytest.approx(1.5 * heights[0])


START = (1.0, 2.0, 0.93)
TO_AND_FRO = walking(START, Walk((4.0, 6.0, 0.93), speed=0.5, pause=2.0))
"""5 m in 10 s, heading along 3-4-5, then 2 s of turning."""

HEADING = math.atan2(4.0, 3.0)


def yaw(pose: Pose) -> float:
    """Heading, rad; the walker stands upright."""
    roll, pitch, turn = rpy_from_quaternion(pose.quaternion)
    assert (roll, pitch) == pytest.approx((0.0, 0.0), abs=1e-9)
    return turn


@pytest.mark.parametrize(
    ("time", "place"),
    [
        (0.0, (1.0, 2.0)),
        (5.0, (2.5, 4.0)),
        (10.0, (4.0, 6.0)),
        (11.0, (4.0, 6.0)),
        (12.0, (4.0, 6.0)),
        (17.0, (2.5, 4.0)),
        (22.0, (1.0, 2.0)),
        (24.0, (1.0, 2.0)),
        (29.0, (2.5, 4.0)),
        (2405.0, (2.5, 4.0)),
    ],
)
def test_places_of_a_walk(time: float, place: tuple[float, float]) -> None:
    """There at constant speed, a pause, back, a pause, and again."""
    x, y, z = TO_AND_FRO(time).position
    assert (x, y) == pytest.approx(place, abs=1e-9)
    assert z == 0.93


def test_a_walker_looks_where_he_goes() -> None:
    """Ahead on the way out, back on the way back, turning to the left in between."""
    assert yaw(TO_AND_FRO(3.0)) == pytest.approx(HEADING)
    assert yaw(TO_AND_FRO(11.0)) == pytest.approx(HEADING + math.pi / 2)
    assert yaw(TO_AND_FRO(15.0)) == pytest.approx(HEADING - math.pi)
    assert yaw(TO_AND_FRO(23.0)) == pytest.approx(HEADING - math.pi / 2)
    assert yaw(TO_AND_FRO(24.5)) == pytest.approx(HEADING)


@given(st.floats(0.0, 1e5))
def test_a_walk_is_continuous(time: float) -> None:
    """In a millisecond nobody goes farther than the speed allows, or turns faster."""
    here, soon = TO_AND_FRO(time), TO_AND_FRO(time + 1e-3)
    assert math.dist(here.position, soon.position) < 0.5e-3 * 1.001
    turned = abs(sum(a * b for a, b in zip(here.quaternion, soon.quaternion, strict=True)))
    assert 2 * math.acos(min(turned, 1.0)) < math.pi / 2 * 1e-3 * 1.1 + 1e-6


def test_walks_up_a_slope() -> None:
    """The height changes along with the way."""
    way = walking(START, Walk((4.0, 2.0, 1.93), speed=1.0))
    x, _, z = way(math.sqrt(10.0) / 2).position
    assert (x, z) == pytest.approx((2.5, 1.43))


def test_a_swing_is_a_pendulum_about_x() -> None:
    """The z axis reaches the half angle on both sides, the joint stays where it is."""
    joint = Pose((1.0, 2.0, 3.0), quaternion_from_rpy(0.0, 0.0, 0.5))
    way = swinging(joint, Wave(angle=0.6, period=2.0))
    for time, angle in ((0.0, 0.0), (0.5, 0.6), (1.0, 0.0), (1.5, -0.6), (2.0, 0.0)):
        pose = way(time)
        assert pose.position == joint.position
        up = np.array((joint.inverse() @ Pose(pose.rotate((0.0, 0.0, 1.0)))).position) - np.array(
            joint.inverse().position
        )
        assert up == pytest.approx([0.0, -math.sin(angle), math.cos(angle)], abs=1e-9)
