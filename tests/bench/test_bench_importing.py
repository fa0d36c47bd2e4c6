"""The measurement of imports: its maps, its instrument and its figures."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from usarsim_bench import importing
from usarsim_bench.camera_client import Picture
from usarsim_bench.figures import Plan
from usarsim_bench.importing import measure_import
from usarsim_bench.map_sources import BRUSHES, MESHES, write_hall, write_yard
from usarsim_bench.server import BenchError, Load
from usarsim_bench.team import TeamTrial
from usarsim_maps.convert import Request, import_map
from usarsim_maps.reader import ImportOptions

RESULT = {
    "first": 4.0,
    "again": 0.002,
    "compiling": 1.0,
    "scan": 6e-5,
    "hits": 0.9,
    "peak": 2**29,
    "model": 2**25,
    "pieces": 900,
    "triangles": 52000,
    "starts": 4,
}


def test_the_hall_is_a_competition_map(tmp_path: Path) -> None:
    """Fifty brushes and a hundred meshes; nothing is missing but a texture, starts are free."""
    source, assets = write_hall(tmp_path)
    request = Request(source, options=ImportOptions(assets=(assets,)), cache=tmp_path / "cache")
    report = import_map(request).report
    assert report.totals["brushes"] == BRUSHES
    assert report.totals["objects"] == MESHES
    assert [kind for kind, _, _ in report.missing] == ["texture"]
    # Furniture stands upright between floor and ceiling of the rooms, and inside them.
    assert report.upper[2] == pytest.approx(3.0)
    assert report.extents[1] == pytest.approx(2 * (1.2 + 0.16 + 5.0))
    assert [overlap for _, _, overlap in report.starts] == [0.0] * 4
    assert [round(height or 9.0, 3) for _, height, _ in report.starts] == [0.3] * 4


def test_the_yard_has_as_many_triangles_as_asked_for(tmp_path: Path) -> None:
    """One COLLADA file, exact up to a hundred triangles; starts stand on the ground."""
    wanted = 14_000
    source = write_yard(tmp_path, wanted)
    result = import_map(Request(source, cache=tmp_path / "cache"))
    text = source.read_text()
    found = sum(int(part.partition('"')[0]) for part in text.split('<triangles count="')[1:])
    assert wanted - 100 <= found <= wanted
    assert result.report.extents[:2] == (60.0, 60.0)
    assert [round(height or 9.0, 3) for _, height, _ in result.report.starts] == [0.3] * 4


def test_the_instrument_measures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every figure of a real import is there, and the world is where it was asked for."""
    source, assets = write_hall(tmp_path)
    arguments = [str(source), "--out", str(tmp_path), "--assets", str(assets)]
    assert importing.main(arguments) == 0
    result = json.loads(capsys.readouterr().out)
    assert set(result) == set(RESULT)
    assert (tmp_path / "hall" / "world.toml").is_file()
    assert all(result[key] > 0 for key in RESULT)
    assert result["again"] < result["first"]
    assert 0.5 < result["hits"] <= 1.0
    assert 5_000 < result["triangles"] < 15_000
    assert result["starts"] == 4


def test_a_map_that_cannot_be_imported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The instrument says what was wrong, on standard error, and measures nothing."""
    assert importing.main([str(tmp_path / "no.t3d"), "--out", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert "no such file" in said.err
    assert said.out == ""


def test_figures_of_the_section(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both maps have figures with aims; the team's are those of the worlds that were made."""
    answer(monkeypatch, json.dumps(RESULT))
    worlds: list[str] = []
    stand_ins(monkeypatch, worlds)
    section = measure_import(Plan(robots=2, seconds=3.0))
    figures = {figure.name: figure for figure in section.figures}
    assert figures["Hall: import"].met is True
    assert figures["Hall: first import / second, from the cache"].value == pytest.approx(2000.0)
    assert figures["Hall: one scan, median"].aim is None
    assert figures["Yard: one scan, median"].value == pytest.approx(60.0)
    assert figures["Yard: one scan, median"].met is True
    assert figures["Yard, 2 robots: real-time factor, lowest of all"].met is False
    assert figures["Yard, 2 robots: pictures of the tile"].value == pytest.approx(10.0)
    assert [Path(world).name for world in worlds] == ["hall", "yard"]


def test_a_failure_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the instrument fails the report says why."""
    answer(monkeypatch, "", 2, "hall.t3d: broken")
    with pytest.raises(BenchError, match=r"hall\.t3d: broken"):
        measure_import(Plan())


def answer(monkeypatch: pytest.MonkeyPatch, output: str, code: int = 0, error: str = "") -> None:
    """Let something stand for the importing."""

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, code, output, error)

    monkeypatch.setattr(subprocess, "run", run)


def stand_ins(monkeypatch: pytest.MonkeyPatch, worlds: list[str]) -> None:
    """Let nobody stand for server, crowd and viewer."""

    class Nobody:
        port = 0
        ports: dict[str, int] = {"images": 1}  # noqa: RUF012
        pictures = [Picture(0.1 * n, 0.1 * n + 0.01, 100, n) for n in range(20)]  # noqa: RUF012

        def __init__(self, *given: Any) -> None:
            if isinstance(given[0], str):
                worlds.append(given[0])

        def __enter__(self) -> Nobody:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    def fake(server: object, crowd: object, robots: int, seconds: float) -> TeamTrial:
        load = Load(process=0.5, own=0.1, others=0.0)
        return TeamTrial(robots, 0.99, 0.9, load, 10.0, 1e3, 2**20, 0.0, 1.0)

    for name in ("Server", "Crowd", "Viewer"):
        monkeypatch.setattr(importing, name, Nobody)
    monkeypatch.setattr(importing, "try_team", fake)
