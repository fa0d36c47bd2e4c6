"""Where one can walk: ground, walls, steps."""

from __future__ import annotations

import itertools
import math

import mujoco
import pytest

from usarsim_server.base.errors import SpawnError
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.worlds.avatars.ways import DISTANCE, FARTHEST, ground_below, survey
from usarsim_server.worlds.objects.world_object import drop_below

BOX = mujoco.mjtGeom.mjGEOM_BOX


def yard() -> mujoco.MjSpec:
    """A slab with a wall, a ramp, a low and a high step, a table, a bridge and a crate."""
    spec = mujoco.MjSpec()
    add = spec.worldbody.add_geom
    add(name="slab", type=BOX, size=[20, 20, 0.5], pos=[0, 0, -0.5])
    add(name="wall", type=BOX, size=[0.1, 2, 1.25], pos=[5, 0, 1.25])
    angle = math.radians(10)
    ramp = [math.cos(angle / 2), 0, -math.sin(angle / 2), 0]
    add(name="ramp", type=BOX, size=[3, 1, 0.05], pos=[0, 5, 0.45], quat=ramp)
    add(name="low", type=BOX, size=[1, 1, 0.1], pos=[0, -5, 0.1])
    add(name="high", type=BOX, size=[1, 1, 0.2], pos=[6, -5, 0.2])
    add(name="bridge", type=BOX, size=[1, 3, 0.1], pos=[-6, 0, 2.4])
    crate = spec.worldbody.add_body(name="crate", pos=[-3, -8, 0.25])
    crate.add_freejoint()
    crate.add_geom(type=BOX, size=[0.25] * 3, mass=2)
    return spec


@pytest.fixture(scope="module")
def world() -> Simulation:
    """The yard."""
    return Simulation(yard, SimulationOptions(speed=math.inf))


def test_ground_below(world: Simulation) -> None:
    """The height of what is fixed and below; nothing beyond the slab; crates do not count."""
    points = [(9.0, 9.0, 3.0), (0.0, -5.0, 1.0), (-6.0, 0.0, 1.0), (-6.0, 0.0, 5.0)]
    assert ground_below(world, points) == pytest.approx([0.0, 0.2, 0.0, 2.5], abs=1e-5)
    assert ground_below(world, [(-3.0, -8.0, 2.0)]) == pytest.approx([0.0], abs=1e-5)
    assert ground_below(world, [(99.0, 0.0, 1.0)]) == [-math.inf]
    assert ground_below(world, []) == []


@pytest.mark.parametrize("far", [400.0, 1e9, 1e300])
def test_the_end_of_the_world_is_not_looked_for(far: float) -> None:
    """A way goes so far and no farther, and is not even counted out beyond."""

    def plain() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        return spec

    seen = survey(Simulation(plain, SimulationOptions(speed=math.inf)), (0.0, 0.0, 0.0), (far, 0.0))
    assert seen.obstacle == "its length"
    assert seen.profile[-1][0] == pytest.approx(FARTHEST)


def test_a_free_way(world: Simulation) -> None:
    """The profile leads from start to goal in small steps along the floor."""
    seen = survey(world, (0.0, 8.0, 0.0), (3.05, 8.0))
    assert seen.obstacle is None
    assert seen.profile[0] == (0.0, 8.0, 0.0)
    assert seen.profile[-1][:2] == pytest.approx((3.05, 8.0))
    assert all(abs(z) < 1e-5 for _, _, z in seen.profile)
    assert len(seen.profile) == 32


def test_a_wall_ends_the_way_before_it(world: Simulation) -> None:
    """One stops at arm's length, also if the wall meets only a shoulder."""
    for y in (0.0, 2.15):
        seen = survey(world, (2.0, y, 0.0), (8.0, y))
        assert seen.obstacle == "a wall"
        assert 0.0 <= 4.9 - DISTANCE - seen.profile[-1][0] < 0.1 + 1e-6
    assert survey(world, (2.0, 2.3, 0.0), (8.0, 2.3)).obstacle is None


def test_one_may_walk_away_from_a_wall(world: Simulation) -> None:
    """What is behind does not count."""
    assert survey(world, (4.7, 0.0, 0.0), (0.0, 0.0)).obstacle is None


def test_a_ramp_is_followed(world: Simulation) -> None:
    """The profile rises with a gentle slope."""
    seen = survey(world, (-4.0, 5.0, 0.0), (2.0, 5.0))
    assert seen.obstacle is None
    heights = [z for _, _, z in seen.profile]
    assert heights[-1] == pytest.approx(0.45 + 2 * math.tan(math.radians(10)) + 0.05, abs=0.01)
    assert max(b - a for a, b in itertools.pairwise(heights)) < 0.05


def test_steps(world: Simulation) -> None:
    """20 cm are climbed, 40 cm are not."""
    over = survey(world, (-3.0, -5.0, 0.0), (3.0, -5.0))
    assert over.obstacle is None
    assert max(z for _, _, z in over.profile) == pytest.approx(0.2, abs=1e-5)
    before = survey(world, (3.0, -5.0, 0.0), (8.0, -5.0))
    assert before.obstacle == "a step"
    assert before.profile[-1][0] <= 5.0


def test_one_passes_under_a_bridge(world: Simulation) -> None:
    """What is overhead is neither ground nor obstacle."""
    seen = survey(world, (-9.0, 0.0, 0.0), (-3.0, 0.0))
    assert seen.obstacle is None
    assert all(abs(z) < 1e-5 for _, _, z in seen.profile)


def test_the_edge_of_the_world_is_a_step(world: Simulation) -> None:
    """Nobody walks off the slab."""
    seen = survey(world, (18.0, 8.0, 0.0), (25.0, 8.0))
    assert seen.obstacle == "a step"
    assert seen.profile[-1][0] < 20.05


def test_going_nowhere(world: Simulation) -> None:
    """A way of no length has a profile all the same."""
    assert survey(world, (1.0, 8.0, 0.0), (1.0, 8.0)).profile == ((1.0, 8.0, 0.0),) * 2


def test_drops(world: Simulation) -> None:
    """An object drops to the highest thing below its outline, crates included, or has to rise."""
    half = (0.2, 0.2, 0.2)
    assert drop_below(world, Pose((9.0, 9.0, 2.0)), half) == pytest.approx(1.9, abs=1e-4)
    assert drop_below(world, Pose((9.0, 9.0, 0.05)), half) == pytest.approx(-0.05, abs=1e-4)
    assert drop_below(world, Pose((1.05, -5.0, 2.0)), half) == pytest.approx(1.7, abs=1e-4)
    assert drop_below(world, Pose((-3.0, -8.0, 2.0)), half) == pytest.approx(1.4, abs=1e-4)
    turned = Pose((9.0, 9.0, 2.0), (math.cos(math.pi / 8), math.sin(math.pi / 8), 0.0, 0.0))
    assert drop_below(world, turned, half) == pytest.approx(2.0 - 0.1 * math.sqrt(2), abs=1e-4)
    with pytest.raises(SpawnError, match="nothing below"):
        drop_below(world, Pose((99.0, 0.0, 1.0)), half)
