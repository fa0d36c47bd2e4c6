"""The shipped worlds: what robots and sensors of life find in them, where people can walk."""

from __future__ import annotations

import itertools
import math
from collections import Counter, deque
from pathlib import Path

import mujoco
import numpy as np
import pytest
from shipped_worlds import NAMES, Built, build, movable_bodies

from usarsim_server.app import assemble
from usarsim_server.assembly import Assembly
from usarsim_server.settings import Settings
from usarsim_server.simulation.frames import rpy_from_quaternion
from usarsim_server.worlds.avatars.ways import distances_to, ground_below, survey
from usarsim_server.worlds.description import PARTS
from usarsim_server.worlds.life import Walk, Wave, traits_of
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.machinery.machinery import Spring
from usarsim_server.worlds.scene import build_scene
from usarsim_server.worlds.surroundings import Surroundings
from usarsim_server.worlds.victims import part_of

STEP = 0.2
"""Grid of the reachability search, m."""


# ---- all worlds ---------------------------------------------------------------------------


def test_starts_are_quarter_of_a_metre_above_the_floor(shipped: Built) -> None:
    """Start poses lie 0.25 m above whatever is below them (worlds reference 3, start height)."""
    for start in shipped.world.starts:
        x, y, z = start.pose.position
        assert z - shipped.height(x, y, above=z) == pytest.approx(0.25, abs=1e-6), start.tag


def test_starts_are_level_and_free(shipped: Built) -> None:
    """A 0.6 x 0.6 x 0.3 m box fits at every start: on the ground it touches only the ground."""
    for start in shipped.world.starts:
        x, y, z = start.pose.position
        roll, pitch, yaw = rpy_from_quaternion(start.pose.quaternion)
        assert (roll, pitch) == (0.0, 0.0)
        floor = z - 0.25
        lifted = shipped.touched(x, y, floor + 0.15 + 0.01, yaw)
        assert lifted == set(), f"{start.tag} touches {lifted}"
        standing = shipped.touched(x, y, floor + 0.15 - 0.001, yaw)
        assert standing, f"{start.tag} stands on nothing"
        assert all(name.startswith(("floor", "platform")) for name in standing), standing


def test_starts_keep_their_distance(shipped: Built) -> None:
    """Any two starts are at least 1.2 m apart."""
    places = [start.pose.position for start in shipped.world.starts]
    distances = [math.dist(a, b) for a, b in itertools.combinations(places, 2)]
    assert min(distances) >= 1.2 - 1e-9


def test_sixteen_robots_can_start(shipped: Built) -> None:
    """Every world has at least sixteen starts; robot worlds call them RobotStart1 to 16."""
    tags = [start.tag for start in shipped.world.starts]
    assert len(tags) >= 16
    if shipped.world.name != "proving_ground":
        assert tags == [f"RobotStart{n}" for n in range(1, 17)]


def test_things_to_push_stay_at_rest(shipped: Built) -> None:
    """Movable bodies stand still for 2 s at the server's settings (robots reference 4.10)."""
    model = build_scene(shipped.world).compile()
    model.opt.timestep = 0.004
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model.opt.impratio = 10.0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.xpos.copy()
    mujoco.mj_step(model, data, 500)
    assert not any(data.warning[n].number for n in range(len(data.warning)))
    assert np.abs(data.xpos - before).max() < 0.002
    assert np.abs(data.qvel).max(initial=0.0) < 0.001


def test_movable_bodies_have_names_and_handy_masses(shipped: Built) -> None:
    """Whatever can be pushed has a name and weighs 1 to 8 kg."""
    for name in shipped.movable:
        assert 0.99 <= shipped.model.body(name).mass[0] <= 8.0, name
    assert len(set(shipped.movable)) == len(shipped.movable)


def test_every_static_geom_is_named_and_has_a_material(shipped: Built) -> None:
    """Sensors report names and materials; only victims go without a material."""
    model = shipped.model
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        assert name
        if name != "probe" and part_of(name) is None:
            assert model.geom_matid[geom] >= 0, name


def test_scenery_is_cheap(shipped: Built) -> None:
    """Boxes, one plane, few meshes, under 800 geoms; joints have only what is pushed."""
    model = shipped.model
    kinds = Counter(model.geom_type.tolist())
    assert model.ngeom < 800
    assert kinds[int(mujoco.mjtGeom.mjGEOM_PLANE)] == 1
    assert kinds[int(mujoco.mjtGeom.mjGEOM_MESH)] <= 40
    flaps = sum(
        door.leaves for door in shipped.world.machinery.doors if isinstance(door.mechanism, Spring)
    )
    assert model.nv == 6 * len(shipped.movable) + flaps + 6  # and the probe


def test_floors_and_ramps_grip_and_walls_do_less(shipped: Built) -> None:
    """Friction is 1.0 on what is driven on, 0.5 elsewhere; condim is 3 (robots reference 4.10)."""
    model = shipped.model
    for geom in range(model.ngeom):
        name = model.geom(geom).name.rpartition("_")[0]
        if name in {"floor", "crossing_ramp", "step_post", "stair", "incline", "platform"}:
            assert model.geom_friction[geom][0] == 1.0
        elif name in {"wall", "panel", "outer", "corridor"}:
            assert model.geom_friction[geom][0] == 0.5
        assert model.geom_condim[geom] == 3


def test_names_are_unique_across_victims_and_scenery(shipped: Built) -> None:
    """Starts, victims, zones and path nodes have names of their own, whatever their capitals."""
    world = shipped.world
    for names in (
        [start.tag for start in world.starts],
        [victim.name for victim in world.victims],
        [zone.name for zone in world.zones],
        [node.tag for node in world.path_nodes],
    ):
        assert len({name.lower() for name in names}) == len(names)


def test_starts_victims_and_zones_lie_inside_the_bounds(shipped: Built) -> None:
    """Nothing is placed where robots are refused."""
    world = shipped.world
    for pose in [item.pose for item in (*world.starts, *world.victims)]:
        limits = zip(world.lower, pose.position, world.upper, strict=True)
        assert all(low <= value <= high for low, value, high in limits)
    for zone in world.zones:
        assert world.lower[0] <= zone.x[0] < zone.x[1] <= world.upper[0]
        assert world.lower[1] <= zone.y[0] < zone.y[1] <= world.upper[1]


def test_path_nodes_are_free_ground_and_the_graph_is_mutual(shipped: Built) -> None:
    """A robot can stand at every node, and roads lead both ways."""
    nodes = {node.tag: node for node in shipped.world.path_nodes}
    for node in nodes.values():
        x, y, z = node.position
        assert shipped.touched(x, y, z + 0.16) == set(), node.tag
        assert all(node.tag in nodes[other].neighbours for other in node.neighbours)


def test_every_victim_is_whole(shipped: Built) -> None:
    """Each victim has its body and geoms of all seven parts (robots reference 1.12)."""
    found: dict[str, set[str]] = {}
    for geom in range(shipped.model.ngeom):
        part = part_of(shipped.model.geom(geom).name)
        if part is not None:
            found.setdefault(part[0], set()).add(part[1])
    assert found == {victim.name: set(PARTS) for victim in shipped.world.victims}


def test_victims_are_named_like_the_original_actors(shipped: Built) -> None:
    """Scoring tools know MaleVictim and FemaleVictim (side channels reference 7)."""
    for number, victim in enumerate(shipped.world.victims):
        figure = str(victim.properties["figure"])
        assert victim.name == f"{figure.capitalize()}Victim_{number}"


def test_copies_of_a_world_folder_work_anywhere(shipped: Built, tmp_path: Path) -> None:
    """A world folder is complete in itself: scene and sheet, no other files."""
    copy = tmp_path / shipped.world.name
    copy.mkdir()
    for name in ("scene.xml", "world.toml"):
        (copy / name).write_bytes((shipped.world.folder / name).read_bytes())
    assert movable_bodies(build_scene(load_world(copy))) == shipped.movable


# ---- reachability -------------------------------------------------------------------------


def reachable(name: str) -> set[tuple[int, int]]:
    """Grid cells a disc-like robot of 0.5 m reaches on level ground from the first start."""
    built = build(name, (0.5, 0.5, 0.2))
    x0, y0, _ = built.world.starts[0].pose.position
    low, high = built.world.lower, built.world.upper
    seen = {(0, 0)}
    queue = deque(seen)
    while queue:
        i, j = queue.popleft()
        for cell in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            x, y = x0 + cell[0] * STEP, y0 + cell[1] * STEP
            inside = low[0] < x < high[0] and low[1] < y < high[1]
            if cell not in seen and inside and not built.touched(x, y, 0.12):
                seen.add(cell)
                queue.append(cell)
    return {(cell[0], cell[1]) for cell in seen}


def places(name: str) -> np.ndarray:
    """Points (n, 2) of the reachable cells, m."""
    x0, y0, _ = build(name).world.starts[0].pose.position
    return np.array([x0, y0]) + STEP * np.array(sorted(reachable(name)))


@pytest.mark.parametrize("name", ["arena", "office", "smoke_corridor"])
def test_every_victim_can_be_approached_on_wheels(name: str) -> None:
    """A robot comes within 1.5 m of every victim without climbing (on a landing: beside it)."""
    ground = places(name)
    for victim in build(name).world.victims:
        distance = np.hypot(*(ground - np.array(victim.pose.position[:2])).T).min()
        assert distance < 1.5, victim.name


def test_every_room_of_the_office_can_be_entered() -> None:
    """From the lobby a robot of 0.5 m reaches the middle part of all fourteen rooms."""
    ground = places("office")
    zones = build("office").world.zones
    assert len(zones) == 14
    for zone in zones:
        inside = (ground[:, 0] > zone.x[0] + 0.8) & (ground[:, 0] < zone.x[1] - 0.8)
        inside &= (ground[:, 1] > zone.y[0] + 0.8) & (ground[:, 1] < zone.y[1] - 0.8)
        assert inside.sum() >= 4, zone.name


def test_all_names_are_tested() -> None:
    """This file looks at every folder of worlds there is."""
    from usarsim_server.base.files import data_directory

    folders = {path.name for path in data_directory("worlds").iterdir() if path.is_dir()}
    assert folders == set(NAMES)


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


@pytest.fixture(scope="module", params=["arena", "office"])
def walkable(request: pytest.FixtureRequest) -> Assembly:
    """A shipped world that has path nodes."""
    return assemble(Settings(world=request.param, speed=math.inf, port=None))


def test_nodes_lie_on_the_ground(walkable: Assembly) -> None:
    """The height of every node is that of the floor there."""
    for node in walkable.world.path_nodes:
        x, y, z = node.position
        (height,) = ground_below(walkable.simulation, [(x, y, z + 1.0)])
        assert height == pytest.approx(z, abs=0.02), node.tag


def test_every_connection_can_be_walked(walkable: Assembly) -> None:
    """No wall and no high step between neighbours, in either direction."""
    places = {node.tag: node.position for node in walkable.world.path_nodes}
    for node in walkable.world.path_nodes:
        for other in node.neighbours:
            for one, goal in ((node.tag, other), (other, node.tag)):
                seen = survey(walkable.simulation, places[one], places[goal][:2])
                assert seen.obstacle is None, f"{one} to {goal} at {seen.profile[-1]}"


def test_connections_have_two_ends(walkable: Assembly) -> None:
    """Neighbours name each other, and every node can be reached from every other."""
    nodes = {node.tag: node for node in walkable.world.path_nodes}
    for node in nodes.values():
        assert all(node.tag in nodes[other].neighbours for other in node.neighbours), node.tag
    assert distances_to(walkable.world.path_nodes, next(iter(nodes))).keys() == nodes.keys()
