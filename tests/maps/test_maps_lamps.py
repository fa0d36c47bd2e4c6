"""Light of imported maps: falloff, crowds of lamps, faces cut small near lamps; likely colours."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from built_worlds import (
    World,
    build_world,
    cuboid_mesh,
    import_text,
    is_convex,
    polygon_area,
    scene_of,
    thing,
)
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from t3d_maps import actor, level, room, start

from usarsim_maps.build.light import Glow, chosen_lights, cut_for_light, lamps
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Light, LightKind
from usarsim_maps.unreal.names import likely_color
from usarsim_server.cameras import backend as probe
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.view import View, looking
from usarsim_server.simulation.frames import rotation_matrix

Array = NDArray[np.float64]

LAMP = "Begin Object Class=PointLightComponent Name=C\nRadius=1000\nBrightness=4\nEnd Object"


def hall(lit: bool) -> str:
    """A room of 12 m, 3 m high; its lamp hangs 2 m above the floor and shines 4 m, or 4 cm."""
    lamp = actor("PointLight", "P", (0, 0, 500), LAMP if lit else LAMP.replace("1000", "10"))
    return level(room(3000.0), lamp, start("S", (1250, 1250, 60)))


def light_on(world: World, place: tuple[float, float], renderer: str) -> float:
    """Mean brightness (0 to 255) of half a metre of floor, seen from above."""
    painter = Painter(world.simulation.compiled, PainterOptions(renderer=renderer))
    eye = (place[0] - 0.4, place[1], 1.0)
    view = View(looking(eye, (*place, 0.0)), 0.4, width=32, height=24)
    picture = np.asarray(painter.picture(view, world.simulation.look()), dtype=float)
    painter.close()
    return float(picture.mean())


@pytest.mark.parametrize("renderer", ["opengl", "rays"])
def test_a_lamp_lights_the_floor_below_it(tmp_path: Path, renderer: str) -> None:
    """Below a lamp it is brighter than without one, far from it it is not, however drawn
    (worlds 76)."""
    if renderer == "opengl":
        platform = probe.usable_platform(probe.platforms_to_try("auto"))
        if platform is None:
            pytest.skip("no OpenGL library on this machine (libosmesa6, or libegl1 with drivers)")
        renderer = platform
    lit = import_text(tmp_path, hall(lit=True), "lit.t3d")
    dark = import_text(tmp_path, hall(lit=False), "dark.t3d")
    below = light_on(lit, (0.0, 0.0), renderer) - light_on(dark, (0.0, 0.0), renderer)
    aside = light_on(lit, (5.0, 5.0), renderer) - light_on(dark, (5.0, 5.0), renderer)
    # A white lamp of 0.8 leaves 0.8 / (1 + 5 / 4) at half its reach; the floor is grey.
    assert below == pytest.approx(0.8 / 2.25 * 255.0 * 0.7, rel=0.25)
    assert aside < below / 4.0


def test_falloff() -> None:
    """Lamps fade about as Unreal's do, (1 - (d / reach)^2)^2, up to their reach."""
    (lamp,) = lamps([Light("L", reach=4.0)])
    constant, linear, square = np.asarray(lamp["attenuation"]).tolist()
    distance = np.linspace(0.0, 4.0, 50)
    ours = 1.0 / (constant + linear * distance + square * distance**2)
    assert np.abs(ours - (1.0 - (distance / 4.0) ** 2) ** 2).max() < 0.18


def test_a_crowd_of_lamps_does_not_dazzle() -> None:
    """Lamps side by side are dimmed together, lamps far apart are not."""

    def strengths(apart: float) -> list[float]:
        lights = [Light(f"L{n}", position=(n * apart, 0, 2), reach=3.0) for n in range(7)]
        return [float(np.asarray(lamp["diffuse"]).max()) for lamp in lamps(lights)]

    assert strengths(100.0) == pytest.approx([0.8] * 7, abs=0.01)
    assert len(set(strengths(0.1))) == 1
    assert 0.15 < strengths(0.1)[0] < 0.25


def test_suns_are_not_dimmed_by_lamps() -> None:
    """Light without a place keeps its strength."""
    lights = [Light("S", LightKind.DIRECTIONAL, brightness=0.5)]
    lights += [Light(f"L{n}", reach=5.0) for n in range(6)]
    assert lamps(lights)[0]["diffuse"] == pytest.approx((0.4, 0.4, 0.4))


def test_parallel_suns_are_one_where_there_are_too_many(findings: Findings) -> None:
    """Suns that shine the same way are added up before any light is left out (worlds 76)."""
    below = [
        Light(f"S{n}", LightKind.DIRECTIONAL, (n, 0, 9), (0, 0, -1 - n), brightness=0.1)
        for n in range(5)
    ]
    round_about = [
        Light(f"R{n}", LightKind.DIRECTIONAL, direction=(math.cos(n), math.sin(n), 0))
        for n in range(4)
    ]
    chosen = chosen_lights([*below, *round_about], findings)
    assert [light.name for light in chosen] == ["S0", "R0", "R1", "R2", "R3"]
    assert chosen[0].brightness == pytest.approx(0.5)
    (warning,) = findings.warnings()
    assert warning.text == "4 suns were added to others that shine their way"
    assert chosen_lights(below, Findings()) == below


def test_level_faces_are_flat(tmp_path: Path) -> None:
    """In a corner every face of the level is lit as the plane that it is."""
    world = import_text(tmp_path, hall(lit=True))
    model = world.model
    for mesh in range(model.nmesh):
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        places = model.mesh_vert[int(model.mesh_vertadr[mesh]) :]
        normals = model.mesh_normal[int(model.mesh_normaladr[mesh]) :]
        corners = places[model.mesh_face[first : first + count]]
        planes = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        planes /= np.linalg.norm(planes, axis=1)[:, None]
        told = normals[model.mesh_facenormal[first : first + count]]
        assert np.abs(told - planes[:, None]).max() < 1e-3


def test_lights_have_no_direction(tmp_path: Path) -> None:
    """Lamps without a cone are spots of 180 degrees, which OpenGL takes for light all around."""
    lamp = Light("L", position=(0, 0, 2), reach=3.0)
    floor = thing(cuboid_mesh((-3, -3, -1), (3, 3, 0)))
    model = build_world(tmp_path, scene_of(floor, lights=(lamp,))).model
    assert model.light_type[0] == mujoco.mjtLightType.mjLIGHT_SPOT
    assert (model.light_cutoff[0], model.light_exponent[0]) == (180.0, 0.0)


# ---- cutting ---------------------------------------------------------------------------------


NUMBER = st.floats(-8.0, 8.0)


@given(
    corners=st.integers(3, 7),
    size=st.floats(0.2, 20.0),
    tilt=st.tuples(NUMBER, NUMBER, NUMBER),
    lamp=st.tuples(NUMBER, NUMBER, NUMBER),
    reach=st.floats(0.1, 10.0),
)
def test_pieces_make_up_the_face(
    corners: int,
    size: float,
    tilt: tuple[float, float, float],
    lamp: tuple[float, float, float],
    reach: float,
) -> None:
    """Whatever the face and the lamp: convex pieces in its plane, with its area."""
    angles = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    points = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(corners)]) * size
    quaternion = np.array([1.0, *tilt])
    turn = rotation_matrix(quaternion / np.linalg.norm(quaternion))
    points = points @ turn.T
    pieces = cut_for_light(points, [Glow(lamp, reach)])
    assert sum(map(polygon_area, pieces)) == pytest.approx(polygon_area(points), rel=1e-6)
    assert all(map(is_convex, pieces))
    assert all(np.abs(piece @ turn[:, 2]).max() < 1e-9 for piece in pieces)


FLOOR = np.array([[-10.0, -10, 0], [10, -10, 0], [10, 10, 0], [-10, 10, 0]])


@pytest.mark.parametrize("lamp", [(0.0, 0.0, -1.0), (0.0, 0.0, 5.0), (30.0, 0.0, 1.0)])
def test_dark_faces_stay_whole(lamp: tuple[float, float, float]) -> None:
    """A face that a lamp shines at from behind, or does not reach, is not cut."""
    (piece,) = cut_for_light(FLOOR, [Glow(lamp, 3.0)])
    assert piece is FLOOR


def test_pieces_near_a_lamp_are_small() -> None:
    """Within reach pieces are a sixth of it, and a long way off they need not be."""
    pieces = cut_for_light(FLOOR, [Glow((1.0, 1.0, 1.5), 3.0)])
    for piece in pieces:
        middle = piece.mean(axis=0)
        if math.dist(middle, (1.0, 1.0, 0.0)) < 2.0:
            assert np.ptp(piece, axis=0).max() <= 0.5 + 1e-9
    assert 100 < len(pieces) < 300


@pytest.mark.parametrize(
    ("name", "like"),
    [
        ("PKG_Textures_02.Materials.M_Wood_16", "Wood"),
        ("PKG.Materials.M_Concrete_48", "Conc"),
        ("Soccer.Textures.walls_sg_concwall2_Mat", "Conc"),
        ("Office.CubicleWall_Mat", "Cubicle"),
        ("Office.wall1_Mat", "Wall"),
        ("Office.ceiling1_Mat", "Ceiling"),
        ("A.WoodenFloor", "Wood"),
        ("A.BrickWall", "Brick"),
        ("RED_PAINT", "Red"),
    ],
)
def test_stuff_before_place(name: str, like: str) -> None:
    """What a thing is made of counts before where it is; endings, numbers and case do not."""
    assert likely_color(name) == likely_color(like)
    assert likely_color(name) is not None


@pytest.mark.parametrize(
    "name", ["EngineMaterials.DefaultMaterial", "Wood.Stuff.M_01", "A.Rendered", "A.Incredible", ""]
)
def test_names_that_say_nothing(name: str) -> None:
    """Packages and groups do not count, nor do short words inside of others."""
    assert likely_color(name) is None


@given(st.text())
def test_any_name(name: str) -> None:
    """Whatever a name holds, there is an opaque colour or none."""
    color = likely_color(name)
    assert color is None or (color[3] == 1.0 and all(0.0 <= part <= 1.0 for part in color))


def test_in_a_map(tmp_path: Path) -> None:
    """A wall without its picture has its colour, which the report tells; with it, it is white."""
    text = level(room(), start("S", (0, 0, 60))).replace("Pkg.Wall", "Pkg.Oak_Wood")
    world = import_text(tmp_path, text)
    wood = likely_color("Wood")
    assert world.model.material("Pkg.Oak_Wood").rgba == pytest.approx(wood, abs=1e-6)
    assert world.findings.facts["materials coloured after their names"] == 1
    assert ("texture", "Pkg.Oak_Wood", 1) in world.findings.missing_list()
    Image.new("RGB", (4, 4), (9, 9, 9)).save(tmp_path / "Oak_Wood.png")
    textured = import_text(tmp_path, text)
    assert textured.model.material("Pkg.Oak_Wood").rgba[3] == 1.0
    assert textured.model.ntex == world.model.ntex + 1
    assert "materials coloured after their names" not in textured.findings.facts
