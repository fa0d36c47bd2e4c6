"""What rays see: rigid pieces, the surface that is looked at, moving glass, facts about things."""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np
import pytest
from sim_fakes import RADIUS, Geom, floor, pose_at, robot_model, simulation

from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import RobotModel
from usarsim_server.simulation.rays.groups import RigidGroup, rigid_groups
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.simulation import Simulation

BODY = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="base" pos="1 2 3">
      <freejoint/>
      <geom name="hull" type="box" size=".3 .2 .1"/>
      <body name="mast" pos="0 0 .5" quat="0.7071068 0 0 0.7071068">
        <geom name="pole" type="box" size=".02 .03 .2" pos=".1 0 0"/>
      </body>
      <body name="part" pos=".2 .2 0">{part}</body>
    </body>
  </worldbody>
</mujoco>
"""

AXLE = '<joint name="axle" type="hinge" axis="0 1 0" {more}/>'


def rigid_groups_(part: str) -> dict[str, set[str]]:
    """Names of the geoms of each group, by the name of its body."""
    model, found = compiled(part)
    return {
        model.body(one.body).name: {model.geom(geom).name for geom in one.geoms} for one in found
    }


def compiled(part: str) -> tuple[mujoco.MjModel, list[RigidGroup]]:
    """The model with some part, and its groups."""
    model = mujoco.MjModel.from_xml_string(BODY.format(part=part))
    return model, rigid_groups(model, lambda geom: True)


ROUND = {
    "sphere": '<geom name="wheel" type="sphere" size=".1" pos="0 .05 0"/>',
    "ellipsoid": '<geom name="wheel" type="ellipsoid" size=".1 .04 .1"/>',
    "cylinder": '<geom name="wheel" type="cylinder" size=".1 .04" quat="1 1 0 0"/>',
    "capsule": '<geom name="wheel" type="capsule" size=".1 .04" quat="1 1 0 0"/>',
}
UNEVEN = {
    "ellipsoid": '<geom name="wheel" type="ellipsoid" size=".1 .04 .09"/>',
    "beside the axis": '<geom name="wheel" type="sphere" size=".1" pos=".01 .05 0"/>',
    "cylinder across": '<geom name="wheel" type="cylinder" size=".1 .04"/>',
    "box": '<geom name="wheel" type="box" size=".1 .04 .1"/>',
    "with a spoke": ROUND["cylinder"] + '<geom name="spoke" type="box" size=".01 .01 .01"/>',
}


@pytest.mark.parametrize("shape", ROUND)
def test_a_round_wheel_belongs_to_its_robot(shape: str) -> None:
    """Whatever is round about its axle looks the same however far it has turned."""
    found = rigid_groups_(AXLE.format(more="") + ROUND[shape])
    assert found == {"base": {"hull", "pole", "wheel"}}


@pytest.mark.parametrize("shape", UNEVEN)
def test_what_is_not_round_about_its_axle_goes_its_own_way(shape: str) -> None:
    """One can see it turn."""
    assert "wheel" in rigid_groups_(AXLE.format(more="") + UNEVEN[shape])["part"]


def test_an_axle_beside_the_origin() -> None:
    """What counts is the axis itself, not the body's origin."""
    beside = AXLE.format(more='pos=".05 0 0"')
    assert "part" in rigid_groups_(beside + ROUND["ellipsoid"])
    on_it = ROUND["ellipsoid"].replace("/>", ' pos=".05 0 0"/>')
    assert rigid_groups_(beside + on_it) == {"base": {"hull", "pole", "wheel"}}


@pytest.mark.parametrize(
    "joints",
    [
        '<joint type="slide" axis="0 1 0"/>',
        '<joint type="ball"/>',
        AXLE.format(more="") + '<joint type="hinge" axis="0 1 0"/>',
    ],
)
def test_other_joints_make_a_piece_of_its_own(joints: str) -> None:
    """Only a single hinge is an axle."""
    assert "part" in rigid_groups_(joints + ROUND["sphere"])


def test_what_sits_on_a_wheel_turns_with_it() -> None:
    """A valve cap is not part of the robot's hull, though it has no joint of its own."""
    cap = '<body name="cap" pos=".09 0 0"><geom name="cap" type="sphere" size=".01"/></body>'
    found = rigid_groups_(AXLE.format(more="") + ROUND["ellipsoid"] + cap)
    assert found == {"base": {"hull", "pole", "wheel"}, "cap": {"cap"}}


def test_places_are_those_of_the_physics() -> None:
    """However a wheel has turned, the geoms are where the group has them."""
    model, (group,) = compiled(AXLE.format(more="") + ROUND["cylinder"])
    data = mujoco.MjData(model)
    data.qpos[:7] = (0.3, -1.0, 0.2, *np.array([0.5, 0.5, -0.1, 0.7]) / 1.0)
    data.qpos[7] = 1.234
    mujoco.mj_kinematics(model, data)
    body = data.xmat[group.body].reshape(3, 3)
    for geom, place, turn in zip(group.geoms, group.places, group.turns, strict=True):
        found = data.xpos[group.body] + body @ place
        np.testing.assert_allclose(found, data.geom_xpos[geom], atol=1e-9)
        main = (body @ turn)[:, 2]
        np.testing.assert_allclose(main, data.geom_xmat[geom].reshape(3, 3)[:, 2], atol=1e-9)


def test_only_what_is_visible_counts() -> None:
    """A body without visible geoms is no group; the fixed world is none either."""
    model = mujoco.MjModel.from_xml_string(BODY.format(part=AXLE + ROUND["sphere"]).format(more=""))
    seen = rigid_groups(model, lambda geom: model.geom(geom).name == "wheel")
    assert [(one.body, one.geoms) for one in seen] == [
        (model.body("base").id, (model.geom("wheel").id,))
    ]
    assert rigid_groups(model, lambda geom: False) == []


DOWN = RayFan(np.array([3.0, 0.0, 5.0]), np.array([[0.0, 0.0, -1.0]]), 50.0, identify=True)


def stage(movable: bool) -> mujoco.MjSpec:
    """A floor, a picture of a box 1 m high that nobody touches, and a solid of 0.4 m in it."""
    spec = floor()()
    body = spec.worldbody.add_body(name="thing", pos=[3.0, 0.0, 0.0])
    if movable:
        body.add_freejoint()
    add = partial(body.add_geom, type=Geom.mjGEOM_BOX)
    hollow = {"contype": 0, "conaffinity": 0, "mass": 0.0}
    add(name="seen", size=[0.5, 0.5, 0.5], pos=[0.0, 0.0, 0.5], group=2, **hollow)
    add(name="felt", size=[0.5, 0.5, 0.2], pos=[0.0, 0.0, 0.2], group=3)
    return spec


@pytest.mark.parametrize("movable", [False, True])
def test_rays_meet_what_is_seen(movable: bool) -> None:
    """A ray never returns a geom of group 3, whether it moves or not (worlds reference 13, 57)."""
    world = simulation(lambda: stage(movable))
    hits = world.cast([DOWN], world.look(), None)[0]
    assert hits.distances[0] == pytest.approx(4.0, abs=1e-5)
    assert hits.names == ("seen",)


def test_robots_stand_on_what_is_felt() -> None:
    """A robot put between the two surfaces stays there: only the solid is in its way."""
    world = simulation(lambda: stage(False))
    number, pose = world.spawn(robot_model(), pose_at(3.0, 0.0, 0.4 + RADIUS))
    assert pose.position[2] == pytest.approx(0.4 + RADIUS, abs=0.02)
    world.run_until(1.0)
    layout = world.look().layouts[number]
    height = world.look().xpos[layout.base][2]
    assert height == pytest.approx(0.4 + RADIUS, abs=0.01)


def pane(material: str, rigid: bool) -> RobotModel:
    """A sheet of 2 cm across the x axis."""

    def build() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        spec.add_material(name=material, rgba=[0.5, 0.5, 0.5, 0.5])
        base = spec.worldbody.add_body(name="base", mocap=not rigid)
        if rigid:
            base.add_freejoint(name="free")
        base.add_geom(type=Geom.mjGEOM_BOX, size=[0.01, 1, 0.5], mass=9.0, material=material)
        return spec

    key = f"pane:{material}:{rigid}"
    return RobotModel(key, build, driven=(), rest_height=0.5, kinematic=not rigid, robot=False)


def ahead(world: Simulation, through_glass: bool) -> RayHits:
    """What one ray along +x sees."""
    way = np.array([0.0, 0.0, 0.5]), np.array([[1.0, 0.0, 0.0]])
    fan = RayFan(*way, 20.0, through_glass=through_glass, identify=True)
    return world.cast([fan], world.look(), None)[0]


@pytest.mark.parametrize("rigid", [False, True])
def test_lasers_pass_moving_glass(rigid: bool) -> None:
    """A ray that passes glass passes a pane of it, and meets what is behind; others do not."""
    world = simulation(floor())
    world.spawn(pane("Glass", rigid), Pose((2.0, 0.0, 0.5)))
    world.spawn(pane("Wood", rigid), Pose((4.0, 0.0, 0.5)))
    assert ahead(world, through_glass=False).distances[0] == pytest.approx(1.99, abs=1e-6)
    assert ahead(world, through_glass=True).distances[0] == pytest.approx(3.99, abs=1e-6)
    assert ahead(world, through_glass=False).distances[0] == pytest.approx(1.99, abs=1e-6)


def test_facts_about_a_thing() -> None:
    """Facts name its number, its true size and its material as its maker called it."""
    world = simulation(floor())
    world.spawn(pane("Wood", True), Pose((9.0, 9.0, 0.5)))
    number, _ = world.spawn(pane("Wood", False), Pose((4.0, 0.0, 0.5)))
    name = ahead(world, through_glass=True).names
    assert name is not None
    assert name[0] is not None
    facts = world.object_facts(name[0], world.look())
    assert facts is not None
    assert (facts.robot, facts.material) == (number, "Wood")
    assert facts.size == pytest.approx((0.02, 2.0, 1.0))
    assert facts.pose.position == pytest.approx((4.0, 0.0, 0.5))
