"""Reading machinery of world files: defaults, slips, anything at all."""

from __future__ import annotations

import math
import re
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from machine_stage import scene
from world_files import HEAD, START, write_world

from usarsim_server.base.errors import WorldError
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.machinery.machinery import Drive, Machinery, Spring
from usarsim_server.worlds.machinery.obstacles import operators_of
from usarsim_server.worlds.scene import build_scene

DOOR = '[[door]]\nname = "D"\nkind = "sliding"\nposition = [1, 2, 0]\n'
FLAP = '[[door]]\nname = "D"\nkind = "hinged"\nposition = [1, 2, 0]\n'
BELT = '[[belt]]\nname = "B"\nposition = [0, 0, 0.3]\nsize = [3, 1, 0.2]\nspeed = 0.4\n'
LIFT = '[[lift]]\nname = "L"\nsize = [1, 1, 0.1]\nstops = [[0, 0, 0.1], [0, 0, 1]]\n'
CART = '[[obstacle]]\nname = "O"\nsize = [1, 1, 1]\npoints = [[0, 0, 0], [2, 0, 0]]\n'


def machinery(directory: Path, sheet: str) -> Machinery:
    """Machinery of a world file."""
    folder = write_world(directory, HEAD + START + sheet, scene((5.0, 5.0, 0.15)))
    return load_world(folder).machinery


def test_defaults_of_doors(tmp_path: Path) -> None:
    """A name, a kind and a place make a door."""
    (door,) = machinery(tmp_path, DOOR).doors
    assert (door.width, door.height, door.leaves, door.left) == (1.0, 2.0, 1, True)
    assert door.travel == 1.0
    assert door.mechanism == Drive(0.7, 1.5, 2.0, 2.0, None)
    (flap,) = machinery(tmp_path, FLAP + 'opens = "push"\n').doors
    assert flap.travel == pytest.approx(math.pi / 2)
    assert isinstance(flap.mechanism, Spring)
    # Critical: 2 sqrt(k I), with I of a plate of 15 kg and 1 m about its edge.
    assert flap.mechanism.damping == pytest.approx(2.0 * math.sqrt(3.0 * 5.0))


def test_defaults_of_the_others(tmp_path: Path) -> None:
    """Belts obey to their own name, lifts go by the clock, obstacles go back and forth."""
    found = machinery(tmp_path, BELT + LIFT + CART)
    assert found.belts[0].geom == "B"
    assert not found.lifts[0].called
    assert found.obstacles[0].way == "back and forth"
    assert found.obstacles[0].speeds == (0.5,)
    (belt,) = machinery(tmp_path, BELT + 'tag = "hall"\n').belts
    assert belt.geom == "hall:B"


@pytest.mark.parametrize(
    ("sheet", "complaint"),
    [
        (DOOR + 'opens = "push"\n', r"\]\] 1 \(\w+\): opens: a sliding door cannot be pushed"),
        (DOOR + 'kinds = "x"\n', r"\]\] 1 \(\w+\): kinds: unknown key .*did you mean kind\?"),
        (DOOR + 'side = "left"\nleaves = 2\n', r"side: a door with two leaves"),
        (DOOR + "angle_degrees = 90.0\n", r"angle_degrees: unknown key"),
        (DOOR + 'opens = "timetable"\n', r"duration: is missing"),
        (DOOR + 'opens = "timetable"\nduration = 5\nperiod = 5\n', r"period: 5.0 is not longer"),
        (DOOR + 'opens = "timetable"\nduration = 5\nrange = 1\n', r"range: unknown key"),
        (DOOR + "travel = 2.0\n", r"travel: 2.0 is out of range"),
        (FLAP + "angle_degrees = 1.0\n", r"angle_degrees: does not open"),
        (FLAP + 'opens = "push"\nhold = 1.0\n', r"hold: unknown key"),
        (DOOR + DOOR.replace('"D"', '"d"'), r"\[\[door\]\] 2: name: 'd' is already the name of"),
        (DOOR + CART.replace('"O"', '"D"'), r"\[\[obstacle\]\] 1: name: 'D' is already"),
        (BELT.replace("0.4", "0.0"), r"\[\[belt\]\] 1 \(\w+\): speed: a belt at 0 m/s"),
        (BELT.replace("0.2]", "0]"), r"size: .* is out of range"),
        (LIFT.replace("[0, 0, 1]", "[0, 0, 0.12]"), r"stops: places 1 and 2 are nearer"),
        (LIFT.replace(", [0, 0, 1]", ""), r"stops: 1 of them"),
        (LIFT + "range = 1.0\n", r"range: unknown key"),
        (CART.replace("[2, 0, 0]", "[2, 0]"), r"points: \[2, 0\] is no place"),
        (CART.replace("[2, 0, 0]", '[2, 0, "x"]'), r"points: 'x' is not a number"),
        (CART.replace("[2, 0, 0]", "[2, 0, nan]"), r"points: nan is not a finite number"),
        (CART + "speed = [1, 2]\n", r"speed: 2 speeds for 1 ways"),
        (CART + "speed = [0]\n", r"speed: 0 is out of range"),
        (CART + "faces_ahead = true\npause = 0.0\n", r"pause: leaves no time to turn round"),
        (CART + "faces_ahead = true\nyaw_degrees = 1.0\n", r"yaw_degrees: stands beside"),
        (CART + 'shape = "cone"\n', r"shape: 'cone' is not known"),
    ],
)
def test_slips_are_told_with_place_and_cure(tmp_path: Path, sheet: str, complaint: str) -> None:
    """What cannot be is refused, naming table, key, problem and cure."""
    with pytest.raises(WorldError, match=complaint) as caught:
        machinery(tmp_path, sheet)
    assert "world.toml" in str(caught.value)
    assert re.fullmatch(r".+\(.+\)", str(caught.value))


@pytest.mark.parametrize(
    ("sheet", "complaint"),
    [
        (CART.replace('"O"', '"crate0"'), r"\[\[obstacle\]\] 1: name: 'crate0' is already"),
        (BELT.replace('"B"', '"floor"'), r"\[\[belt\]\] 1: name: 'floor' is already the name"),
        (DOOR + 'material = "cheese"\n', r"material: nobody knows what 'cheese' looks like"),
    ],
)
def test_what_does_not_fit_the_scene(tmp_path: Path, sheet: str, complaint: str) -> None:
    """Names of the scene cannot be taken again; materials must be known."""
    folder = write_world(tmp_path, HEAD + START + sheet, scene((5.0, 5.0, 0.15)))
    with pytest.raises(WorldError, match=complaint):
        build_scene(load_world(folder))


def test_materials_of_the_scene_come_first(tmp_path: Path) -> None:
    """A door takes the scene's material of that name; a substance is added if there is none."""
    own = '<asset><material name="wood" rgba="1 0 0 1"/></asset><worldbody>'
    text = scene().replace("<worldbody>", own)
    sheet = HEAD + START + DOOR + FLAP.replace('"D"', '"E"') + 'material = "glass"\n'
    folder = write_world(tmp_path, sheet, text)
    model = build_scene(load_world(folder)).compile()
    assert model.mat("wood").rgba.tolist() == [1.0, 0.0, 0.0, 1.0]
    assert model.mat("glass").rgba[3] < 0.5
    assert model.mat(int(model.geom_matid[model.body("E").geomadr[0]])).name == "glass"


def test_angles_do_not_depend_on_the_unit_of_the_scene(tmp_path: Path) -> None:
    """A door that is pushed opens as far in a scene in radians as in one in degrees."""
    for unit in ("radian", "degree"):
        text = scene().replace("<worldbody>", f'<compiler angle="{unit}"/><worldbody>')
        sheet = HEAD + START + FLAP + 'opens = "push"\nangle_degrees = 80.0\n'
        model = build_scene(load_world(write_world(tmp_path, sheet, text))).compile()
        assert model.joint("D").range.tolist() == pytest.approx([0.0, math.radians(80.0)])


numbers = st.one_of(
    st.integers(-3, 3),
    st.floats(-10, 10),
    st.sampled_from([0.1, 1.0, 5.0, 1e9, -1e9, math.inf, math.nan, 10**400]),
)
words = st.sampled_from(
    ["sliding", "hinged", "push", "timetable", "approach", "left", "load", "ring", "once", "D", ""]
)
values = st.recursive(
    st.one_of(numbers, words, st.booleans(), st.sampled_from(["glass", "cylinder"])),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=10,
)
KEYS = {
    "door": "name kind opens width leaves side travel angle_degrees height thickness speed hold "
    "range delay duration period mass spring damping both_ways material position yaw_degrees",
    "belt": "name tag position size speed friction slope_degrees material",
    "lift": "name size stops runs pause range speed acceleration yaw_degrees",
    "obstacle": "name shape size points speed way pause delay faces_ahead distance yaw_degrees",
}
BASES = {"door": DOOR, "belt": BELT, "lift": LIFT, "obstacle": CART}


def toml(value: object) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return f'"{value}"' if isinstance(value, str) else str(value)


@pytest.mark.parametrize("kind", sorted(BASES))
@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(data=st.data())
def test_whatever_is_written(kind: str, data: st.DataObject) -> None:
    """A table either makes a world that compiles and poses that are finite, or one clear error."""
    keys = st.sampled_from(KEYS[kind].split())
    written = data.draw(st.dictionaries(keys, values, max_size=3))
    lines = [line for line in BASES[kind].splitlines() if line.split(" ")[0] not in written]
    text = "\n".join([*lines, *(f"{key} = {toml(value)}" for key, value in written.items())])
    with TemporaryDirectory() as directory:
        try:
            folder = write_world(Path(directory), HEAD + START + text + "\n", scene())
            world = load_world(folder)
            build_scene(world)
        except WorldError as error:
            if not re.fullmatch(r".*world.toml.+\(.+\)", str(error)):
                raise
            return
        operators = operators_of(world.machinery)
        movers = [*operators.movers, *(own for one in operators.machines for own in one.movers)]
        for mover in movers:
            for time in (0.0, 0.7, 123.4, 1e6):
                pose = mover.pose(time)
                assert all(map(math.isfinite, (*pose.position, *pose.quaternion)))
