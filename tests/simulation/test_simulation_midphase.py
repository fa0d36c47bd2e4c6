"""Trees of boxes for the search for contacts: shorter ways to the same contacts."""

from __future__ import annotations

from unittest import mock

import mujoco
import numpy as np
from sim_fakes import ROBOT, Geom, add_box, add_crate, engine_with, floor, run, straight, turn

from usarsim_server.simulation import midphase
from usarsim_server.simulation import model as model_module
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions, compile_world


def posts() -> mujoco.MjSpec:
    """A floor with 49 posts on a grid, a slab that touches nothing, and a crate."""
    spec = floor()()
    for x in range(7):
        for y in range(7):
            add_box(spec, f"post{x}{y}", (1.3 * x - 3.3, 1.3 * y - 3.3, 0.2), (0.1, 0.1, 0.2))
    spec.worldbody.add_geom(
        type=Geom.mjGEOM_BOX, size=[4.0, 4.0, 0.001], contype=0, conaffinity=0, name="paint"
    )
    add_crate(spec, "crate", (0.9, 0.0, 0.15))
    return spec


def driven() -> Engine:
    """Three robots among the posts, into posts, the crate and each other, for 0.8 s."""
    engine = engine_with((0.0, 0.0), (-0.7, 0.1), (-2.0, 0.3), scenery=posts)
    for robot, targets in enumerate((straight(4.0), straight(6.0), turn(3.0))):
        engine.drive(robot, targets)
    run(engine, 0.8)
    return engine


def test_motion_and_contacts_are_the_same_to_the_bit() -> None:
    """MuJoCo sorts what it finds, so V26 holds across trees as well."""
    mine = driven()
    with mock.patch.object(model_module, "improve_trees", autospec=True):
        compiled = driven()
    assert not np.array_equal(mine.world.model.bvh_child, compiled.world.model.bvh_child)
    assert np.array_equal(mine.data.qpos, compiled.data.qpos)
    found = mine.data.contact.geom
    assert np.array_equal(found, compiled.data.contact.geom)
    meetings = (found != 0).all(axis=1)
    assert meetings.any(), "nobody met anything but the floor"


def test_every_geom_is_once_in_a_tree_whose_boxes_hold_each_other() -> None:
    """Whatever is left out, or sticks out, would be driven through."""
    model = compile_world(posts, [ROBOT], PhysicsOptions(), generation=0).model
    start, count = int(model.body_bvhadr[0]), int(model.body_bvhnum[0])
    children, boxes = model.bvh_child[start : start + count], model.bvh_aabb[start : start + count]
    numbers = model.bvh_nodeid[start : start + count]
    geoms = np.flatnonzero((model.geom_bodyid == 0) & (model.geom_contype != 0))
    assert sorted(numbers[numbers >= 0]) == geoms.tolist()
    seen = {0}
    for node in np.flatnonzero(numbers < 0):
        for child in children[node]:
            seen.add(int(child))
            # MuJoCo gives a plane a box of 1e10 m, which leaves 2e-6 m for rounding.
            gap = np.abs(boxes[child, :3] - boxes[node, :3]) + boxes[child, 3:] - boxes[node, 3:]
            assert (gap < 4e-6).all()
            assert model.bvh_depth[start + child] == model.bvh_depth[start + node] + 1
    assert seen == set(range(count))


def test_planes_stand_at_the_top_and_a_way_to_a_post_is_short() -> None:
    """That is what the tree is for: 51 geoms, of which one has boxes without end around it."""
    model = compile_world(posts, [ROBOT], PhysicsOptions(), generation=0).model
    span = slice(int(model.body_bvhadr[0]), int(model.body_bvhadr[0] + model.body_bvhnum[0]))
    endless = model.bvh_aabb[span, 3:].max(axis=1) > 1e6
    assert endless.sum() == 2, "the root and the plane"
    assert model.bvh_depth[span].max() <= 12


def test_bodies_with_too_many_geoms_keep_their_trees() -> None:
    """Starting a large world must not take much longer."""
    with mock.patch.object(midphase, "MOST", 20):
        kept = compile_world(posts, [], PhysicsOptions(), generation=0).model
    with mock.patch.object(model_module, "improve_trees", autospec=True):
        plain = compile_world(posts, [], PhysicsOptions(), generation=0).model
    assert np.array_equal(kept.bvh_child, plain.bvh_child)
