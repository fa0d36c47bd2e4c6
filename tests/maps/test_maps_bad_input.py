"""Damaged, hostile and huge maps: one clear error, bounded memory and time."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from t3d_maps import actor, brush, cuboid, level, polygon, room, start, two_rooms

from usarsim_maps.build.csg import MAX_POLYGONS
from usarsim_maps.convert import Request, import_map
from usarsim_server.cli import main
from usarsim_server.errors import MapImportError
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

FUZZ = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def attempt(folder: Path, content: bytes) -> str:
    """Import some bytes as T3D; the world's name, or the error in one line."""
    source = folder / "fuzz.t3d"
    source.write_bytes(content)
    try:
        result = import_map(Request(source, cache=folder / "cache"))
    except MapImportError as error:
        told = str(error)
    else:
        build_scene(load_world(result.folder))
        return result.folder.name
    assert "\n" not in told
    assert str(folder) in told
    return told


@given(st.binary(max_size=400))
@FUZZ
def test_any_bytes(tmp_path: Path, content: bytes) -> None:
    """Bytes of any kind end in one error that names the file."""
    assert "fuzz.t3d" in attempt(tmp_path, content)


@given(st.data())
@FUZZ
def test_garbled_maps(tmp_path: Path, data: st.DataObject) -> None:
    """A good map with some bytes changed gives a world that loads, or one error (item 73)."""
    content = bytearray(two_rooms().encode())
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.sampled_from(b"\0\xff-e9(=\n "))
    assert attempt(tmp_path, bytes(content))


NASTY = st.sampled_from(
    ["1e999", "-1e999", "nan", "1e30", "0", "-0", "", "1e-300", "(((", "99999999999"]
)


@given(st.tuples(NASTY, NASTY, NASTY), st.tuples(NASTY, NASTY, NASTY), NASTY)
@FUZZ
def test_senseless_numbers(
    tmp_path: Path, place: tuple[str, ...], scale: tuple[str, ...], number: str
) -> None:
    """Infinite places, zero scales and the like never crash, nor get into a world."""
    properties = (
        "Location=(X={},Y={},Z={})\n".format(*place)
        + "DrawScale3D=(X={},Y={},Z={})\n".format(*scale)
        + f"Rotation=(Yaw={number})\nPolyFlags={number}\n"
    )
    text = level(
        room(),
        brush("B", (0, 0, 0), (100, 100, 100), properties=properties),
        actor("MaleVictim", "V", properties=properties),
        actor("PathNode", "P", properties=properties),
        actor("PointLight", "L", properties=properties + f"Radius={number}\nBrightness={number}"),
        actor("PlayerStart", "Q", properties=properties),
        start("S", (0, 0, 60)),
    )
    assert attempt(tmp_path, text.encode())


def test_ten_gigabytes_are_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that claims 10 GB is refused before anybody reads it (exit code 2)."""
    path = tmp_path / "huge.t3d"
    with path.open("wb") as file:
        file.write(b"Begin Map\n")
        file.truncate(10 << 30)
    tracemalloc.start()
    assert main(["import", str(path), "--out", str(tmp_path)]) == 2
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "larger than" in capsys.readouterr().err
    assert peak < 64 << 20


def test_monster_brushes_are_dropped(tmp_path: Path) -> None:
    """A brush of tens of thousands of faces costs a warning, not an hour."""
    faces = "\n".join(polygon(face) for face in cuboid((0, 0, 0), (250, 250, 250)))
    monster = brush("Monster", (0, 0, 0), (1, 1, 1)).replace(
        "End Polygon\nEnd PolyList",
        "End Polygon\n" + (faces + "\n") * (MAX_POLYGONS // 5) + "End PolyList",
    )
    source = tmp_path / "monster.t3d"
    source.write_text(level(room(), monster, start("S", (0, 0, 60))))
    report = import_map(Request(source)).report
    assert any(subject == "Monster" for subject, _, _ in report.warnings)
    assert report.totals["brush cells"] == 6


def test_an_error_leaves_the_old_world(tmp_path: Path) -> None:
    """A map that became unreadable does not touch the world made from it before (item 73)."""
    source = tmp_path / "map.t3d"
    source.write_text(two_rooms())
    folder = import_map(Request(source, out=tmp_path / "out")).folder
    before = (folder / "scene.xml").read_bytes()
    source.write_text(two_rooms()[:500])
    with pytest.raises(MapImportError):
        import_map(Request(source, out=tmp_path / "out"))
    assert (folder / "scene.xml").read_bytes() == before
