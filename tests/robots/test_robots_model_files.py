"""Bodies from MJCF and URDF files are what MuJoCo reads in them; what cannot be is one error."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from model_texts import (
    LEG,
    TETRAHEDRON,
    TORSO,
    Twin,
    body,
    inertial,
    mjcf,
    urdf,
    write_stl,
)
from robot_files import write

from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.description import JointType
from usarsim_server.robots.mjcf import ARMATURE, build_spec

numbers = st.floats(-0.3, 0.3).map(lambda value: round(value, 3))


sizes = st.floats(0.02, 0.2).map(lambda value: round(value, 3))


masses = st.floats(0.05, 5.0).map(lambda value: round(value, 3))


SHAPES = {"box": 3, "capsule": 2, "cylinder": 2, "sphere": 1, "ellipsoid": 3}


@st.composite
def texts(draw: st.DrawFn) -> str:
    """A tree of up to five bodies: fixed ones, hinges and slides, several shapes each."""
    number = iter(range(100))

    def vector() -> str:
        return " ".join(f"{draw(numbers)}" for _ in range(3))

    def shape() -> str:
        kind = draw(st.sampled_from(sorted(SHAPES)))
        size = " ".join(f"{draw(sizes)}" for _ in range(SHAPES[kind]))
        colour = f"0.1 0.2 {next(number) / 100} 1"
        return (
            f'<geom type="{kind}" size="{size}" pos="{vector()}" euler="{vector()}"'
            f' mass="{draw(masses)}" rgba="{colour}"/>'
        )

    def part(depth: int) -> str:
        name = next(number)
        joint = draw(st.sampled_from(["", "hinge", "slide"]))
        motion = ""
        if joint:
            axis = draw(st.sampled_from(["1 0 0", "0 1 0", "0.3 -1 2"]))
            motion = f'<joint name="j{name}" type="{joint}" axis="{axis}" pos="{vector()}"/>'
        inner = shape() + "".join(part(depth + 1) for _ in range(draw(st.integers(0, 2 - depth))))
        return f'<body name="b{name}" pos="{vector()}" euler="{vector()}">{motion}{inner}</body>'

    return mjcf(part(0) + part(0), shape() + shape())


@settings(
    max_examples=40,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(texts(), st.lists(st.floats(-1.0, 1.0), min_size=20, max_size=20))
def test_masses_and_places_are_those_of_the_file(
    tmp_path: Path, text: str, positions: list[float]
) -> None:
    """In any pose the mass matrix, and every shape's place, equal those that MuJoCo has.

    Fixed bodies are merged into what carries them, anchors may lie anywhere.
    """
    robot = body(tmp_path, text)
    twin = Twin(text, robot)
    twin.pose(positions[: len(twin.joints)])
    theirs, ours = twin.masses()
    np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=2e-6)
    one, other = twin.geoms()
    np.testing.assert_allclose(other, one, atol=1e-7)
    assert robot.report.mass == pytest.approx(theirs[0, 0])


@pytest.mark.parametrize("name", ["Nao", "ERS", "QRIO"])
def test_shipped_bodies_are_those_of_their_files(name: str) -> None:
    """The legged robots weigh and move as their files say; extra joints of a body weigh 1 g."""
    from usarsim_server.base.files import data_directory

    folder = data_directory("robots")
    twin = Twin((folder / f"{name}.xml").read_text(), load_robot(folder / f"{name}.toml"))
    # Their roots stand fixed in the file: only the joints can be compared.
    for model in (twin.file, twin.robot):
        assert {model.joint(joint).id for joint in twin.joints}
    ours = {joint: twin.robot.dof_M0[twin.robot.joint(joint).dofadr[0]] for joint in twin.joints}
    spec = build_spec(load_robot(folder / f"{name}.toml"))
    assert len(ours) == sum(joint.name != "free" for joint in spec.joints)
    assert twin.robot.body("base").subtreemass[0] == pytest.approx(
        twin.file.body_subtreemass[0], abs=0.001 * len(ours)
    )


def test_the_place_of_the_root_does_not_matter(tmp_path: Path) -> None:
    """The root body is the chassis: its frame is the robot's, wherever the file has it."""
    twin = Twin(mjcf(), body(tmp_path, mjcf()))
    twin.pose([0.4, -1.0])
    for name in ("Thigh", "Shin"):
        anchor = twin.file.jnt_pos[twin.file.joint({"Thigh": "Hip", "Shin": "Knee"}[name]).id]
        one, other = twin.place(name)
        # A link's frame lies at its joint.
        assert np.linalg.norm(other - one) == pytest.approx(np.linalg.norm(anchor))


def test_joints_are_taken_over(tmp_path: Path) -> None:
    """Names, types, axes, ranges, damping; speed and force come from the era."""
    robot = body(tmp_path, mjcf())
    (actuator,) = robot.actuators
    hip, knee = actuator.links
    assert not actuator.package
    assert (hip.body, hip.joint, hip.type) == ("Thigh", "Hip", JointType.REVOLUTE)
    assert hip.limits == (-1.0, 1.5)
    assert hip.damping == 0.4
    assert (knee.parent, knee.home, knee.limits) == (0, 0.0, (-2.0, 0.1))
    assert (hip.max_speed, hip.max_torque) == (1.571, 20.0)
    model = build_spec(robot).compile()
    assert model.dof_armature[model.joint("Knee").dofadr[0]] == ARMATURE


def test_several_joints_of_a_body_become_several_links(tmp_path: Path) -> None:
    """The first joint is the outermost, the last one carries the body; in between is 1 g."""
    text = mjcf(
        """<body name="Ball" pos="0.2 0 0"><joint name="A" axis="0 0 1" pos="0.1 0 0"/>
        <joint name="B" axis="0 1 0" pos="0 0.1 0"/><joint name="C" type="slide" axis="1 0 0"/>
        <geom type="sphere" size="0.1" mass="3" pos="0 0 0.2" rgba="0 0 1 1"/></body>"""
    )
    robot = body(tmp_path, text)
    assert [link.body for link in robot.links] == ["Ball_A", "Ball_B", "Ball"]
    assert [link.parent for link in robot.links] == [None, 0, 1]
    assert robot.report.mass == pytest.approx(5.0 + 0.002)
    twin = Twin(text, robot)
    twin.pose([0.7, -0.4, 0.1])
    np.testing.assert_allclose(twin.geoms()[1], twin.geoms()[0], atol=1e-9)
    theirs, ours = twin.masses()
    np.testing.assert_allclose(ours, theirs, atol=0.01)


def test_reference_positions_count(tmp_path: Path) -> None:
    """A joint whose pose in the file belongs to a position other than zero stays where it is."""
    text = mjcf(LEG.replace('name="Hip"', 'name="Hip" ref="0.5"'))
    twin = Twin(text, body(tmp_path, text))
    for positions in ([0.5, 0.0], [0.0, 0.0], [-0.8, -1.0]):
        twin.pose(positions)
        np.testing.assert_allclose(twin.geoms()[1], twin.geoms()[0], atol=1e-9)


def test_unnamed_and_odd_names(tmp_path: Path) -> None:
    """Names that the wire cannot have are changed; missing ones are made; `base` is not taken."""
    text = mjcf(
        """<body><joint axis="0 0 1"/><geom type="sphere" size="0.1" mass="1"/></body>
        <body name="base"><joint name="l-hip/pitch x"/><geom size="0.1" mass="1"/></body>
        <body name="7up"><joint name="free"/><geom size="0.1" mass="1"/></body>"""
    )
    robot = body(tmp_path, text)
    assert [link.body for link in robot.links] == ["Link2", "link_base", "link_7up"]
    assert [link.joint for link in robot.links] == ["Link2_joint1", "l_hip_pitch_x", "joint_free"]
    build_spec(robot).compile()


def test_the_hidden_weight_is_not_seen(tmp_path: Path) -> None:
    """The piece that carries a body's inertia is invisible, and lasers go through it."""
    robot = body(tmp_path, mjcf(torso='<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>'))
    model = build_spec(robot).compile()
    hidden = [geom for geom in range(model.ngeom) if model.geom_rgba[geom, 3] == 0.0]
    assert len(hidden) == 3
    assert not model.geom_contype[hidden].any()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hit = np.full(1, -1, dtype=np.int32)
    mujoco.mj_ray(model, data, np.array([0.0, 0, 5]), np.array([0.0, 0, -1]), None, 1, -1, hit)
    assert hit[0] not in hidden


def test_meshes_stand_where_the_file_has_them(tmp_path: Path) -> None:
    """MuJoCo moves a mesh into its own frame; its points stay in place all the same."""
    write_stl(tmp_path / "shapes" / "tetra.stl", *TETRAHEDRON)
    text = (
        '<mujoco><compiler angle="radian" meshdir="shapes"/>'
        '<asset><mesh name="t" file="tetra.stl" scale="2 1 1"/></asset><worldbody>'
        f'<body name="Torso"><freejoint/>{TORSO}<body name="Wing" pos="0 0.2 0">'
        '<joint name="Flap" axis="1 0 0"/><geom type="mesh" mesh="t" mass="0.4" pos="0.1 0 0"'
        ' euler="0 0 1" rgba="0 1 0 1"/></body></body></worldbody></mujoco>'
    )
    robot = body(tmp_path, text)
    twin = Twin(text, robot, tmp_path)
    twin.pose([0.3])
    theirs, ours = twin.masses()
    np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=2e-6)
    corners = []
    for model, data in zip((twin.file, twin.robot), twin._data, strict=True):
        (geom,) = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
        mesh = int(model.geom_dataid[geom])
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        turned = model.mesh_vert[start : start + count] @ data.geom_xmat[geom].reshape(3, 3).T
        corners.append(np.sort(np.round(turned + data.geom_xpos[geom], 6), axis=0))
    np.testing.assert_allclose(corners[1], corners[0], atol=1e-6)


def test_flat_meshes_can_be_seen(tmp_path: Path) -> None:
    """A mesh without volume, such as a sail, is only seen and needs no thickness."""
    write_stl(
        tmp_path / "sail.stl", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(0, 1, 2), (1, 3, 2)]
    )
    text = (
        '<mujoco><asset><mesh name="s" file="sail.stl" inertia="shell"/></asset><worldbody>'
        f'<body name="Hull">{TORSO}<geom type="mesh" mesh="s" mass="0" contype="0"'
        ' conaffinity="0"/></body></worldbody></mujoco>'
    )
    robot = body(tmp_path, text)
    assert [shape.kind for shape in robot.shapes] == ["box", "mesh", "box"]
    build_spec(robot).compile()


LEG_OF_URDF = f"""
<link name="mast">{inertial(0.5)}<visual><origin xyz="0 0 0.4"/>
  <geometry><mesh filename="MESH"/></geometry></visual></link>
<joint name="stuck" type="fixed"><parent link="trunk"/><child link="mast"/>
  <origin xyz="0 0 0.5"/></joint>
<link name="arm">{inertial(1.0)}</link>
<joint name="shoulder" type="revolute"><parent link="mast"/><child link="arm"/>
  <origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" effort="7" velocity="2"/></joint>
"""


@pytest.mark.parametrize(
    "head",
    [
        "",
        "<mujoco/>",
        "<mujoco></mujoco>",
        '<mujoco><compiler discardvisual="true" fusestatic="true" meshdir="."/></mujoco>',
        '<mujoco><option timestep="0.001"/></mujoco>',
    ],
)
@pytest.mark.parametrize(
    "mesh", ["tetra.stl", "package://walker/meshes/tetra.stl", "meshes/tetra.stl"]
)
def test_urdf_keeps_fixed_links_and_looks(tmp_path: Path, head: str, mesh: str) -> None:
    """Links that do not move join what carries them; visual meshes are kept and found.

    They may be named by package as ROS does, whatever MuJoCo element the file has itself.
    """
    write_stl(tmp_path / "walker" / "meshes" / "tetra.stl", *TETRAHEDRON)
    text = urdf(LEG_OF_URDF.replace("MESH", mesh), head)
    robot = body(tmp_path / "walker", text, "urdf/walker.urdf")
    (shoulder,) = robot.links
    assert shoulder.pose.position == pytest.approx((0.1, 0.0, 0.5))
    assert (shoulder.limits, shoulder.max_torque) == ((-1.0, 1.0), 7.0)
    assert robot.report.mass == pytest.approx(3.5)
    meshes = [shape for shape in robot.shapes if shape.kind == "mesh"]
    assert len(meshes) == 1
    assert not meshes[0].collides
    build_spec(robot).compile()


def test_the_robot_file_says_what_the_model_lacks(tmp_path: Path) -> None:
    """`[joints]` gives drives for all joints and for single ones; sub-tables win."""
    robot = body(
        tmp_path,
        mjcf(),
        joints={
            "max_speed": 3.0,
            "max_torque": 5.0,
            "damping": 0.2,
            "Hip": {"limits": [0.5, 1.0], "max_torque": 9.0},
            "Knee": {"home": -0.4, "max_speed": 1.0, "damping": 0.0},
        },
    )
    hip, knee = robot.links
    assert (hip.max_speed, hip.max_torque, hip.damping) == (3.0, 9.0, 0.2)
    assert (hip.limits, hip.home) == ((0.5, 1.0), 0.5)
    assert (knee.max_speed, knee.max_torque, knee.damping, knee.home) == (1.0, 5.0, 0.0, -0.4)


def test_packages_are_made_of_joints(tmp_path: Path) -> None:
    """Named joints become mission packages; what carries a package stands before it."""
    inside = LEG + LEG.replace('"Thigh"', '"Thigh2"').replace('"Shin"', '"Shin2"').replace(
        '"Hip"', '"Hip2"'
    ).replace('"Knee"', '"Knee2"')
    robot = body(
        tmp_path,
        mjcf(inside),
        package=[
            {"name": "Foot", "joints": ["Knee"]},
            {"name": "Leg", "joints": ["Hip2", "Knee2"]},
        ],
    )
    found = {one.name: one for one in robot.actuators}
    assert list(found) == ["Joints", "Foot", "Leg"]
    assert (found["Foot"].mount, found["Leg"].mount) == ("Thigh", None)
    assert [link.joint for link in found["Leg"].links] == ["Hip2", "Knee2"]
    assert found["Leg"].package
    assert not found["Joints"].package
    twin = Twin(mjcf(inside), robot)
    twin.pose([0.3, -0.2, 0.4, -0.1])
    theirs, ours = twin.masses()
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_a_package_in_pieces_is_numbered(tmp_path: Path) -> None:
    """Joints of a package that do not hang together make two actuators, Name and Name2."""
    inside = LEG + LEG.replace("Thigh", "T2").replace("Shin", "S2").replace("Hip", "H2").replace(
        "Knee", "K2"
    )
    robot = body(tmp_path, mjcf(inside), package=[{"name": "Knees", "joints": ["Knee", "K2"]}])
    assert [one.name for one in robot.actuators] == ["Joints", "Knees", "Knees2"]
    assert [one.mount for one in robot.actuators] == [None, "Thigh", "T2"]


def test_a_variant_keeps_the_body(tmp_path: Path) -> None:
    """What extends a robot with a model file has its body and shares its slots."""
    body(tmp_path, mjcf())
    robot = load_robot(write(tmp_path, "Other", {"extends": "Walker", "description": "x"}))
    assert robot.model == "Walker"
    assert [link.joint for link in robot.links] == ["Hip", "Knee"]


def test_wheels_may_sit_on_its_links(tmp_path: Path) -> None:
    """A car may have its body and its steering knuckles from a model file."""
    knuckles = "".join(
        f'<body name="{side}Knuckle" pos="0.2 {y} 0"><joint name="{side}FrontSteer" axis="0 0 1"'
        ' range="-0.5 0.5"/><geom size="0.02" mass="0.1" contype="0" conaffinity="0"/></body>'
        for side, y in (("L", 0.15), ("R", -0.15))
    )
    (tmp_path / "cart.xml").write_text(mjcf(knuckles, TORSO.replace("0.1 0.1 0.1", "0.2 0.1 0.05")))
    wheel = {"radius": 0.1, "width": 0.04, "mass": 0.5, "position": [0, 0, 0]}
    robot = load_robot(
        write(
            tmp_path,
            "Cart",
            {
                "kind": "ackerman",
                "dialect": "ut2004",
                "body": "cart.xml",
                "wheel": [
                    {**wheel, "name": "FL", "link": "LKnuckle", "side": "left"},
                    {**wheel, "name": "FR", "link": "RKnuckle", "side": "right"},
                    {**wheel, "name": "BL", "position": [-0.2, -0.15, 0]},
                    {**wheel, "name": "BR", "position": [-0.2, 0.15, 0]},
                ],
                "drive": {"max_wheel_speed": 5.0},
            },
        )
    )
    assert (robot.report.wheel_base, robot.report.track_width) == (0.4, 0.3)
    assert robot.report.max_front_steer == 1.0
    model = build_spec(robot).compile()
    assert model.body("FL").parentid[0] == model.body("LKnuckle").id
    assert robot.rest_height == pytest.approx(0.1)
