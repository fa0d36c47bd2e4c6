"""The file of object classes: reader, look-up, the shipped classes."""

from __future__ import annotations

from pathlib import Path

import pytest

from usarsim_server.data import data_directory
from usarsim_server.errors import WorldError
from usarsim_server.worlds.objects.bodies import ObjectCatalog, load_objects

SHIPPED = data_directory("worlds") / "objects.toml"


def catalog(folder: Path, *texts: str) -> ObjectCatalog:
    """A catalogue of files with these contents, the first one first."""
    sheets = []
    for number, text in enumerate(texts):
        sheet = folder / f"objects{number}.toml"
        sheet.write_text(text, encoding="utf-8")
        sheets.append(sheet)
    return load_objects(sheets)


BOX = '[[object]]\nname = "Box"\nshape = "box"\nsize = [0.4, 0.2, 0.1]\n'


def test_a_plain_class(tmp_path: Path) -> None:
    """Shape and size are enough; mass follows from the volume, the rest has defaults."""
    box = catalog(tmp_path, BOX).find("box")
    assert box is not None
    assert (box.name, box.size, box.friction, box.rolling) == ("Box", (0.4, 0.2, 0.1), 0.5, 0.0)
    assert box.mass == pytest.approx(0.8)
    assert [part.shape for part in box.parts] == ["box"]


def test_names_count_without_regard_to_case(tmp_path: Path) -> None:
    """A class answers to its name and its aliases, spelled anyhow, and to nothing else."""
    found = catalog(tmp_path, BOX + 'aliases = ["WCBox"]\n')
    assert found.find("BOX") is found.find(" wcbox ") is found.find("Box")
    assert found.find("Boxes") is None
    assert found.find("") is None


def test_parts_make_a_bounding_box(tmp_path: Path) -> None:
    """The origin is the middle of all parts, turned ones included, and size reaches round them."""
    text = """
        [[object]]
        name = "Hook"
        mass = 3
        [[object.part]]
        shape = "box"
        size = [1.0, 0.2, 0.2]
        position = [0.5, 0.0, 0.1]
        [[object.part]]
        shape = "box"
        size = [0.6, 0.2, 0.2]
        position = [0.9, 0.0, 0.5]
        rotation_degrees = [0, 90, 0]
        color = [1, 0, 0]
    """
    hook = catalog(tmp_path, text).find("hook")
    assert hook is not None
    assert hook.size == pytest.approx((1.0, 0.2, 0.8))
    first, second = hook.parts
    assert first.pose.position == pytest.approx((0.0, 0.0, -0.3))
    assert second.pose.position == pytest.approx((0.4, 0.0, 0.1))
    assert (first.color, second.color) == (None, (1.0, 0.0, 0.0))


def test_later_files_replace_classes(tmp_path: Path) -> None:
    """A world's own class of the same name counts; classes it does not name stay."""
    mine = '[[object]]\nname = "BOX"\nshape = "sphere"\nsize = [1, 1, 1]\n'
    other = '[[object]]\nname = "Ball"\nshape = "sphere"\nsize = [1, 1, 1]\n'
    found = catalog(tmp_path, BOX + other.replace("Ball", "Old"), mine, other)
    box = found.find("box")
    assert box is not None
    assert box.parts[0].shape == "sphere"
    assert [one.name for one in found.classes] == ["Ball", "BOX", "Old"]


def test_files_that_are_not_there_are_no_error(tmp_path: Path) -> None:
    """Most worlds have no classes of their own."""
    assert load_objects([tmp_path / "objects.toml"]).classes == ()


def test_materials(tmp_path: Path) -> None:
    """A material has a colour, and an opacity if it is not opaque."""
    text = '[[material]]\nname = "Glass"\ncolor = [0.7, 0.8, 0.9]\nopacity = 0.3\n'
    glass = catalog(tmp_path, text).material("GLASS")
    assert glass is not None
    assert (glass.color, glass.opacity) == ((0.7, 0.8, 0.9), 0.3)
    assert catalog(tmp_path, text).material("wood") is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[[object]\n", "not valid TOML"),
        ('[[object]]\nshape = "box"\nsize = [1, 1, 1]\n', "name: is missing"),
        ('[[object]]\nname = "A"\n', "shape: is missing"),
        ('[[object]]\nname = "A"\nshape = "cube"\nsize = [1, 1, 1]\n', "'cube' is not known"),
        ('[[object]]\nname = "A"\nshape = "box"\nsize = [1, 1]\n', "3 numbers"),
        ('[[object]]\nname = "A"\nshape = "box"\nsize = [1, 0, 1]\n', "out of range"),
        (BOX + "mass = 0\n", "mass: 0"),
        (BOX + "colour = [1, 1, 1]\n", "did you mean color?"),
        (BOX + "color = [1, 2, 1]\n", "from 0 to 1"),
        (BOX + 'aliases = ["a box"]\n', "cannot travel on the wire"),
        (BOX + '[[object.part]]\nshape = "box"\nsize = [1, 1, 1]\n', "stands beside"),
        (BOX + BOX, "stands there twice"),
        (BOX + 'aliases = ["BOX"]\n', "stands there twice"),
        (BOX + "[[thing]]\n", "unknown key"),
        ('[[material]]\nname = "X"\ncolor = [1, 1]\n', "3 numbers"),
        ('[[material]]\nname = "X"\ncolor = [1, 1, 1]\nopacity = 2\n', "out of range"),
    ],
)
def test_slips_are_told(tmp_path: Path, text: str, says: str) -> None:
    """Every error names the file and says what is wrong."""
    with pytest.raises(WorldError, match=r"objects0\.toml") as caught:
        catalog(tmp_path, text)
    assert says in str(caught.value)


# ---- shipped ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["Box", "WCCrate", "Crate", "Pallet", "Cylinder", "Ball", "Cone", "KitTray", "partc"]
)
def test_the_usual_classes_are_shipped(name: str) -> None:
    """What legacy scripts create is there, with a sensible weight and size."""
    found = load_objects([SHIPPED]).find(name)
    assert found is not None
    assert 0.1 <= found.mass <= 500.0
    assert all(0.02 <= extent <= 3.0 for extent in found.size)


def test_shipped_names_lead_to_one_class_each() -> None:
    """The shipped file loads, and no alias is shadowed."""
    found = load_objects([SHIPPED])
    assert len(found.classes) >= 25
    for one in found.classes:
        for name in (one.name, *one.aliases):
            assert found.find(name) is one
