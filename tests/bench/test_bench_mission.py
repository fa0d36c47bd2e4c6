"""The referee costs little, its logs say what it said; trials and reports are measured."""

from __future__ import annotations

import pytest

from usarsim_bench.figures import Plan
from usarsim_bench.mission import referee_figures
from usarsim_bench.mission_run import study_figures, trial_figures


def test_a_referee_costs_less_than_a_twentieth_of_a_core() -> None:
    """With 16 robots and 20 victims, by its processor time; scored again nothing differs (O-47)."""
    figures = {one.name: one for one in referee_figures(Plan(seconds=10.0))}
    assert figures["Referee"].met
    assert figures["Differences then"].value == 0


@pytest.mark.slow
def test_a_trial_and_a_report_are_measured() -> None:
    """A server, a gateway and a referee for three simulated seconds, and a study of four people."""
    figures = {one.name: one for one in trial_figures(Plan(seconds=3.0))}
    here, there = figures["Gateway, referee and logs"].value, figures["Server"].value
    assert min(here, there) > 0.0
    assert figures["The same by time of processors"].value == 1.0 / (here + there)
    assert figures["Trial, to real time"].value > 0.0
    (report,) = study_figures(Plan(), participants=4)
    assert 0.0 < report.value < 20.0
