"""Belts: shape, tables in robot files, what moves their surfaces (robots reference 4.7)."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machine_fakes import TRACKED, compiled, shipped, tracked
from robot_files import SHAPE, table, write

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.robots.catalog import load_robot
from usarsim_server.robots.families.tracked import Treads
from usarsim_server.robots.tracks import Roller, Run, runs, touching
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.ground import Belts
from usarsim_server.simulation.model import PhysicsOptions

ROLLERS = st.lists(
    st.builds(
        Roller,
        x=st.floats(-1.0, 1.0),
        z=st.floats(-1.0, 1.0),
        radius=st.floats(0.01, 0.3),
    ),
    min_size=1,
    max_size=6,
)


def test_belt_around_equal_rollers_in_line() -> None:
    """One run below, which moves back, and one above, which moves ahead; all rollers touch both."""
    rollers = [Roller(0.1, x) for x in (0.2, 0.0, -0.2)]
    below, above = sorted(runs(rollers), key=lambda run: run.start[1])
    assert below.start == pytest.approx((0.2, -0.1))
    assert below.end == pytest.approx((-0.2, -0.1))
    assert below.normal == pytest.approx((0.0, -1.0))
    assert above.start == pytest.approx((-0.2, 0.1))
    assert above.end == pytest.approx((0.2, 0.1))
    assert above.depth == pytest.approx(0.1)
    assert touching(rollers) == tuple(rollers)


def test_tapered_belt() -> None:
    """Around a small and a large roller the runs are as long as the textbook's open belt."""
    small, large = Roller(0.06, 0.0), Roller(0.08, 0.145)
    for run in runs([small, large]):
        assert run.length == pytest.approx(math.sqrt(0.145**2 - 0.02**2))
        assert run.depth == 0.06


def test_roller_inside_the_belt_is_not_touched() -> None:
    """A roller that the belt passes at a distance is no part of it."""
    ends = [Roller(0.1, -0.3), Roller(0.1, 0.3)]
    assert touching([*ends, Roller(0.05, 0.0)]) == tuple(ends)


@pytest.mark.parametrize(
    "rollers",
    [
        [],
        [Roller(0.1, 0.0)],
        [Roller(0.1, 0.0), Roller(0.05, 0.01)],
        [Roller(0.1, 0.0), Roller(0.1, 0.0)],
    ],
)
def test_no_belt(rollers: list[Roller]) -> None:
    """A single roller, or one inside the other, has no straight run."""
    assert runs(rollers) == ()


@given(ROLLERS)
def test_belt_encloses_all_rollers(rollers: list[Roller]) -> None:
    """Every run touches rollers at both ends, has all of them on its inner side, and turns the
    robot's way round."""
    for run in runs(rollers):
        for roller in rollers:
            assert stands_out(run, roller) < 1e-6
        for end in (run.start, run.end):
            gaps = [abs(math.dist(end, (r.x, r.z)) - r.radius) for r in rollers]
            assert min(gaps) < 1e-6
        along = (run.end[0] - run.start[0], run.end[1] - run.start[1])
        # The belt runs clockwise: its outer side is on its left.
        assert along[0] * run.normal[1] - along[1] * run.normal[0] > 0.0


def stands_out(run: Run, roller: Roller) -> float:
    dx, dz = roller.x - run.start[0], roller.z - run.start[1]
    return dx * run.normal[0] + dz * run.normal[1] + roller.radius


SPROCKET: dict[str, Any] = {"radius": 0.1, "width": 0.05, "mass": 0.5, "collides": False}


SPROCKETS = [
    {**SPROCKET, "name": "LeftTrack", "position": [0.0, -0.15, 0.0]},
    {**SPROCKET, "name": "RightTrack", "position": [0.0, 0.15, 0.0]},
]


ROLLER_PAIR = [{"x": 0.2, "radius": 0.1}, {"x": -0.2, "radius": 0.1}]


LEFT: dict[str, Any] = {"position": [0.0, -0.15, 0.0], "width": 0.08, "roller": ROLLER_PAIR}


RIGHT: dict[str, Any] = {**LEFT, "position": [0.0, 0.15, 0.0]}


def crawler(**changes: Any) -> dict[str, Any]:
    """A small tracked robot; a change to None drops the key."""
    base: dict[str, Any] = {
        "kind": "tracked",
        "caster": None,
        "wheel": SPROCKETS,
        "track": [LEFT, RIGHT],
        "shape": [{**SHAPE, "size": [0.3, 0.2, 0.1]}],
    }
    return table(**(base | changes))


def test_tracks_are_read(tmp_path: Path) -> None:
    """Sides follow from places; base, separation and rest height follow from the belts."""
    robot = load_robot(write(tmp_path, "Test", crawler()))
    assert [track.side for track in tracked(robot).tracks] == ["left", "right"]
    assert tracked(robot).tracks[0].position == (0.0, 0.15, 0.0)
    assert robot.rest_height == pytest.approx(0.1)
    assert robot.report.wheel_base == pytest.approx(0.4)
    assert robot.report.track_width == pytest.approx(0.3)
    assert robot.report.wheel_radius == 0.1
    assert robot.report.dimensions == pytest.approx((0.4, 0.3, 0.0))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"track": None}, "no track on the left"),
        ({"track": [LEFT]}, "no track on the right"),
        ({"track": [LEFT, {**RIGHT, "side": "left"}]}, "is 'left', but the track is on the right"),
        ({"track": [LEFT, {**RIGHT, "position": [0, 0, 0]}]}, "side: is missing"),
        ({"track": [LEFT, {**RIGHT, "roller": ROLLER_PAIR[:1]}]}, "1 rollers do not hold a belt"),
        ({"track": [LEFT, {**RIGHT, "width": 0}]}, "width"),
        ({"track": [LEFT, {**RIGHT, "link": "Arm"}]}, "no link 'Arm'"),
        ({"track": [LEFT, {**RIGHT, "roller": [{"x": 0.1}]}]}, "radius: is missing"),
        ({"rest_height": 0.5}, "the tracks touch the floor at 0.1"),
        ({"wheel": None}, "no driven wheel on the left"),
        ({"report": {"wheel_base": 1.0}}, "leave it out"),
        ({"report": {"wheel_radius": 0.2}}, "leave it out"),
    ],
)
def test_bad_tracks(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    """What cannot be a tracked robot is refused with place and cure."""
    with pytest.raises(RobotDescriptionError, match=re.escape(words)):
        load_robot(write(tmp_path, "Test", crawler(**changes)))


def test_other_kinds_have_no_tracks(tmp_path: Path) -> None:
    """A [[track]] table on a wheeled robot is an unknown key, not ignored."""
    with pytest.raises(RobotDescriptionError, match="track"):
        load_robot(write(tmp_path, "Test", table(track=[LEFT, RIGHT])))


def test_variants_inherit_belts(tmp_path: Path) -> None:
    """A faster Kenaf is a Kenaf to the physics, with the radius of its sprockets; one with
    other belts is not."""
    fast = load_robot(
        write(tmp_path, "Fast", {"extends": "Kenaf", "drive": {"max_wheel_speed": 12.0}})
    )
    assert fast.model == "Kenaf"
    assert fast.family == shipped("Kenaf").family
    assert fast.report.wheel_radius == 0.09
    other = load_robot(write(tmp_path, "Other", {"extends": "Kenaf", "track": [LEFT, RIGHT]}))
    assert other.model == "Other"
    assert len(tracked(other).tracks) == 2


def test_belts_on_a_link_that_is_gone(tmp_path: Path) -> None:
    """A variant that drops the flippers must describe its tracks anew."""
    with pytest.raises(RobotDescriptionError, match="sits on 'FRFlipper', which is gone"):
        load_robot(write(tmp_path, "Bare", {"extends": "Kenaf", "without": ["Flippers"]}))


def surface_speed(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int
) -> tuple[float, float, float]:
    """Velocity (world frame) of the lowest point of the surface of a part of a belt."""
    frame = data.geom_xmat[geom].reshape(3, 3)
    linear, angular = model.geom_surfacevel[geom, :3], model.geom_surfacevel[geom, 3:]
    radius = model.geom_size[geom, 2]
    below = np.array([0.0, 0.0, -radius])
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        return tuple(frame @ linear)
    return tuple(np.cross(frame @ angular, below))


@pytest.mark.parametrize("name", TRACKED)
def test_surfaces_follow_the_sprocket_of_their_side(name: str) -> None:
    """What lies on the ground moves back at radius times spin, on chassis and flippers, each side
    for itself, and rollers turn no faster than their belt."""
    robot = shipped(name)
    world = compiled(robot)
    model, data = world.model, mujoco.MjData(world.model)
    for joint, place in world.layouts[0].joint_qpos.items():
        if joint.endswith("flipper"):
            data.qpos[place] = 0.0
    mujoco.mj_kinematics(model, data)
    (law_model,) = robot.family.laws(robot)
    law = law_model.make(model, "robot0:")
    spins = {"left": 2.0, "right": -3.0}
    for wheel in robot.driven_wheels:
        data.qvel[world.layouts[0].joint_dof[wheel.name.lower()]] = spins[wheel.side]
    law.prepare(model, data, np.zeros(0))
    radius = robot.driven_wheels[0].radius
    seen = 0
    for geom in world.layouts[0].geoms:
        label = model.geom(geom).name.removeprefix("robot0:")
        if not re.fullmatch(r"track:\d+:(roller|run).*", label):
            assert not model.geom_surfacevel[geom].any()
            continue
        track = tracked(robot).tracks[int(label.split(":")[1])]
        wanted = spins[track.side] * radius
        velocity = surface_speed(model, data, int(geom))
        assert math.hypot(*velocity) == pytest.approx(abs(wanted))
        upright = data.geom_xmat[geom].reshape(3, 3)[2, 2]
        if "roller" in label or upright < -0.9:
            seen += 1
            # A run that rises towards a hinge carries what stands on it along itself.
            level = 1.0 if "roller" in label else -upright
            assert velocity[0] == pytest.approx(-wanted * level, rel=0.05)
    assert seen >= 2 * len(tracked(robot).tracks)


def test_belts_on_a_link_mounted_backwards_run_the_right_way(tmp_path: Path) -> None:
    """A flipper whose frame is turned by half a turn still rolls ahead with its side."""
    link = {
        "name": "Flipper",
        "position": [0.3, -0.15, 0.0],
        "rotation": [0.0, 0.0, math.pi],
        "axis": [0, 1, 0],
        "shape": [{**SHAPE, "size": [0.1, 0.02, 0.02], "mass": 0.5, "collides": False}],
    }
    flipper = {"link": "Flipper", "width": 0.05, "roller": ROLLER_PAIR}
    path = write(
        tmp_path,
        "Test",
        crawler(
            track=[LEFT, RIGHT, flipper],
            actuator=[{"name": "Flippers", "package": False, "link": [link]}],
        ),
    )
    robot = load_robot(path)
    assert tracked(robot).tracks[2].side == "left"
    world = compiled(robot)
    model, data = world.model, mujoco.MjData(world.model)
    mujoco.mj_kinematics(model, data)
    law = robot.family.laws(robot)[0].make(model, "robot0:")
    data.qvel[world.layouts[0].joint_dof["lefttrack"]] = 1.0
    law.prepare(model, data, np.zeros(0))
    for part in ("track:0:roller0:0", "track:2:roller0:0"):
        assert surface_speed(model, data, model.geom("robot0:" + part).id)[0] < -0.09


def test_belts_stop_with_their_robot() -> None:
    """Released, all surfaces stand still; a restored state is written again; what hardly turns
    does not move at all."""
    robot = shipped("Kenaf")
    world = compiled(robot, copies=2)
    model, data = world.model, mujoco.MjData(world.model)
    first, second = (robot.family.laws(robot)[0].make(model, f"robot{slot}:") for slot in range(2))
    assert isinstance(first, Treads)
    dof = [layout.joint_dof["lefttrack"] for layout in world.layouts]
    data.qvel[dof] = 1.0
    for law in (first, second):
        law.prepare(model, data, np.zeros(0))
    geoms = world.layouts[0].geoms
    other = model.geom_surfacevel[world.layouts[1].geoms].copy()
    moving = model.geom_surfacevel[geoms].copy()
    first.release(model, data)
    assert not model.geom_surfacevel[geoms].any()
    assert (model.geom_surfacevel[world.layouts[1].geoms] == other).all()
    assert other.any()
    first.restore(first.state())
    first.prepare(model, data, np.zeros(0))
    assert (model.geom_surfacevel[geoms] == moving).all()
    data.qvel[dof] = 1e-9
    first.prepare(model, data, np.zeros(0))
    assert not model.geom_surfacevel[geoms].any()


def test_what_is_seen_of_a_belt() -> None:
    """Cameras and lasers see round ends and flat runs; not the ellipsoids that collide in their
    place, nor the sprockets. All parts of belts are weightless."""
    model = compiled(shipped("Kenaf")).model
    names = [model.geom(geom).name for geom in range(model.ngeom)]
    for geom, name in enumerate(names):
        if ":track:" in name:
            solid = bool(model.geom_contype[geom])
            assert solid is ("look" not in name)
            assert bool(model.geom_group[geom] <= 2) is ("roller" not in name)
            assert model.geom_priority[geom] == 0
    for sprocket in ("LeftTrack", "RightTrack"):
        geom = names.index(f"robot0:{sprocket}")
        assert model.geom_group[geom] > 2
        assert model.geom_contype[geom] == model.geom_conaffinity[geom] == 0


def test_tracks_are_no_conveyor_belts() -> None:
    """A world controller cannot run the belts of robots."""
    belts = Belts(compiled(shipped("Kenaf")).model)
    assert belts.run("robot0", 5.0) == 0
    assert belts.run("robot0:track:0:run0", 5.0) == 0


def walled() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(
        """<mujoco><worldbody>
        <geom type="plane" size="0 0 1"/>
        <geom type="box" pos="0.9 0 0.5" size="0.3 2 0.5"/>
        </worldbody></mujoco>"""
    )


def traction(engine: Engine, side: str) -> float:
    """What the belts of a side pull with altogether, N."""
    model, data = engine.world.model, engine.data
    tracks = tracked(shipped("Kenaf")).tracks
    force, total = np.zeros(6), 0.0
    for number, contact in enumerate(data.contact):
        names = (model.geom(int(geom)).name for geom in contact.geom)
        label = next((name for name in names if name.startswith("robot0:track:")), None)
        if label and tracks[int(label.split(":")[2])].side == side:
            mujoco.mj_contactForce(model, data, number, force)
            total += math.hypot(force[1], force[2])
    return total


@pytest.mark.parametrize("torque", [3.0, 5.3])
def test_belts_at_a_wall_pull_no_more_than_their_drive(torque: float) -> None:
    """Robots 59: ground and wall share the thrust of a side, torque over radius of its sprocket."""
    kenaf = shipped("Kenaf")
    robot = replace(kenaf, model="Test", drive=replace(kenaf.drive, wheel_torque=torque))
    engine = Engine(walled, PhysicsOptions(), slots=(robot_model(robot),))
    engine.occupy(0, 0, Pose((0.0, 0.0, robot.rest_height)))
    engine.drive(0, np.full(2, 3.0))
    engine.advance(500)
    for side in ("left", "right"):
        thrust = torque / robot.driven_wheels[0].radius
        assert traction(engine, side) == pytest.approx(thrust, rel=0.05)


def test_parked_belts_hold_with_all_their_grip() -> None:
    """A drive at rest is none that stalls: at the same wall belts that stand grip as they can."""
    robot = shipped("Kenaf")
    engine = Engine(walled, PhysicsOptions(), slots=(robot_model(robot),))
    engine.occupy(0, 0, Pose((0.0, 0.0, robot.rest_height)))
    engine.drive(0, np.full(2, 3.0))
    engine.advance(500)
    assert engine.data.contact.friction[:, 0].min() < 0.9
    engine.drive(0, np.zeros(2))
    # Asleep it would have no contacts.
    engine.world.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    engine.advance(100)
    assert engine.data.contact.friction[:, 0].min() == 1.0


PAGE = (Path(__file__).parents[2] / "docs" / "robot-files.md").read_text(encoding="utf-8")


def keys(title: str) -> set[str]:
    """Keys in the table of a section of the page."""
    body = PAGE.split(f"### {title}", 1)[1].split("\n#", 1)[0]
    cells = re.findall(r"^\| (`[^|]*`) \|", body, re.MULTILINE)
    return {key for cell in cells for key in re.findall(r"`(\w+)`", cell)}


@pytest.mark.parametrize("title", ["`[[track]]`", "`[[track.roller]]`"])
def test_page_lists_exactly_the_known_keys(tmp_path: Path, title: str) -> None:
    """The tables about belts have exactly the keys that the loader knows."""
    probe = "zzzzzzzzzzzz"
    track = {**LEFT, "roller": [dict(roller) for roller in ROLLER_PAIR]}
    (track["roller"][0] if "roller" in title else track)[probe] = 1
    with pytest.raises(RobotDescriptionError, match=probe) as caught:
        load_robot(write(tmp_path, "Test", crawler(track=[track, RIGHT])))
    known = set(str(caught.value).split("known keys: ")[1].rstrip(")").split(", "))
    assert keys(title) == known
