"""What a report says of runs that were made on the grid and with physics."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from batch_example import batch, run, write
from small_world import small

from usarsim_exploration.batches.playing import curves
from usarsim_exploration.reporting import agreement_page, report
from usarsim_exploration.reporting.agreement import Agreement, agree
from usarsim_exploration.reporting.comparison import compare
from usarsim_exploration.reporting.pictures import Look
from usarsim_exploration.reporting.runs import read
from usarsim_exploration.run_folder import write as write_run
from usarsim_exploration.running import run as explore
from usarsim_report.page import Page
from usarsim_server import cli

NAMES = ("frontier", "ratio", "role-based", "$_<&")


def level(
    backend: str,
    slower: float = 1.0,
    names: tuple[str, ...] = NAMES,
) -> dict[str, Any]:
    """Runs of some strategies, with distances; times of others than the grid are longer."""
    runs = [
        run(name, seed, place)
        for place in ("office", "maze")
        for name in names
        for seed in range(4)
    ]
    for one in runs:
        steps = np.array(one["curves"]["steps"])
        one["curves"]["distance"] = (40.0 * steps).tolist()
        if backend != "grid":
            one["measures"] |= {
                "map_error": 0.04, "slip": 12.5, "collisions": 2, "aligned_iou": 0.9,
            }  # fmt: skip
            for name in ("team_t90", "base_t90"):
                time = one["measures"][name]
                one["measures"][name] = round(time * slower) if time else None
    return batch(*runs) | {"batch": {"end": {"steps": 500}, "backend": backend}}


def told(folder: Path, grid: dict[str, Any], real: dict[str, Any]) -> Agreement | None:
    """What two batches say."""
    levels = agree(compare(read([write(folder / "a", grid), write(folder / "b", real)])))
    assert len(levels) < 2
    return levels[0] if levels else None


def test_levels_that_agree(tmp_path: Path) -> None:
    """E-81, EXP-15: the same curves and a fifth more time: no difference, and the same order."""
    found = told(tmp_path, level("grid"), level("server", 1.2))
    assert found is not None
    assert [str(one.real.setting) for one in found.pairs] == [
        "maze, 4 robots, circle, server", "office, 4 robots, circle, server",
    ]  # fmt: skip
    for pair in found.pairs:
        assert {one.gap for one in pair.coverage.values()} == {0.0}
        times = pair.orders["team_t90"].times
        assert times["frontier"][1] == pytest.approx(1.2 * times["frontier"][0], rel=0.01)
    tau, between = found.over_all["team_t90"]
    assert tau == 1.0
    assert between is None or 0.8 < between.low <= between.high == 1.0


def test_levels_that_do_not(tmp_path: Path) -> None:
    """EXP-15: the slowest first: tau is -1; half the coverage at a distance is a difference."""
    real = level("server")
    for one in real["runs"]:
        for goal in ("team_t90", "base_t90"):
            one["measures"][goal] = {"frontier": 400, "ratio": 300, "role-based": 200}.get(
                one["strategy"], 100
            )
        one["curves"]["team"] = (np.array(one["curves"]["team"]) / 2).tolist()
    found = told(tmp_path, level("grid"), real)
    assert found is not None
    assert found.over_all["team_t90"][0] < -0.6
    assert max(one.gap for one in found.pairs[0].coverage.values()) == pytest.approx(49, abs=2)


def test_a_report_of_both_levels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """EXP-15, EXP-16, EXP-20: curves, a scatter plot, costs; the same bytes again."""
    monkeypatch.setattr(report, "PICTURED", 0)
    few = level("grid", 1.0, NAMES[:3]), level("server", 1.5, NAMES[:3])
    folders = [write(tmp_path / name, one) for name, one in zip("ab", few, strict=True)]
    assert cli.main(["explore", "report", *map(str, folders), "--out", str(tmp_path)]) == 0
    text = (tmp_path / "report.md").read_text()
    assert "## Grid and physics" in text
    assert "Kendall's tau" in text
    assert "| Map error [m] | 0.040" in text
    assert "| Slip [%] | 12.5" in text
    assert "| Overlap of the aligned map with the world | 0.9" in text
    assert ",server," in (tmp_path / "runs.csv").read_text()
    html = (tmp_path / "report.html").read_text()
    assert html.count('aria-label="Coverage by distance on the grid and with physics') == 2
    assert html.count("of strategies on the grid and with physics") == 1
    found, page = compare(read(folders)), Page("")
    (both,) = agree(found)
    agreement_page.write(page, both, Look(found.strategies))
    drawn = re.findall(r"<svg.*?</svg>", page.html(), re.DOTALL)
    assert len(drawn) == 3
    assert all(one in html for one in drawn)


def test_one_level_alone(tmp_path: Path) -> None:
    """Nothing is said of levels; nor of distances that are not told, nor of the order of two."""
    assert agree(compare(read([write(tmp_path / "a", level("grid"))]))) == []
    bare = level("server", names=NAMES[:2])
    for one in bare["runs"]:
        del one["curves"]["distance"]
    found = told(tmp_path, level("grid", names=NAMES[:2]), bare)
    assert found is not None
    assert not found.pairs[0].coverage
    assert found.pairs[0].orders["team_t90"].tau is None
    assert found.over_all == {}


def test_discs_stand_beside_the_grid(tmp_path: Path) -> None:
    """E-81, EXP-15: physics is compared with both levels of cells, each in a part of its own."""
    folders = [
        write(tmp_path / name, level(name, slower))
        for name, slower in (("grid", 1.0), ("discs", 1.3), ("server", 1.3))
    ]
    grid, discs = agree(compare(read(folders)))
    assert (grid.cells, discs.cells) == ("grid", "discs")
    for found, ratio in ((grid, 1.3), (discs, 1.0)):
        one, other = found.pairs[0].orders["team_t90"].times["frontier"]
        assert other == pytest.approx(ratio * one, rel=0.01)
    page = Page("")
    agreement_page.write(page, discs, Look(NAMES))
    assert "Discs and physics" in page.html()
    assert "steps with physics by steps with discs" in page.html()


def test_distances_of_single_runs_and_of_batches(tmp_path: Path) -> None:
    """Both say the same."""
    result = explore(small(tmp_path))
    write_run(result, tmp_path / "run", {})
    one = read([tmp_path / "run"])[0].runs[0].curves
    assert one is not None
    assert one.distance is not None
    row: Any = curves(result.history)
    assert one.distance[row["steps"][:-1]] == pytest.approx(row["distance"][:-1], abs=0.1)
    assert one.distance[-1] == pytest.approx(row["distance"][-1], abs=0.1)
