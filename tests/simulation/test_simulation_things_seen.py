"""What rays and sensors see of things: glass, names, materials."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from sim_fakes import Geom, floor, simulation

from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import RobotModel
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.simulation import Simulation


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
    fan = RayFan(
        np.array([0.0, 0.0, 0.5]),
        np.array([[1.0, 0.0, 0.0]]),
        20.0,
        through_glass=through_glass,
        identify=True,
    )
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
