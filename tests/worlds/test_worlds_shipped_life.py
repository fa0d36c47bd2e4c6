"""The shipped worlds: signs of life, tags and sounds."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from shipped_worlds import Built, build

from usarsim_server.worlds.life import Walk, Wave, traits_of
from usarsim_server.worlds.surroundings import Surroundings
from usarsim_server.worlds.victims import part_of

INHABITED = ("arena", "office")


def moved(built: Built, time: float) -> mujoco.MjData:
    """The world with everybody where he is at a time."""
    data = mujoco.MjData(built.model)
    for mover in Surroundings(built.world).movers:
        index, pose = built.model.body(mover.body).mocapid[0], mover.pose(time)
        data.mocap_pos[index], data.mocap_quat[index] = pose.position, pose.quaternion
    mujoco.mj_kinematics(built.model, data)
    return data


def test_the_arena_has_every_sign_of_life(arena: Built) -> None:
    """Voices, breath, tags, somebody who waves, somebody who walks, a sound, a false alarm."""
    traits = [traits_of(victim) for victim in arena.world.victims]
    assert {type(one.motion) for one in traits} == {type(None), Wave, Walk}
    assert any(one.voice for one in traits)
    assert sum(one.co2 > 0.0 for one in traits) == 9
    assert sum(one.tag is not False for one in traits) >= 3
    assert len(arena.world.tags) == 10
    assert [tag.single_shot for tag in arena.world.tags].count(True) == 1
    assert len(arena.world.sounds) == 1
    assert len(arena.world.false_alarms) == 1


@pytest.mark.parametrize("name", INHABITED)
def test_everything_lies_inside_the_bounds(name: str) -> None:
    """Tags, sounds, false alarms and the ends of walks are where robots can go."""
    world = build(name).world
    places = [tag.position for tag in world.tags] + [one.position for one in world.sounds]
    for alarm in world.false_alarms:
        places += [alarm.lower, alarm.upper]
    motions = [traits_of(victim).motion for victim in world.victims]
    places += [motion.to for motion in motions if isinstance(motion, Walk)]
    assert places
    for place in places:
        limits = zip(world.lower, place, world.upper, strict=True)
        assert all(low <= value <= high for low, value, high in limits), place


@pytest.mark.parametrize("name", INHABITED)
def test_tags_lie_on_the_ground_or_on_rubble(name: str) -> None:
    """Every tag is within 0.5 m above what is below it."""
    built = build(name)
    for tag in built.world.tags:
        x, y, z = tag.position
        assert -0.35 < z - built.height(x, y) < 0.5, tag.id


@pytest.mark.parametrize("name", INHABITED)
def test_nobody_walks_or_waves_through_things(name: str) -> None:
    """Whoever moves keeps clear of the scenery and of other people, all the time."""
    built = build(name)
    model = built.model
    movers = Surroundings(built.world).movers
    assert movers
    for mover in movers:
        owner = model.body(mover.body).name.partition("/")[0]
        own = np.flatnonzero(model.geom_bodyid == model.body(mover.body).id)
        others = [
            geom
            for geom in range(model.ngeom)
            if model.geom_contype[geom] and not model.geom(geom).name.startswith(owner + ":")
        ]
        for time in np.arange(0.0, 16.0, 0.8):
            data = moved(built, float(time))
            middle = np.mean(data.geom_xpos[own], axis=0)
            near = [
                geom
                for geom in others
                if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
                or math.dist(data.geom_xpos[geom], middle) < model.geom_rbound[geom] + 1.5
            ]
            for geom in own:
                for other in near:
                    gap = mujoco.mj_geomDistance(model, data, geom, other, 0.5, None)
                    names = model.geom(geom).name, model.geom(other).name
                    assert gap > -0.013, (names, time)


def test_false_alarms_are_far_from_people(arena: Built) -> None:
    """No victim is inside a box that is taken for one."""
    (alarm,) = arena.world.false_alarms
    for victim in Surroundings(arena.world).victims:
        for part in victim.parts(0.0):
            limits = zip(alarm.lower, part.position, alarm.upper, strict=True)
            assert not all(low - 1 <= value <= high + 1 for low, value, high in limits)


def test_the_false_alarm_is_seen_from_around(arena: Built) -> None:
    """The box is larger than the barrel in it, so rays meet it before the barrel."""
    (alarm,) = arena.world.false_alarms
    barrel = next(
        geom
        for geom in arena.geoms("barrel")
        if math.dist(arena.data.geom_xpos[geom][:2], (4.0, -8.2)) < 0.01
    )
    radius = float(arena.model.geom_size[barrel][0])
    for axis in (0, 1):
        centre = float(arena.data.geom_xpos[barrel][axis])
        assert alarm.lower[axis] < centre - radius - 0.02
        assert alarm.upper[axis] > centre + radius + 0.02


@pytest.mark.parametrize("name", INHABITED)
def test_moving_people_are_whole_at_all_times(name: str) -> None:
    """The waving forearm hangs on the elbow: upper and lower arm touch whatever the time."""
    built = build(name)
    model = built.model
    wavers = [m.body for m in Surroundings(built.world).movers if m.body.endswith("/forearm")]
    assert wavers
    for body in wavers:
        victim = body.removesuffix("/forearm")
        upper, lower = (model.geom(f"{victim}:Arm{part}Right").id for part in ("Upper", "Lower"))
        assert part_of(model.geom(lower).name) == (victim.removeprefix("victim:"), "Arm")
        for time in np.arange(0.0, 2.0, 0.1):
            data = moved(built, float(time))
            assert mujoco.mj_geomDistance(model, data, upper, lower, 1.0, None) < 0.0
