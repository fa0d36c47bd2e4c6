"""Faults planted in our own server can be planted, and are noticed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from usarsim_conformance.planted import Fault, all_faults
from usarsim_conformance.planted.faults import Edit
from usarsim_conformance.planted.trial import PlantError, as_table, edited, edited_copy, try_faults
from usarsim_conformance.registry import all_checks

_FAULTS = {fault.name: fault for fault in all_faults()}
_SAMPLE = ("sensors.odometry.x-sign",)
"""Tried for real here; `usarsim conformance --planted` tries all."""


@pytest.mark.parametrize("fault", _FAULTS.values(), ids=_FAULTS.keys())
def test_faults_can_be_planted(fault: Fault) -> None:
    """The text to replace is there, means something else afterwards, and the checks exist."""
    assert edited(fault.edits)
    assert set(fault.notices) <= {check.id for check in all_checks()}


def test_faults_that_change_nothing_are_errors() -> None:
    """Neither a missing text nor a comment is a fault."""
    file = "usarsim_server/sensors/wheels.py"
    for old, new, problem in (
        ("no such text", "", "stands there 0 times"),
        ("robot", "engine", "times, not once"),
        ("return robot.rolls", "return robot.rolls  # true", "changes nothing"),
        ("return robot.rolls", "return (", "cannot be read"),
    ):
        with pytest.raises(PlantError, match=problem):
            edited([Edit(file, old, new)])
    with pytest.raises(PlantError, match="does not exist"):
        edited([Edit("robots/NoSuch.toml", "", "")])
    with pytest.raises(PlantError, match="neither in"):
        edited([Edit("tools/usarsim_client.blocking.py", "", "")])


def test_copies_are_links_but_for_the_edit(tmp_path: Path) -> None:
    """Robot files can be edited, too; what is not edited is the original."""
    edited_copy([Edit("robots/P2AT.toml", "life = 1200", "life = 600")], tmp_path)
    assert "life = 600" in (tmp_path / "robots/P2AT.toml").read_text()
    assert (tmp_path / "robots/P3AT.toml").is_symlink()
    assert (tmp_path / "usarsim_server/sensors").is_symlink()
    assert not (tmp_path / "usarsim_server/files.py").is_symlink()


def test_a_sample_is_noticed() -> None:
    """Servers with a fault are told from the healthy one by the check that is meant for it."""
    outcomes = try_faults([_FAULTS[name] for name in _SAMPLE])
    assert all(outcome.good for outcome in outcomes), as_table(outcomes)


def test_what_is_not_noticed_is_told() -> None:
    """A check that passes in spite of the fault, or does not name the field, is no success."""
    fault = _FAULTS[_SAMPLE[0]]
    unheard = replace(fault, name="test.unheard", notices=("control.sensors.odometry-start",))
    unnamed = replace(fault, name="test.unnamed", field="Loudness")
    outcomes = try_faults([unheard, unnamed])
    words = [outcome.lines[0][1] for outcome in outcomes]
    assert words == ["passes", "MISSED", "UNNAMED"]
    assert "0 of 2 faults noticed; wrong: test.unheard, test.unnamed" in as_table(outcomes)
