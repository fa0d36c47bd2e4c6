"""The compiled world: versions, layouts, shelf, servos, matching of generations."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from sim_fakes import (
    HALF_BASE,
    HALF_TRACK,
    ROBOT,
    WHEELS,
    build_robot,
    drive,
    engine_with,
    floor,
    robot_model,
    run,
    straight,
    yard,
)

from usarsim_server.base.errors import UsarsimError
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.sessions.robots import robot_model as shipped_model
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import (
    SHELF_HEIGHT,
    SHELF_NAME,
    VACANT,
    Blueprint,
    CompiledWorld,
    PhysicsOptions,
    RobotModel,
    check_mujoco_version,
    compile_world,
    matching_joints,
    root_qpos,
)
from usarsim_server.simulation.rays.moving import DynamicGeometry


def compiled(*slots: RobotModel) -> CompiledWorld:
    """A world on a plain floor."""
    return compile_world(floor(), slots, PhysicsOptions(), generation=0)


def ball_robot() -> mujoco.MjSpec:
    """The smallest thing that can be parked."""
    spec = mujoco.MjSpec()
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="free")
    base.add_geom(size=[0.1, 0.0, 0.0], mass=1.0)
    return spec


@pytest.fixture(scope="module")
def world() -> CompiledWorld:
    """Two robots of a kind and an odd one between them."""
    return compiled(ROBOT, RobotModel("ball", ball_robot, (), 0.1), ROBOT)


class TestVersion:
    """Which MuJoCo releases are used."""

    @pytest.mark.parametrize("version", ["3.16.0", "3.16", "3.17.0", "3.20.1", "3.17.0.dev1"])
    def test_good_releases(self, version: str) -> None:
        """3.16 and all later releases of the third series are accepted."""
        check_mujoco_version(version)

    @pytest.mark.parametrize("version", ["4.0.0", "4.0.1", "5.0"])
    def test_next_series_is_refused(self, version: str) -> None:
        """4.0.0 diverges when robots touch; the error says so and names the cure."""
        with pytest.raises(UsarsimError, match=r"pip install 'mujoco>=3.16,<4'"):
            check_mujoco_version(version)

    @pytest.mark.parametrize("version", ["3.15.2", "3.2.7", "2.3.7"])
    def test_old_releases_are_refused(self, version: str) -> None:
        """Releases before 3.16 lack what is used here."""
        with pytest.raises(UsarsimError, match="too old"):
            check_mujoco_version(version)

    def test_installed_release_is_good(self) -> None:
        """The release in use is one that has been checked."""
        check_mujoco_version()


class TestOptions:
    """Physics settings (robots reference 4.10)."""

    def test_recommended_settings(self) -> None:
        """Elliptic cone, implicitfast, impratio 10, sleep on, no automatic reset of the world."""
        option = compiled().model.opt
        assert option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
        assert option.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        assert (option.impratio, option.timestep) == (10.0, 0.004)
        assert option.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP
        assert option.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET


class TestLayout:
    """Where a robot lies in the arrays."""

    def test_wheels_are_in_part_order(self, world: CompiledWorld) -> None:
        """Coordinates, velocities and actuators of the wheels follow the order of the class."""
        for slot in (0, 2):
            layout = world.layouts[slot]
            names = [f"robot{slot}:{name}" for name in WHEELS]
            model = world.model
            assert [int(model.joint(name).qposadr[0]) for name in names] == list(layout.wheel_qpos)
            assert [int(model.joint(name).dofadr[0]) for name in names] == list(layout.wheel_dof)
            assert [model.actuator(name).id for name in names] == list(layout.wheel_actuators)

    def test_robots_do_not_overlap(self, world: CompiledWorld) -> None:
        """Every body and geom belongs to at most one robot; nothing of the scenery to any."""
        bodies = [body for layout in world.layouts for body in layout.bodies]
        geoms = [geom for layout in world.layouts for geom in layout.geoms]
        assert len(bodies) == len(set(bodies)) == world.model.nbody - 1
        assert len(geoms) == len(set(geoms)) == world.model.ngeom - 2  # floor and shelf

    def test_links_and_joints_go_by_plain_lower_case_names(self, world: CompiledWorld) -> None:
        """Links and joints are found by their own names, without the slot's prefix."""
        layout = world.layouts[2]
        assert set(layout.links) == set(WHEELS)
        assert set(layout.joint_qpos) == set(layout.joint_dof) == set(WHEELS)

    def test_names_in_capitals(self) -> None:
        """Names of robot files in capitals are found in lower case."""

        def build() -> mujoco.MjSpec:
            spec = ball_robot()
            arm = spec.body("base").add_body(name="UpperArm")
            arm.add_joint(name="Shoulder")
            arm.add_geom(size=[0.05, 0.0, 0.0], pos=[0.3, 0.0, 0.0])
            return spec

        layout = compiled(RobotModel("arm", build, (), 0.1)).layouts[0]
        assert set(layout.links) == {"upperarm"}
        assert set(layout.joint_qpos) == {"shoulder"}

    def test_root_coordinates(self) -> None:
        """A pose becomes position and quaternion, in MuJoCo's order."""
        pose = Pose((1.0, 2.0, 3.0), (0.5, 0.5, 0.5, -0.5))
        np.testing.assert_array_equal(root_qpos(pose), [1, 2, 3, 0.5, 0.5, 0.5, -0.5])


class TestShelf:
    """Where free slots wait."""

    @pytest.mark.parametrize("count", [0, 1, 16, 17, 300])
    def test_shelf_is_as_large_as_its_load(self, count: int) -> None:
        """However many slots there are, each is parked over the shelf and at its rest height."""
        ball = RobotModel("ball", ball_robot, (), 0.1)
        world = compiled(*[ball] * count)
        shelf = world.model.geom(SHELF_NAME)
        low, high = shelf.pos - shelf.size, shelf.pos + shelf.size
        assert high[2] == SHELF_HEIGHT
        assert (world.parking[:, :2] >= low[:2] + 1.0).all()
        assert (world.parking[:, :2] <= high[:2] - 1.0).all()
        np.testing.assert_array_equal(world.parking[:, 2], np.full(count, SHELF_HEIGHT + 0.1))

    def test_parked_robots_touch_nothing_but_the_shelf(self) -> None:
        """A row of parked robots has no contact among its members."""
        world = compiled(*[ROBOT] * 20)
        world.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        data = mujoco.MjData(world.model)
        mujoco.mj_forward(world.model, data)
        shelf = world.model.geom(SHELF_NAME).id
        assert all(shelf in pair for pair in data.contact.geom)


class TestServos:
    """Velocity actuators of robot files become friction losses of the wheel joints."""

    def test_gain_and_torque_are_those_of_the_actuator(self) -> None:
        """Held against its set point by a known torque a wheel lags by torque over gain."""
        for gain, torque in ((20.0, 4.0), (200.0, 10.0)):
            model = robot_model(gain=gain, torque=torque)
            engine = engine_with((0.0, 0.0), model=model, scenery=mujoco.MjSpec)
            engine.world.model.opt.gravity[:] = 0.0
            engine.drive(0, straight(3.0))
            data, wheels = engine.data, engine.world.layouts[0].wheel_dof
            load = np.array([-1.0, 1.0, 0.5, 0.0])
            data.qfrc_applied[wheels] = load
            data.qfrc_applied[engine.world.layouts[0].dof + 4] = -load.sum()  # on the chassis
            run(engine, 1.0)
            lag = engine.wheel_targets(0) - data.qvel[wheels]
            np.testing.assert_allclose(lag, -load / gain, atol=0.02 / gain + 0.0005)

    def test_torque_is_limited(self) -> None:
        """A wheel that is loaded with more than the servo's torque is dragged along."""
        for load, held in ((3.5, True), (4.5, False)):
            engine = engine_with((0.0, 0.0), model=robot_model(torque=4.0), scenery=mujoco.MjSpec)
            engine.world.model.opt.gravity[:] = 0.0
            wheel = engine.world.layouts[0].wheel_dof[0]
            engine.data.qvel[:6] = -0.0
            engine.data.qfrc_applied[wheel] = load
            run(engine, 0.2)
            assert bool(abs(engine.data.qvel[wheel]) < 1.0) is held

    def test_actuators_do_nothing_any_more(self) -> None:
        """The actuators of the wheels stay in the model but exert no force."""
        engine = engine_with((0.0, 0.0))
        drive(engine, straight(3.0), 0.3)
        assert engine.data.qvel[0] > 0.2
        assert not engine.data.actuator_force.any()

    @pytest.mark.parametrize(("gain", "torque"), [(0.0, 6.0), (-20.0, 6.0)])
    def test_senseless_servos_are_refused(self, gain: float, torque: float) -> None:
        """A servo without gain cannot drive a wheel."""
        with pytest.raises(ValueError, match="front_left"):
            compiled(robot_model(gain=gain, torque=torque))

    def test_no_limit_means_a_strong_servo(self) -> None:
        """Actuators without a force range get a torque that no wheel can resist."""
        world = compiled(robot_model(torque=0.0))
        assert world.model.dof_frictionloss[world.layouts[0].wheel_dof].min() >= 1000.0


class TestMatching:
    """Coordinates of two generations."""

    def test_everything_old_is_found_again(self) -> None:
        """Each named and unnamed joint of the old model is found in the new one."""
        old = compile_world(yard, [ROBOT], PhysicsOptions(), 0).model
        new = compile_world(yard, [ROBOT, ROBOT], PhysicsOptions(), 1).model
        (old_q, new_q), (old_v, new_v) = matching_joints(old, new)
        assert sorted(old_q) == list(range(old.nq))
        assert sorted(old_v) == list(range(old.nv))
        assert len(set(new_q)) == old.nq
        assert len(set(new_v)) == old.nv
        slot = compile_world(yard, [ROBOT], PhysicsOptions(), 0).layouts[0]
        twin = compile_world(yard, [ROBOT, ROBOT], PhysicsOptions(), 1).layouts[0]
        assert dict(zip(old_q, new_q, strict=True))[slot.qpos] == twin.qpos
        assert dict(zip(old_v, new_v, strict=True))[slot.wheel_dof[2]] == twin.wheel_dof[2]


class TestGrowth:
    """A larger model is made of the specification of the one before."""

    @pytest.mark.parametrize("name", ["P3AT_arm", "Fanuc_Robot_And_Rail", "Nao"])
    def test_it_is_the_same_to_the_byte_as_one_compiled_at_once(self, name: str) -> None:
        """Arms, hands, excluded contacts, meshes: whatever shipped classes are made of."""
        description = load_catalog(()).find(name)
        assert description is not None
        shipped = shipped_model(description)
        whole = compiled(ROBOT, shipped, shipped)
        blueprint = Blueprint(floor()(), PhysicsOptions())
        blueprint.add([ROBOT, shipped])
        part = blueprint.compile(0)
        blueprint.add([shipped])
        grown = blueprint.compile(1, part)
        assert stored(grown.model) == stored(whole.model)
        assert grown.layouts[0] is part.layouts[0]
        for one, other in zip(grown.layouts, whole.layouts, strict=True):
            assert one.bodies == other.bodies
            assert one.joint_qpos == other.joint_qpos
            np.testing.assert_array_equal(one.geoms, other.geoms)
            np.testing.assert_array_equal(one.wheel_actuators, other.wheel_actuators)

    def test_rays_see_the_same_bodies(self) -> None:
        """Shapes of a former generation are looked at once; so are those behind what changed."""
        other = robot_model("other")
        former = compiled(ROBOT, ROBOT, ROBOT)
        known = DynamicGeometry(former)
        for slots in ([ROBOT] * 5, [ROBOT, other, ROBOT], [ROBOT], [ROBOT, VACANT, ROBOT, other]):
            blueprint = Blueprint(floor()(), PhysicsOptions())
            blueprint.add(slots)
            world = blueprint.compile(1, former)
            found, fresh = DynamicGeometry(world, known), DynamicGeometry(world)
            shown = [(one.body, one.geoms) for one in found._bodies]
            assert shown == [(one.body, one.geoms) for one in fresh._bodies]
            assert found._scenes.keys() == fresh._scenes.keys()
            assert {id(one.full) for one in found._bodies} == set(map(id, found._scene_list))


def stored(model: mujoco.MjModel) -> bytes:
    """A model as MuJoCo would write it to a file."""
    buffer = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def test_robot_of_the_tests_is_that_of_the_reference() -> None:
    """The test robot weighs 12 kg on a half base of 0.1331 and a half track of 0.197 m."""
    model = build_robot().compile()
    assert model.body_subtreemass[1] == pytest.approx(12.0)
    wheel = model.body("front_right").pos
    np.testing.assert_allclose(wheel, [HALF_BASE, -HALF_TRACK, 0.0])
