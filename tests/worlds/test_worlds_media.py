"""Smoke and patches of ground in `world.toml`: what is read, what is refused, what is drawn."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import pytest
from world_files import HEAD, SCENE, START, nameless, write_world

from usarsim_server.base.errors import WorldError
from usarsim_server.simulation.ground import Surface
from usarsim_server.worlds.description import Smoke, SmokePuff, WorldDescription
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import PAINT, build_scene
from usarsim_server.worlds.surfaces import GROUNDS

REGIONAL = """
[[smoke]]
name = "kitchen"
kind = "regional"
shape = "ellipsoid"
position = [1.0, 2.0, 1.5]
size = [4.0, 2, 3.0]
yaw_degrees = 90
density = 0.4
"""
LOCAL = """
[[smoke]]
name = "fire"
kind = "local"
position = [5.0, 0.0, 1.0]
size = [0.5, 0.5, 2.0]
particles = 200
radius = 0.1
seed = 7
lifetime = 10
"""
HAZE = '[[smoke]]\nname = "haze"\nkind = "global"\ndensity = 0.02\ntop = 2.5\n'
MUD = '[[surface]]\nname = "bog"\nkind = "mud"\nx = [1, 3]\ny = [-1.0, 1.0]\n'


def world_of(directory: Path, *tables: str) -> WorldDescription:
    """Read a world with these tables."""
    return load_world(write_world(directory, HEAD + START + "\n".join(tables)))


# -- smoke -----------------------------------------------------------------------------------


def test_a_world_without_smoke_is_clear(tmp_path: Path) -> None:
    """No table, no smoke and no patches."""
    world = world_of(tmp_path)
    assert world.smoke == Smoke()
    assert world.smoke.clear
    assert world.surfaces == ()


def test_regional_smoke_is_read(tmp_path: Path) -> None:
    """Shape, middle, full extents, heading and density arrive as written."""
    (volume,) = world_of(tmp_path, REGIONAL).smoke.volumes
    assert (volume.name, volume.shape) == ("kitchen", "ellipsoid")
    assert volume.pose.position == (1.0, 2.0, 1.5)
    assert volume.pose.rotate((1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    assert (volume.size, volume.density) == ((4.0, 2.0, 3.0), 0.4)


def test_local_smoke_is_read(tmp_path: Path) -> None:
    """All keys of a plume."""
    (puff,) = world_of(tmp_path, LOCAL).smoke.puffs
    place, size = (5.0, 0.0, 1.0), (0.5, 0.5, 2.0)
    assert puff == SmokePuff("fire", place, size, 200, 0.1, 7, 10.0)


def test_what_is_not_written_of_smoke(tmp_path: Path) -> None:
    """A box; still particles of the original's size; clouds that do not look alike; no top."""
    plain = '[[smoke]]\nname = "{}"\nkind = "{}"\nposition = [0, 0, 1]\nsize = [1, 1, 1]\n'
    local = [plain.format(name, "local") for name in "ab"]
    world = world_of(
        tmp_path,
        plain.format("c", "regional") + "density = 1",
        *local,
        HAZE.replace("top = 2.5\n", ""),
    )
    assert world.smoke.volumes[0].shape == "box"
    one, other = world.smoke.puffs
    assert (one.particles, one.radius, one.lifetime) == (60, 0.128, 0.0)
    assert one.seed != other.seed
    assert (world.smoke.haze, world.smoke.haze_top) == (0.02, math.inf)


def test_global_smoke_is_read(tmp_path: Path) -> None:
    """Density and top; together with other smoke it is still one description."""
    smoke = world_of(tmp_path, REGIONAL, HAZE, LOCAL).smoke
    assert (smoke.haze, smoke.haze_top) == (0.02, 2.5)
    assert (len(smoke.volumes), len(smoke.puffs)) == (1, 1)
    assert not smoke.clear


# -- ground ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["water", "mud", "sand", "ice"])
def test_every_kind_of_ground_has_defaults(tmp_path: Path, kind: str) -> None:
    """Name, kind and place are enough."""
    (surface,) = world_of(tmp_path, MUD.replace('"mud"', f'"{kind}"')).surfaces
    ground = GROUNDS[kind]
    assert ground is not None
    assert surface == Surface(
        "bog", kind, (1.0, 3.0), (-1.0, 1.0), (-0.1, 0.1), *ground, painted=True
    )


def test_own_values_of_a_patch(tmp_path: Path) -> None:
    """Friction above and below 1, drag, sinkage and heights as written."""
    own = MUD + "friction = 1.4\ndrag = 7\nsinkage = 0.05\nz = [0.0, 3.0]\n"
    (surface,) = world_of(tmp_path, own).surfaces
    assert (surface.friction, surface.drag, surface.sinkage) == (1.4, 7.0, 0.05)
    assert (surface.z, surface.painted) == ((0.0, 3.0), False)


def test_custom_ground_has_only_what_it_says(tmp_path: Path) -> None:
    """Friction is required; nothing drags and nothing gives way unless it is written."""
    custom = MUD.replace('"mud"', '"custom"')
    (surface,) = world_of(tmp_path, custom + "friction = 0.7\n").surfaces
    assert (surface.friction, surface.drag, surface.sinkage) == (0.7, 0.0, 0.0)
    with pytest.raises(WorldError, match=r"\[\[surface\]\] 1 \(\w+\): friction.*is missing"):
        world_of(tmp_path, custom)


MISTAKES = [
    (REGIONAL.replace('"regional"', '"thick"'), "[[smoke]] 1: kind", "regional, local, global"),
    (REGIONAL.replace("density = 0.4", ""), "[[smoke]] 1: density", "add density"),
    (REGIONAL.replace("0.4", "0"), "[[smoke]] 1: density", "out of range"),
    (REGIONAL.replace("0.4", "-1"), "[[smoke]] 1: density", "out of range"),
    (REGIONAL.replace('"ellipsoid"', '"ball"'), "[[smoke]] 1: shape", "box, ellipsoid"),
    (REGIONAL.replace("[4.0, 2, 3.0]", "[4.0, 0, 3.0]"), "[[smoke]] 1: size", "greater than 0"),
    (REGIONAL.replace("size", "sise"), "[[smoke]] 1: size", "add size"),
    (REGIONAL + "particles = 3", "[[smoke]] 1: particles", "unknown key"),
    (REGIONAL + REGIONAL, "[[smoke]] 2: name", "already the name"),
    (LOCAL.replace("200", "0"), "[[smoke]] 1: particles", "out of range"),
    (LOCAL.replace("0.1", "0"), "[[smoke]] 1: radius", "out of range"),
    (LOCAL + "density = 1", "[[smoke]] 1: density", "unknown key"),
    (HAZE + HAZE, "[[smoke]] 2: kind", "keep one"),
    (HAZE + "position = [0, 0, 0]", "[[smoke]] 1: position", "unknown key"),
    (HAZE.replace("2.5", "inf"), "[[smoke]] 1: top", "not a finite"),
    (MUD.replace('"mud"', '"lava"'), "[[surface]] 1: kind", "water, mud, sand, ice, custom"),
    (MUD.replace("[1, 3]", "[3, 1]"), "[[surface]] 1: x", "smaller number first"),
    (MUD + "friction = -0.1", "[[surface]] 1: friction", "out of range"),
    (MUD + "drag = -1", "[[surface]] 1: drag", "out of range"),
    (MUD + "sinkage = 0.6", "[[surface]] 1: sinkage", "out of range"),
    (MUD + "sinkaeg = 0.1", "[[surface]] 1: sinkaeg", "did you mean sinkage?"),
    (MUD + MUD, "[[surface]] 2: name", "already the name"),
]


@pytest.mark.parametrize(("tables", "where", "words"), MISTAKES)
def test_mistakes_are_named(tmp_path: Path, tables: str, where: str, words: str) -> None:
    """File, table, key and what to write instead."""
    with pytest.raises(WorldError) as caught:
        world_of(tmp_path, tables)
    text = nameless(caught.value)
    assert "world.toml" in text
    assert where in text
    assert words in text


# -- what is drawn ---------------------------------------------------------------------------


def compiled(directory: Path, *tables: str, scene: str = SCENE) -> mujoco.MjModel:
    """The model of a world with these tables."""
    sheet = HEAD + START + "\n".join(tables)
    return build_scene(load_world(write_world(directory, sheet, scene))).compile()


def test_a_patch_is_drawn_on_the_floor_and_touched_by_nothing(tmp_path: Path) -> None:
    """A slab of its size, hardly above the floor, of a material named by the substance."""
    model = compiled(tmp_path, MUD)
    slab = model.geom("surface_1")
    assert slab.pos[:2] == pytest.approx([2.0, 0.0])
    assert slab.size[:2] == pytest.approx([1.0, 1.0])
    assert 0.0 < slab.pos[2] + slab.size[2] < 0.001
    assert (slab.contype[0], slab.conaffinity[0]) == (0, 0)
    assert model.mat(int(slab.matid[0])).name == "mud"


def test_every_kind_can_be_drawn(tmp_path: Path) -> None:
    """There is a colour for each; two patches of a kind share its material."""
    tables = [
        MUD.replace('"mud"', f'"{kind}"').replace("bog", f"{kind}{n}") + "friction = 0.5\n"
        for kind in GROUNDS
        for n in (1, 2)
    ]
    model = compiled(tmp_path, *tables)
    assert set(PAINT) == set(GROUNDS)
    assert {model.mat(n).name for n in range(model.nmat)} == set(GROUNDS)


def test_a_material_of_the_scene_goes_first(tmp_path: Path) -> None:
    """An author who has a material `mud` sees the patch in it."""
    green = '<asset><material name="mud" rgba="0 1 0 1"/></asset><worldbody>'
    model = compiled(tmp_path, MUD, scene=SCENE.replace("<worldbody>", green))
    assert model.nmat == 1
    assert model.mat_rgba[0].tolist() == [0.0, 1.0, 0.0, 1.0]


def test_a_patch_on_ramps_is_left_to_the_scene(tmp_path: Path) -> None:
    """One that names heights is not drawn."""
    model = compiled(tmp_path, MUD + "z = [0.0, 2.0]\n")
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "surface_1") < 0
