"""Zones as polygons, the strips that show them, and worlds that extend others."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from world_files import HEAD, START, VICTIM, nameless, write_world

from usarsim_server.base.errors import WorldError
from usarsim_server.radio.obstacles import SceneryObstacles
from usarsim_server.scene.primitives import Primitives
from usarsim_server.simulation.model import CompiledWorld, PhysicsOptions, compile_world
from usarsim_server.simulation.rays.scenery import StaticGeometry
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.polygons import area, contains, overlap, sides
from usarsim_server.worlds.scene import build_scene

TRIANGLE = '[[zone]]\nname = "t"\nkind = "yellow"\npolygon = [[0, 0], [4, 0], [0, 4]]\n'
ROOM = """<mujoco model="room">
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" rgba="0.5 0.5 0.5 1"/>
    <geom name="east" type="box" pos="4.1 0 0.5" size="0.1 4 0.5"/>
    <geom name="west" type="box" pos="-4.1 0 0.5" size="0.1 4 0.5"/>
    <geom name="kerb" type="box" pos="2 2 0.1" size="0.1 1 0.1"/>
  </worldbody>
</mujoco>
"""


def halves(strip: str = "true") -> str:
    """Two zones that fill a room between them."""
    return "".join(
        f'[[zone]]\nname = "{kind}"\nkind = "{kind}"\nx = {list(x)}\ny = [-4, 4]\nstrip = {strip}\n'
        for kind, x in (("red", (0, 4)), ("blue", (-4, 0)))
    )


# -- polygons ---------------------------------------------------------------------------------


def test_a_zone_is_a_polygon_or_a_rectangle(tmp_path: Path) -> None:
    """Corners are kept as they are written, `x` and `y` are their bounds (O-01)."""
    world = load_world(write_world(tmp_path, HEAD + START + TRIANGLE + halves("false")))
    triangle, rectangle, _ = world.zones
    assert triangle.corners == ((0.0, 0.0), (4.0, 0.0), (0.0, 4.0))
    assert (triangle.x, triangle.y) == ((0.0, 4.0), (0.0, 4.0))
    assert rectangle.corners == ((0.0, -4.0), (4.0, -4.0), (4.0, 4.0), (0.0, 4.0))


@pytest.mark.parametrize(
    ("written", "problem"),
    [
        ("polygon = [[0, 0], [1, 0]]", "is not a list of 3 corners or more"),
        ("polygon = [[0, 0], [1, 0], [1]]", "[1] is not a corner such as [1.0, 2.0]"),
        ("polygon = [[0, 0], [1, 0], [true, 2]]", "is not a corner"),
        ("polygon = [[0, 0], [1, 1], [1, 0], [0, 1]]", "side from corner 1 meets the side from"),
        ("polygon = [[0, 0], [1, 0], [2, 0]]", "has no area"),
        ("polygon = [[0, 0], [1, 0], [0, 1]]\nx = [0, 1]", "stands beside polygon"),
    ],
)
def test_what_is_no_area_is_refused(tmp_path: Path, written: str, problem: str) -> None:
    """With the number of the zone."""
    zone = f'[[zone]]\nname = "t"\nkind = "yellow"\n{written}\n'
    with pytest.raises(WorldError) as caught:
        load_world(write_world(tmp_path, HEAD + START + zone))
    assert "[[zone]] 1: " in nameless(caught.value)
    assert problem in str(caught.value)


def test_areas() -> None:
    """A border shared is no overlap, a millimetre is none, a centimetre is one."""
    square = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
    hook = ((2.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 2.0), (2.0, 2.0))
    assert area(square) == pytest.approx(4.0)
    assert area(square[::-1]) == pytest.approx(-4.0)
    assert not overlap(square, hook)
    assert overlap(tuple((x + 0.01, y) for x, y in square), hook)
    assert not overlap(tuple((x + 0.0005, y) for x, y in square), hook)
    assert overlap(square, ((0.5, 0.5), (1.0, 0.5), (1.0, 1.0)))
    assert sides(square[::-1])[0] == ((0.0, 0.0), (2.0, 0.0))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(0.5, 5.0), min_size=5, max_size=9),
    st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0)),
)
def test_places_in_stars(radii: list[float], place: tuple[float, float]) -> None:
    """A star with a corner in each direction holds what is nearer than its side there."""
    count = len(radii)
    angles = [math.tau * n / count for n in range(count)]
    star = [(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
    x, y = place
    sector = int(math.atan2(y, x) % math.tau // (math.tau / count)) % count
    (ax, ay), (bx, by) = star[sector], star[(sector + 1) % count]
    side = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    if abs(side) > 1e-6:
        assert contains(star, np.array([place]))[0] == (side > 0.0)


# -- strips -----------------------------------------------------------------------------------


def painted(folder: Path) -> dict[str, np.ndarray[tuple[int, int], np.dtype[np.float64]]]:
    """Corners (n, 3) of the strips of a world by the name of the zone, m."""
    model = build_scene(load_world(folder)).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = {}
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if not name.startswith("paint:zone:"):
            continue
        assert model.geom_contype[geom] == model.geom_conaffinity[geom] == 0
        mesh = model.geom_dataid[geom]
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        turn = data.geom_xmat[geom].reshape(3, 3)
        corners = model.mesh_vert[start : start + count] @ turn.T + data.geom_xpos[geom]
        found[name.removeprefix("paint:zone:")] = corners
    return found


def test_strips_are_on_walls_and_along_borders(tmp_path: Path) -> None:
    """O-02: each zone has its own, on the wall 0.35 to 0.47 m up, on the floor inside its border;
    a kerb is no wall."""
    found = painted(write_world(tmp_path, HEAD + START + halves(), ROOM))
    assert set(found) == {"red", "blue"}
    for kind, side in (("red", 1.0), ("blue", -1.0)):
        corners = found[kind] * [side, 1.0, 1.0]
        assert corners[:, 0].min() > 0.03
        walls = corners[corners[:, 2] > 0.3]
        assert walls[:, 2].min() == pytest.approx(0.35, abs=1e-4)
        assert walls[:, 2].max() == pytest.approx(0.47, abs=1e-4)
        assert walls[:, 0] == pytest.approx(3.997, abs=1e-3)
        assert (walls[:, 1].min(), walls[:, 1].max()) == pytest.approx((-4.0, 4.0), abs=0.06)
        floor = corners[corners[:, 2] < 0.01]
        assert floor[:, 0].min() == pytest.approx(0.04, abs=1e-3)
        assert np.isclose(floor[:, 1].max(), 3.96, atol=1e-3)


def test_zones_without_strips_change_nothing(tmp_path: Path) -> None:
    """Nor do zones of other kinds."""
    mud = '[[zone]]\nname = "m"\nkind = "mud"\nx = [0, 4]\ny = [0, 4]\nstrip = true\n'
    assert painted(write_world(tmp_path, HEAD + START + halves("false") + mud, ROOM)) == {}


def test_rays_and_radio_do_not_meet_strips(tmp_path: Path) -> None:
    """A scan of the wall and the count of obstacles are the same to the bit with strips."""
    sheets = {"plain": "", "striped": halves()}
    folders = [write_world(tmp_path, HEAD + START + z, ROOM, n) for n, z in sheets.items()]
    worlds = [StaticGeometry(_compiled(folder)) for folder in folders]
    angles = np.linspace(-math.pi, math.pi, 361)
    ways = np.stack([np.cos(angles), np.sin(angles), np.zeros(361)], axis=1)
    origins = np.tile([0.0, 0.0, 0.4], (361, 1))
    plain, striped = (world.cast(origins, ways).distances for world in worlds)
    assert (plain == striped).all()
    assert np.isfinite(plain).any()
    counts = [
        SceneryObstacles(_Traced(world)).count((0.0, 0.0, 0.4), (6.0, 0.0, 0.4)) for world in worlds
    ]
    assert counts == [1, 1]


def _compiled(folder: Path) -> CompiledWorld:
    world = load_world(folder)
    return compile_world(lambda: build_scene(world), [], PhysicsOptions(), 0)


class _Traced:
    def __init__(self, geometry: StaticGeometry) -> None:
        self.first_sceneries = geometry.first_hits


# -- worlds upon worlds -----------------------------------------------------------------------


def test_a_world_says_only_what_differs(tmp_path: Path) -> None:
    """Scene, starts and title are those of the base; a list that is written stands for its."""
    base = write_world(tmp_path, HEAD + START + VICTIM + TRIANGLE)
    folder = tmp_path / "upon"
    folder.mkdir()
    (folder / "world.toml").write_text('extends = "../yard"\nlevel = "L"\nvictim = []\n')
    world = load_world(folder)
    assert (world.title, world.level, world.victims) == ("Yard", "L", ())
    assert world.scene == base / "scene.xml"
    assert [start.tag for start in world.starts] == ["A"]
    assert [zone.name for zone in world.zones] == ["t"]
    assert build_scene(world).body("crate") is not None


def test_a_world_upon_a_shipped_one(tmp_path: Path) -> None:
    """By its name, with what machines it has."""
    (tmp_path / "world.toml").write_text('extends = "plant"\ntitle = "Mine"\n')
    world, plant = load_world(tmp_path), load_world(load_world(tmp_path).scene.parent)
    assert (world.title, world.level) == ("Mine", plant.level)
    assert world.machinery == plant.machinery
    assert world.victims == plant.victims


@pytest.mark.parametrize(
    ("extends", "problem"),
    [
        ("arenna", "did you mean arena?"),
        ("../nowhere", "not a world folder"),
        ("../circle", "more than 8 worlds extend one another"),
    ],
)
def test_a_base_that_is_none(tmp_path: Path, extends: str, problem: str) -> None:
    """The error names the file that extends."""
    folder = tmp_path / "circle"
    folder.mkdir()
    (folder / "world.toml").write_text(f'extends = "{extends}"\n')
    with pytest.raises(WorldError) as caught:
        load_world(folder)
    assert str(caught.value).startswith(f"{folder / 'world.toml'}: extends: ")
    assert problem in str(caught.value)


def test_starts_of_the_base_have_to_be_within_new_bounds(tmp_path: Path) -> None:
    """What is inherited is checked with what is written."""
    write_world(tmp_path)
    folder = tmp_path / "upon"
    folder.mkdir()
    bounds = "[bounds]\nlower = [1, 1, -1]\nupper = [5, 5, 5]\n"
    (folder / "world.toml").write_text('extends = "../yard"\n' + bounds)
    with pytest.raises(WorldError, match="outside the bounds"):
        load_world(folder)


def test_strips_are_in_the_scene_that_clients_are_told(tmp_path: Path) -> None:
    """O-02: the still world has a mesh per zone, in its colour; zones are told with corners."""
    folder = write_world(tmp_path, HEAD + START + halves(), ROOM)
    message: Any = Primitives(_compiled(folder)).scene(load_world(folder)).message
    geoms = [geom for group in message["still"] for geom in group["geoms"]]
    meshes = [geom for geom in geoms if geom["shape"] == "mesh"]
    assert len(meshes) == 2
    assert message["zones"][0]["corners"] == [[0, -4], [4, -4], [4, 4], [0, 4]]
