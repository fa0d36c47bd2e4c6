"""The measurement of imports: its maps, its instrument and its figures."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest
from bench_fakes import Nobody, a_trial, by_name

from usarsim_bench import importing
from usarsim_bench.figures import Plan
from usarsim_bench.importing import Importing, measure, measure_import
from usarsim_bench.map_sources import BRUSHES, MESHES, write_hall, write_yard
from usarsim_bench.server import BenchError
from usarsim_maps.convert import Request, import_map
from usarsim_maps.reader import ImportOptions

RESULT = Importing(4.0, 0.002, 1.0, 6e-5, 0.9, 2**29, 2**25, 900, 52000, 4)


@pytest.mark.slow
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


def test_the_import_is_measured(tmp_path: Path) -> None:
    """Every figure of a real import is there, and the world is where it was asked for."""
    source, assets = write_hall(tmp_path)
    result = measure(source, tmp_path, [assets])
    assert (tmp_path / "hall" / "world.toml").is_file()
    assert all(value > 0 for value in asdict(result).values())
    assert result.again < result.first
    assert 0.5 < result.hits <= 1.0
    assert 5_000 < result.triangles < 15_000
    assert result.starts == 4


def test_figures_of_the_section(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both maps have figures with aims; the team's are those of the worlds that were made."""
    worlds: list[str] = []
    monkeypatch.setattr(importing, "run_apart", lambda *_, patience: RESULT)

    def server(world: str, robots: int) -> Nobody:
        worlds.append(world)
        return Nobody()

    monkeypatch.setattr(importing, "Server", server)
    monkeypatch.setattr(importing, "Crowd", Nobody)
    monkeypatch.setattr(importing, "Viewer", Nobody)
    monkeypatch.setattr(importing, "try_team", lambda *_: a_trial(2, 0.99))
    figures = by_name(measure_import(Plan(robots=2, seconds=3.0)))
    assert figures["Hall: import"].met is True
    assert figures["Hall: first import / second, from the cache"].value == pytest.approx(2000.0)
    assert figures["Hall: one scan, median"].aim is None
    assert figures["Yard: one scan, median"].value == pytest.approx(60.0)
    assert figures["Yard: one scan, median"].met is True
    assert figures["Yard, 2 robots: real-time factor, lowest of all"].met is False
    assert figures["Yard, 2 robots: pictures of the tile"].value == pytest.approx(10.0)
    assert [Path(world).name for world in worlds] == ["hall", "yard"]


def test_a_failure_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """If a map cannot be imported the report says why."""
    monkeypatch.setattr(importing, "write_hall", lambda folder: (folder / "no.t3d", folder))
    with pytest.raises(BenchError, match=r"no\.t3d: no such file"):
        measure_import(Plan())
