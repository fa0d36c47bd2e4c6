"""The shipped worlds: what a robot finds in them."""

from __future__ import annotations

import itertools
import math
from collections import Counter, deque
from pathlib import Path

import mujoco
import numpy as np
import pytest
from conftest import NAMES, Built, build

from usarsim_server.simulation.frames import rpy_from_quaternion
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene, movable_bodies
from usarsim_server.worlds.victims import PARTS, part_of

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
    """Boxes, one plane, few meshes, under 800 geoms; nothing static has a joint."""
    model = shipped.model
    kinds = Counter(model.geom_type.tolist())
    assert model.ngeom < 800
    assert kinds[int(mujoco.mjtGeom.mjGEOM_PLANE)] == 1
    assert kinds[int(mujoco.mjtGeom.mjGEOM_MESH)] <= 40
    assert model.nv == 6 * len(shipped.movable) + 6  # and the probe


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


@pytest.mark.parametrize("name", ["arena", "office"])
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


# ---- arena --------------------------------------------------------------------------------


def test_the_arena_has_coloured_zones_side_by_side(arena: Built) -> None:
    """Yellow, orange, red and staging cover the hall without overlap."""
    zones = {zone.name: zone for zone in arena.world.zones}
    assert {"yellow", "orange", "red"} <= set(zones)
    areas = [(z.x[1] - z.x[0]) * (z.y[1] - z.y[0]) for z in zones.values()]
    assert sum(areas) == pytest.approx(24.0 * 20.0)
    for a, b in itertools.combinations(zones.values(), 2):
        apart_x = a.x[1] <= b.x[0] or b.x[1] <= a.x[0]
        apart_y = a.y[1] <= b.y[0] or b.y[1] <= a.y[0]
        assert apart_x or apart_y


def test_zones_are_painted_and_paint_is_not_touched(arena: Built) -> None:
    """The floor of each zone has its colour, level with the ground and without contact."""
    model = arena.model
    for zone in ("yellow", "orange", "red"):
        geom = model.geom(f"{zone}_1")
        assert model.mat(int(geom.matid[0])).name == f"floor_{zone}"
        assert geom.contype[0] == geom.conaffinity[0] == 0
        assert geom.pos[2] + geom.size[2] == pytest.approx(0.0, abs=1e-9)
    assert {model.mat(int(model.geom_matid[g])).name for g in arena.geoms("line")} == {"line_blue"}
    assert len(arena.geoms("line")) == 3


def test_the_arena_has_victims_in_all_zones_and_postures(arena: Built) -> None:
    """At least eight victims, three postures, some in every coloured zone."""
    victims = arena.world.victims
    assert len(victims) >= 8
    assert {victim.posture for victim in victims} == {"standing", "sitting", "lying"}
    assert {victim.status for victim in victims} >= {"Alive", "Injured", "Unconscious", "Dead"}
    zones = {z.name: z for z in arena.world.zones if z.name != "staging"}
    counts: Counter[str] = Counter()
    for victim in victims:
        x, y, _ = victim.pose.position
        counts.update(
            name for name, z in zones.items() if z.x[0] <= x < z.x[1] and z.y[0] <= y < z.y[1]
        )
    assert all(counts[name] >= 3 for name in zones)


def test_the_arena_has_crates(arena: Built) -> None:
    """Six to ten crates of 1 to 4 kg can be pushed."""
    assert 6 <= len(arena.movable) <= 10
    masses = [arena.model.body(name).mass[0] for name in arena.movable]
    assert min(masses) >= 0.999
    assert max(masses) <= 4.001


def slope(built: Built, x: float, y: float, dx: float, dy: float) -> float:
    """Degrees by which the ground rises along a horizontal direction, measured over 0.1 m."""
    reach = 0.05 / math.hypot(dx, dy)
    ahead = built.height(x + reach * dx, y + reach * dy)
    behind = built.height(x - reach * dx, y - reach * dy)
    return math.degrees(math.atan2(ahead - behind, 0.1))


def test_crossing_ramps_alternate_at_15_degrees(arena: Built) -> None:
    """Neighbouring ramps rise in opposite directions at 15 degrees (robots reference 3.3)."""
    for i in range(4):
        for j in range(6):
            x, y = -6.6 + 1.2 * (i + 0.5), -3.9 + 0.6 * (j + 0.5)
            expected = 15.0 if (i + j) % 2 == 0 else -15.0
            assert slope(arena, x, y, 1.0, 0.0) == pytest.approx(expected, abs=0.01)
            assert slope(arena, x, y, 0.0, 1.0) == pytest.approx(0.0, abs=0.01)


def test_continuous_ramps_have_no_steps(arena: Built) -> None:
    """Along the pitch ramps the height changes by no more than 15 degrees allow."""
    xs = -0.39 + 0.02 * np.arange(240)
    heights = np.array([arena.height(x, -2.1) for x in xs])
    assert np.abs(np.diff(heights)).max() <= 0.02 * math.tan(math.radians(15.0)) + 1e-7
    assert heights.max() == pytest.approx(1.2 * math.tan(math.radians(15.0)), abs=0.006)
    assert slope(arena, 5.0, -2.7, 0.0, 1.0) == pytest.approx(15.0, abs=0.01)
    assert slope(arena, 5.0, -1.5, 0.0, 1.0) == pytest.approx(-15.0, abs=0.01)


def test_the_orange_step_field_is_0_to_6_cm_and_the_red_0_5_10(arena: Built) -> None:
    """Robots reference 3.3 V19 and V20: posts of 10 cm in a square of 12 x 12, symmetric."""
    for corner, levels in (((-5.4, -6.6), range(7)), ((5.3, 3.0), (0, 5, 10))):
        tops = np.array(
            [
                [
                    arena.height(corner[0] + 0.1 * i + 0.05, corner[1] + 0.1 * j + 0.05)
                    for j in range(12)
                ]
                for i in range(12)
            ]
        )
        centimetres = np.round(100 * tops).astype(int)
        assert tops == pytest.approx(centimetres / 100, abs=1e-6)
        assert set(centimetres.ravel()) == set(levels)
        assert np.array_equal(centimetres, centimetres[::-1, ::-1])


def test_the_landing_has_a_ramp_on_one_side_and_stairs_on_the_other(arena: Built) -> None:
    """A plane of 15 degrees leads to 1.08 m, six risers of 18 cm lead down (V21's stairs)."""
    assert slope(arena, -5.0, -9.2, 1.0, 0.0) == pytest.approx(15.0, abs=0.01)
    landing = arena.model.geom("landing_1")
    top = landing.pos[2] + landing.size[2]
    assert top == pytest.approx(1.08)
    edge = landing.pos[0] + landing.size[0]
    tops = [arena.height(edge + 0.28 * n + 0.14, -9.3) for n in range(5)]
    assert tops == pytest.approx([0.90, 0.72, 0.54, 0.36, 0.18], abs=1e-6)
    assert arena.height(edge + 5 * 0.28 + 0.05, -9.3) == pytest.approx(0.0, abs=1e-6)


# ---- office -------------------------------------------------------------------------------


def test_the_office_has_its_size_and_rooms(office: Built) -> None:
    """Thirty by twenty metres inside, at least ten rooms besides lobby and corridor."""
    x = [zone.x for zone in office.world.zones]
    y = [zone.y for zone in office.world.zones]
    assert (min(x)[0], max(high for _, high in x)) == (-15.0, 15.0)
    assert (min(y)[0], max(high for _, high in y)) == (-10.0, 10.0)
    rooms = [zone for zone in office.world.zones if zone.kind not in ("lobby", "corridor")]
    assert len(rooms) >= 10


def test_doors_are_at_least_90_cm_wide() -> None:
    """A box of 0.9 x 0.9 m and 2 m height fits under every lintel that has no pane below."""
    built = build("office", (0.9, 0.9, 1.98))
    model = built.model
    lintels = [g for g in range(model.ngeom) if "_lintel_" in model.geom(g).name]
    panes = {
        tuple(np.round(model.geom_pos[g][:2], 3))
        for g in range(model.ngeom)
        if "_pane_" in model.geom(g).name
    }
    doors = [g for g in lintels if tuple(np.round(model.geom_pos[g][:2], 3)) not in panes]
    assert len(doors) >= 13
    for geom in doors:
        x, y, _ = model.geom_pos[geom]
        touched = built.touched(x, y, 1.0)
        assert touched == set(), f"{model.geom(geom).name}: {touched}"


def test_radio_and_lasers_find_their_materials(office: Built) -> None:
    """Walls are of concrete or brick; the meeting room's front is of glass."""
    model = office.model

    def material(geom: int) -> str:
        return str(model.mat(int(model.geom_matid[geom])).name)

    assert all("concrete" in material(geom) for geom in office.geoms("outer"))
    for wall in ("corridor", "north", "south", "lobby", "kitchen"):
        assert all("brick" in material(geom) for geom in office.geoms(wall))
    panes = office.geoms("meeting_pane")
    assert len(panes) == 3
    assert {material(geom) for geom in panes} == {"glass"}
    assert 0.0 < model.mat("glass").rgba[3] < 0.5


def test_a_ray_across_the_corridor_meets_two_brick_walls(office: Built) -> None:
    """Every wall is one geom thick, so obstacles can be counted along a line."""
    model, data = office.model, office.data
    geom = np.zeros(1, np.int32)
    start, goal = np.array([3.0, 5.9, 1.5]), np.array([3.0, -5.9, 1.5])
    hit: list[str] = []
    at = start.copy()
    direction = (goal - start) / np.linalg.norm(goal - start)
    while True:
        way = mujoco.mj_ray(model, data, at, direction, None, 1, -1, geom, None)
        at = at + (way + 1e-4) * direction
        if way < 0 or at[1] < goal[1]:
            break
        hit.append(model.geom(int(geom[0])).name.rpartition("_")[0])
    walls = [name for name, _ in itertools.groupby(hit) if name == "corridor"]
    assert hit.count("corridor") == 4, hit  # two faces each
    assert walls


def test_the_office_has_victims_and_things_to_push(office: Built) -> None:
    """A few victims, several chairs, bins and boxes."""
    assert len(office.world.victims) >= 4
    kinds = Counter(name.rpartition("_")[0] for name in office.movable)
    assert kinds["chair"] >= 3
    assert kinds["bin"] >= 2
    assert kinds["box"] >= 2


# ---- empty and proving ground -------------------------------------------------------------


def test_the_empty_world_is_one_plane() -> None:
    """The empty world has a floor, starts and nothing else."""
    built = build("empty")
    assert [built.model.geom(g).name for g in range(built.model.ngeom)] == ["floor_1", "probe"]
    assert built.world.victims == ()
    assert built.movable == ()


def test_inclines_have_the_angles_of_their_names(proving_ground: Built) -> None:
    """Robots reference 3.3 V14 to V16: 15, 19.3 (35 %), 25, 30 and 35 degrees from level ground."""
    for tag, angle in (("15", 15.0), ("19", 19.29), ("25", 25.0), ("30", 30.0), ("35", 35.0)):
        start = proving_ground.world.start(f"Incline{tag}")
        assert start is not None
        x, y, _ = start.pose.position
        assert slope(proving_ground, x + 4.0, y, 1.0, 0.0) == pytest.approx(angle, abs=0.01)
        assert proving_ground.height(x + 1.99, y) == pytest.approx(0.0, abs=1e-6)
        rise = 0.05 * math.tan(math.radians(angle))
        assert proving_ground.height(x + 2.05, y) == pytest.approx(rise, abs=1e-4)
    assert math.tan(math.radians(19.29)) == pytest.approx(0.35, abs=1e-4)


@pytest.mark.parametrize(("tag", "height"), [("Step6cm", 0.06), ("Step8cm", 0.08)])
def test_steps_have_the_heights_of_their_names(
    proving_ground: Built, tag: str, height: float
) -> None:
    """V17: one square step 2 m ahead of the start."""
    start = proving_ground.world.start(tag)
    assert start is not None
    x, y, _ = start.pose.position
    assert proving_ground.height(x + 1.999, y) == pytest.approx(0.0, abs=1e-6)
    assert proving_ground.height(x + 2.001, y) == pytest.approx(height, abs=1e-6)


@pytest.mark.parametrize(("tag", "width"), [("Gap15cm", 0.15), ("Gap20cm", 0.20)])
def test_gaps_have_the_widths_of_their_names(proving_ground: Built, tag: str, width: float) -> None:
    """V18: platforms of equal height with the gap between them; the start is on the first."""
    start = proving_ground.world.start(tag)
    assert start is not None
    x, y, z = start.pose.position
    assert z == pytest.approx(0.65)
    heights = [
        proving_ground.height(x + 2.0 + shift, y)
        for shift in (-0.001, 0.001, width - 0.001, width + 0.001)
    ]
    assert heights == pytest.approx([0.4, 0.0, 0.0, 0.4], abs=1e-6)


def test_step_fields_differ_by_seed(proving_ground: Built) -> None:
    """V19 and V20: four different fields of 0 to 6 cm and a cubic one, each 12 x 12 posts."""
    fields = []
    for tag in ("StepField1", "StepField2", "StepField3", "StepField4", "CubicField"):
        start = proving_ground.world.start(tag)
        assert start is not None
        x, y, _ = start.pose.position
        tops = np.array(
            [
                [proving_ground.height(x + 2.05 + 0.1 * i, y - 0.55 + 0.1 * j) for j in range(12)]
                for i in range(12)
            ]
        )
        fields.append(np.round(100 * tops).astype(int))
    assert len({field.tobytes() for field in fields}) == 5
    assert all(set(field.ravel()) == set(range(7)) for field in fields[:4])
    assert set(fields[4].ravel()) == {0, 5, 10}


def test_the_wall_stands_across_its_lane(proving_ground: Built) -> None:
    """Robots reference 5.3 item 59: a wall 1 m high, 2 m ahead, wider than any robot."""
    start = proving_ground.world.start("Wall")
    assert start is not None
    x, y, _ = start.pose.position
    assert all(
        proving_ground.height(x + 2.001, y + side) == pytest.approx(1.0) for side in (-1.1, 1.1)
    )


def test_lanes_do_not_touch_each_other(proving_ground: Built) -> None:
    """Zones carry the starts' tags and do not overlap, so one test cannot disturb another."""
    zones = proving_ground.world.zones
    assert {zone.name for zone in zones} == {start.tag for start in proving_ground.world.starts}
    for a, b in itertools.combinations(zones, 2):
        assert a.x[1] <= b.x[0] or b.x[1] <= a.x[0] or a.y[1] <= b.y[0] or b.y[1] <= a.y[0]
    for zone in zones:
        start = proving_ground.world.start(zone.name)
        assert start is not None
        assert zone.x[0] < start.pose.position[0] < zone.x[1]


def test_all_names_are_tested() -> None:
    """This file looks at every folder of worlds there is."""
    from usarsim_server.data import data_directory

    folders = {path.name for path in data_directory("worlds").iterdir() if path.is_dir()}
    assert folders == set(NAMES)
