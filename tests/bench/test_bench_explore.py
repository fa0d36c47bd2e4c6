"""`usarsim bench explore`: what a step costs, and that both forms of the kernels know the same."""

import pytest

from usarsim_bench import exploration
from usarsim_bench.exploration import Case, measure_explore
from usarsim_bench.figures import Plan
from usarsim_bench.server import BenchError


def test_a_small_team_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """EXP-05, E-79: times by phase, and equal maps with and without compiled kernels."""
    plain = Case("plain", "lab", 2, 1e6, plain=True)
    monkeypatch.setattr(exploration, "CASES", (Case("small", "lab", 2, 1e6), plain))
    section = measure_explore(Plan(seconds=0.8))
    assert [figure.name for figure in section.figures] == ["a step, small", "a step, plain"]
    assert all(figure.met for figure in section.figures)
    assert section.table is not None
    assert [row[:2] for row in section.table.rows] == [("small", "8"), ("plain", "8")]


def test_maps_that_differ_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A case beside another one of the same team must come to the same maps."""
    digests = iter("ab")

    def measured(_: object, case: Case, steps: int) -> exploration.Cost:
        return exploration.Cost(steps, 0.001, (0.0, 0.001, 0.0), 1, next(digests))

    monkeypatch.setattr(exploration, "run_apart", measured)
    monkeypatch.setattr(exploration, "CASES", exploration.CASES[:2])
    with pytest.raises(BenchError, match="plain: plain and compiled kernels"):
        measure_explore(Plan())
