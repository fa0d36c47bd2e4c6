"""Geoms that are only seen and geoms that only collide: groups 0 to 2 against group 3."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from sim_fakes import RADIUS, Geom, floor, pose_at, robot_model, simulation

from usarsim_server.simulation.rays.query import RayFan

DOWN = RayFan(np.array([3.0, 0.0, 5.0]), np.array([[0.0, 0.0, -1.0]]), 50.0, identify=True)


def stage(movable: bool) -> mujoco.MjSpec:
    """A floor, a picture of a box 1 m high that nobody touches, and a solid of 0.4 m in it."""
    spec = floor()()
    body = spec.worldbody.add_body(name="thing", pos=[3.0, 0.0, 0.0])
    if movable:
        body.add_freejoint()
    body.add_geom(
        name="seen",
        type=Geom.mjGEOM_BOX,
        size=[0.5, 0.5, 0.5],
        pos=[0.0, 0.0, 0.5],
        contype=0,
        conaffinity=0,
        group=2,
        mass=0.0,
    )
    body.add_geom(
        name="felt", type=Geom.mjGEOM_BOX, size=[0.5, 0.5, 0.2], pos=[0.0, 0.0, 0.2], group=3
    )
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
