"""Colours after the names of materials whose pictures are missing."""

from __future__ import annotations

from pathlib import Path

import pytest
from built_worlds import import_text
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from t3d_maps import level, room, start

from usarsim_maps.unreal.names import likely_color


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
