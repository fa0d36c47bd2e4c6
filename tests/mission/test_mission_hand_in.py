"""Hand-in files open with the right scale, origin and colours, and are read back (O-54)."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from usarsim_mission.errors import RunLogError
from usarsim_mission.grid import FREE, UNKNOWN, WALL, Grid
from usarsim_mission.hand_in import (
    FREE_WHITE,
    SEARCHED_GREEN,
    UNKNOWN_BLUE,
    VICTIM_RED,
    WALL_BLACK,
    Reported,
    read_victims,
    victim_text,
    write_hand_in,
)

VICTIMS = [Reported(1, 3.0, 7.5, "conscious"), Reported(2, -1.25, 5.125, 'he says "go", I think')]
PATHS = {
    "R1": [(0.0, 5.0), (1.0, 5.5), (2.5, 5.5)],
    "R2": [(1.0, 6.0)],
    "R;3": [(0.0, 5.0), (1.0, 6.0)],
}


def grid() -> Grid:
    """40 by 30 cells of 0.2 m from (-2, 4): free, a wall at its greatest x, unknown at its top."""
    cells = np.full((30, 40), FREE, np.uint8)
    cells[:, 39] = WALL
    cells[25:, :] = UNKNOWN
    return Grid(-2.0, 4.0, 0.2, cells)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    searched = np.zeros((30, 40), np.bool_)
    searched[:10, :] = True
    write_hand_in(tmp_path / "map", "team", grid(), VICTIMS, PATHS, searched)
    return tmp_path / "map"


def at(world_file: Path, x: float, y: float) -> tuple[int, int]:
    """Row and column that a standard reader looks at for a place: those of a world file."""
    across, _, _, down, left, top = map(float, world_file.read_text().split())
    return round((y - top) / down), round((x - left) / across)


def test_the_map_has_its_colours_where_its_world_file_says(folder: Path) -> None:
    """O-54: TIFF and world file."""
    with Image.open(folder / "team_map.tiff") as image:
        assert (image.format, image.mode, image.size) == ("TIFF", "RGB", (40, 30))
        pixels = np.asarray(image)
    lines = (folder / "team_map.tfw").read_text().splitlines()
    assert [float(line) for line in lines] == [0.2, 0.0, 0.0, -0.2, -1.9, 9.9]
    for x, y, colour in (
        (0.1, 4.1, SEARCHED_GREEN),
        (0.1, 8.9, FREE_WHITE),
        (5.9, 4.1, WALL_BLACK),
        (0.1, 9.9, UNKNOWN_BLUE),
        (3.1, 7.5, VICTIM_RED),
        (3.5, 7.5, VICTIM_RED),
        (3.1, 7.9, VICTIM_RED),
        (3.5, 7.9, FREE_WHITE),
        (-1.3, 5.1, VICTIM_RED),
    ):
        assert tuple(pixels[at(folder / "team_map.tfw", x, y)]) == colour, (x, y)
    with Image.open(folder / "team_map_prob.tiff") as image:
        grey = np.asarray(image)
    shades = [grey[at(folder / "team_map_prob.tfw", x, y)] for x, y in ((0, 5), (5.9, 5), (0, 9.9))]
    assert shades == [254, 0, 205]


def tags(data: bytes) -> dict[int, tuple[float, ...] | bytes]:
    """The first directory of a TIFF file, by the letter of its specification (6.0, 1992)."""
    order = {b"II": "<", b"MM": ">"}[data[:2]]
    magic, begin = struct.unpack_from(order + "HI", data, 2)
    assert magic == 42
    found: dict[int, tuple[float, ...] | bytes] = {}
    (count,) = struct.unpack_from(order + "H", data, begin)
    for entry in range(begin + 2, begin + 2 + 12 * count, 12):
        tag, kind, number = struct.unpack_from(order + "HHI", data, entry)
        letter = {2: "s", 3: "H", 4: "I", 5: "Q", 12: "d"}[kind]
        size = struct.calcsize(letter) * number
        place = entry + 8
        if size > 4:
            (place,) = struct.unpack_from(order + "I", data, entry + 8)
        values = struct.unpack_from(f"{order}{number}{letter}", data, place)
        found[tag] = values[0] if letter == "s" else values
    return found


def test_the_geotiff_says_itself_where_it_lies(folder: Path) -> None:
    """O-54: scale, origin, unit and colours, read by the specification of GeoTIFF 1.0."""
    found = tags((folder / "team_map_geo.tiff").read_bytes())
    assert (found[256], found[257]) == ((40,), (30,))
    assert found[33550] == (0.2, 0.2, 0.0)
    assert found[33922] == (0.0, 0.0, 0.0, -2.0, 10.0, 0.0)
    keys = found[34735]
    assert keys[:3] == (1, 1, 0)
    table = {keys[n]: keys[n + 1 : n + 4] for n in range(4, 4 + 4 * int(keys[3]), 4)}
    assert table[1024] == (0, 1, 1)
    assert table[1025] == (0, 1, 1)
    assert table[3076] == (0, 1, 9001)
    where, count, start = table[1026]
    text = found[34737]
    assert where == 34737
    assert isinstance(text, bytes)
    assert text[start : start + count] == b"USARSim world frame, m|"
    with (
        Image.open(folder / "team_map_geo.tiff") as one,
        Image.open(folder / "team_map.tiff") as two,
    ):
        assert np.array_equal(np.asarray(one), np.asarray(two))


def test_a_reader_of_geotiffs_agrees(folder: Path) -> None:
    """O-54, by a library that knows the format, where it is installed."""
    tifffile = pytest.importorskip("tifffile")
    with tifffile.TiffFile(folder / "team_map_geo.tiff") as file:
        geo = file.pages[0].geotiff_tags
        pixels = file.pages[0].asarray()
    assert geo["ModelPixelScale"] == [0.2, 0.2, 0.0]
    assert geo["ModelTiepoint"] == [0.0, 0.0, 0.0, -2.0, 10.0, 0.0]
    assert int(geo["ProjLinearUnitsGeoKey"]) == 9001
    assert tuple(pixels[29, 0]) == SEARCHED_GREEN


def test_victims_are_read_back(folder: Path) -> None:
    """O-54: the victim text."""
    text = (folder / "team_victim.txt").read_text()
    assert text == (
        "Victim1, 3.000, 7.500, 0, VICTIM, 1\nVictim2, -1.250, 5.125, 0, VICTIM, 1\nEND\n"
    )
    assert [(one.number, one.x, one.y) for one in read_victims(text)] == [
        (1, 3.0, 7.5),
        (2, -1.25, 5.125),
    ]
    info = (folder / "team_victim_info.txt").read_text()
    assert info == "Victim1, conscious\nVictim2, he says _go__ I think\n"
    for bad, problem in (("Victim1, 3\nEND\n", "line 1"), ("", "END is missing")):
        with pytest.raises(ValueError, match=problem):
            read_victims(bad)


@given(
    st.lists(
        st.builds(Reported, st.integers(1, 999), st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
        max_size=9,
    )
)
def test_any_victims_are_read_back(victims: list[Reported]) -> None:
    """O-54: to the millimetre."""
    again = read_victims(victim_text(victims))
    assert [one.number for one in again] == [one.number for one in victims]
    for one, other in zip(again, victims, strict=True):
        assert (one.x, one.y) == pytest.approx((other.x, other.y), abs=0.00051)


def test_mapinfo_pairs_have_a_row_per_object(folder: Path) -> None:
    """O-54: MID and MIF of victims and paths."""
    mif = (folder / "team_victim.mif").read_text()
    assert 'CoordSys NonEarth Units "m" Bounds (-2.000, 4.000) (6.000, 10.000)\n' in mif
    assert re.findall(r"^Point (.*)$", mif, re.MULTILINE) == ["3.000 7.500", "-1.250 5.125"]
    assert (folder / "team_victim.mid").read_text() == '1,"Victim1"\n2,"Victim2"\n'
    body = (folder / "team_path.mif").read_text().partition("Data\n\n")[2]
    assert body == (
        "Pline 3\n0.000 5.000\n1.000 5.500\n2.500 5.500\n    Pen (2,2,15079755)\n"
        "None\n"
        "Pline 2\n0.000 5.000\n1.000 6.000\n    Pen (2,2,2987570)\n"
    )
    assert (folder / "team_path.mid").read_text() == '1,"R1"\n2,"R2"\n3,"R_3"\n'


def test_the_grid_is_there_as_ros_has_maps(folder: Path) -> None:
    about = yaml.safe_load((folder / "team.yaml").read_text())
    assert about["resolution"] == 0.2
    assert about["origin"] == [-2.0, 4.0, 0.0]
    with Image.open(folder / about["image"]) as image:
        assert image.getpixel((0, 29)) == 254  # the first pixel of the last row is at the origin
        assert image.getpixel((39, 29)) == 0


def test_a_victim_beside_the_map_leaves_the_rest_as_it_is(tmp_path: Path) -> None:
    write_hand_in(tmp_path, "a", grid(), [Reported(1, 100.0, -100.0), Reported(2, -2.3, 5.0)], {})
    with Image.open(tmp_path / "a_map.tiff") as image:
        red = np.all(np.asarray(image) == VICTIM_RED, axis=2)
    assert int(red.sum()) == 1


def test_a_run_is_handed_in_from_its_logs(played: Path) -> None:
    """O-54: the last map, the marks that stand, the robots' ways."""
    files = {path.name for path in (played / "map").iterdir()}
    assert {"scripted_map.tiff", "scripted_map_geo.tiff", "scripted_path.mif"} <= files
    victims = read_victims((played / "map/scripted_victim.txt").read_text())
    assert [(one.x, one.y) for one in victims] == [(5.0, 5.3), (15.0, 5.3), (15.0, 9.0)]
    assert "Pline" in (played / "map/scripted_path.mif").read_text()
    with Image.open(played / "map/scripted_map.tiff") as image:
        assert np.all(np.asarray(image) == SEARCHED_GREEN, axis=2).sum() > 1000


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RunLogError, match="cannot be written"):
        write_hand_in(tmp_path / "file" / "map", "a", grid(), [], {})
