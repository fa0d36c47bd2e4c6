"""Faults planted in our own server can be planted, and are noticed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from planted import Fault, all_faults, read_faults
from planted.faults import Edit
from planted.trial import PlantError, as_table, edited, edited_copy, try_faults

from usarsim_conformance.registry import all_checks

_FAULTS = {fault.name: fault for fault in all_faults()}
_SAMPLE = "sensors.odometry.x-sign"
"""Tried for real here; `make planted` tries all."""


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


@pytest.mark.parametrize(
    "text",
    [
        "--- robots/P2AT.toml\n\n@@ name @@\n a.check: Field\n-old\n+new\n",
        "--- robots/P2AT.toml\n\n@@ area.name @@\n-old\n+new\n",
        "--- robots/P2AT.toml\n\n@@ area.name @@\n a.check: Field\n-old\n",
        "@@ area.name @@\n a.check: Field\n-old\n+new\n",
    ],
)
def test_malformed_faults_are_errors(text: str) -> None:
    """No area, no check, nothing in the place, no file."""
    with pytest.raises(ValueError, match="no fault of a file"):
        list(read_faults(text))


def test_copies_are_links_but_for_the_edit(tmp_path: Path) -> None:
    """Robot files can be edited, too; what is not edited is the original."""
    edited_copy([Edit("robots/P2AT.toml", "life = 1200", "life = 600")], tmp_path)
    assert "life = 600" in (tmp_path / "robots/P2AT.toml").read_text()
    assert (tmp_path / "robots/P3AT.toml").is_symlink()
    assert (tmp_path / "usarsim_server/sensors").is_symlink()
    assert not (tmp_path / "usarsim_server/base/files.py").is_symlink()


def test_a_sample_is_noticed() -> None:
    """Servers with a fault are told from the healthy one by the check that is meant for it; a
    check that passes in spite of the fault, or does not name the field, is no success."""
    fault = replace(_FAULTS[_SAMPLE], notices=_FAULTS[_SAMPLE].notices[:1])  # the quick one
    others = ("control.sensors.odometry-start", *fault.notices)
    unnoticed = replace(fault, name="test.unnoticed", notices=others, field="Loudness")
    healthy, noticed, missed = try_faults([fault, unnoticed])
    table = as_table([healthy, noticed, missed])
    assert healthy.good, table
    assert noticed.good, table
    assert [line[1] for line in missed.lines] == ["MISSED", *["UNNAMED"] * len(fault.notices)], (
        table
    )
    assert "1 of 2 faults noticed; wrong: test.unnoticed" in table
