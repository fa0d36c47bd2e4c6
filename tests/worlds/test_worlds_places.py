"""What is special about each shipped world: obstacles of the arena, doors of the office, lanes."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable

import mujoco
import numpy as np
import pytest
from shipped_worlds import Built, build

from usarsim_server.simulation.frames import Vector
from usarsim_server.worlds.description import Zone


def lane(built: Built, tag: str) -> Vector:
    """Where a start is."""
    start = built.world.start(tag)
    assert start is not None
    return start.pose.position


def apart(zones: Iterable[Zone]) -> bool:
    """Whether no two zones overlap."""
    return all(
        a.x[1] <= b.x[0] or b.x[1] <= a.x[0] or a.y[1] <= b.y[0] or b.y[1] <= a.y[0]
        for a, b in itertools.combinations(zones, 2)
    )


def posts(built: Built, x: float, y: float) -> np.ndarray:
    """Heights (12, 12) of the posts of a step field, m, by one of its corners."""
    places = 0.1 * np.arange(12) + 0.05
    return np.array([[built.height(x + i, y + j) for j in places] for i in places])


# ---- arena --------------------------------------------------------------------------------


def test_the_arena_has_coloured_zones_side_by_side(arena: Built) -> None:
    """Yellow, orange, red and staging cover the hall without overlap."""
    zones = {zone.name: zone for zone in arena.world.zones}
    assert {"yellow", "orange", "red"} <= set(zones)
    areas = [(z.x[1] - z.x[0]) * (z.y[1] - z.y[0]) for z in zones.values()]
    assert sum(areas) == pytest.approx(24.0 * 20.0)
    assert apart(zones.values())


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
    assert heights[0] < 0.003
    assert heights[-1] < 0.003


def test_the_roll_ramps_form_a_valley_that_can_be_entered(arena: Built) -> None:
    """Behind the pitch ramps the sides rise at 15 degrees; wheels meet no step above 6 cm."""
    assert slope(arena, 5.0, -2.7, 0.0, 1.0) == pytest.approx(-15.0, abs=0.01)
    assert slope(arena, 5.0, -1.5, 0.0, 1.0) == pytest.approx(15.0, abs=0.01)
    assert max(arena.height(4.41, -2.1 + side) for side in (-0.2, 0.0, 0.2)) < 0.06


def test_the_orange_step_field_is_0_to_6_cm_and_the_red_0_5_10(arena: Built) -> None:
    """Robots reference 3.3 V19 and V20: posts of 10 cm in a square of 12 x 12, symmetric."""
    for corner, levels in (((-5.4, -6.6), range(7)), ((5.3, 3.0), (0, 5, 10))):
        tops = posts(arena, *corner)
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
    at, direction = np.array([3.0, 5.9, 1.5]), np.array([0.0, -1.0, 0.0])
    hit: list[str] = []
    while True:
        way = mujoco.mj_ray(model, data, at, direction, None, 1, -1, geom, None)
        at = at + (way + 1e-4) * direction
        if way < 0 or at[1] < -5.9:
            break
        hit.append(model.geom(int(geom[0])).name.rpartition("_")[0])
    assert hit.count("corridor") == 4, hit  # two faces each


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
        x, y, _ = lane(proving_ground, f"Incline{tag}")
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
    x, y, _ = lane(proving_ground, tag)
    assert proving_ground.height(x + 1.999, y) == pytest.approx(0.0, abs=1e-6)
    assert proving_ground.height(x + 2.001, y) == pytest.approx(height, abs=1e-6)


@pytest.mark.parametrize(("tag", "width"), [("Gap15cm", 0.15), ("Gap20cm", 0.20)])
def test_gaps_have_the_widths_of_their_names(proving_ground: Built, tag: str, width: float) -> None:
    """V18: platforms of equal height with the gap between them; the start is on the first."""
    x, y, z = lane(proving_ground, tag)
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
        x, y, _ = lane(proving_ground, tag)
        fields.append(np.round(100 * posts(proving_ground, x + 2.0, y - 0.6)).astype(int))
    assert len({field.tobytes() for field in fields}) == 5
    assert all(set(field.ravel()) == set(range(7)) for field in fields[:4])
    assert set(fields[4].ravel()) == {0, 5, 10}


def test_the_wall_stands_across_its_lane(proving_ground: Built) -> None:
    """Robots reference 5.3 item 59: a wall 1 m high, 2 m ahead, wider than any robot."""
    x, y, _ = lane(proving_ground, "Wall")
    heights = [proving_ground.height(x + 2.001, y + side) for side in (-1.1, 1.1)]
    assert heights == pytest.approx([1.0, 1.0])


def test_lanes_do_not_touch_each_other(proving_ground: Built) -> None:
    """Zones carry the starts' tags and do not overlap, so one test cannot disturb another."""
    zones = proving_ground.world.zones
    assert {zone.name for zone in zones} == {start.tag for start in proving_ground.world.starts}
    assert apart(zones)
    for zone in zones:
        assert zone.x[0] < lane(proving_ground, zone.name)[0] < zone.x[1]
