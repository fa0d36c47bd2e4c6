"""Ten simulated minutes with eight robots are the same in two processes (robots 113, 115; V26)."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("long_run.py")
SECONDS = 600.0
LINES = 8 * 600 * 15
"""Lines of eight robots in that time, at the least."""


@pytest.mark.timeout(600)
def test_ten_minutes_are_the_same_to_the_letter_and_to_the_bit() -> None:
    """Text of all robots and state of the world agree between processes; another seed differs."""
    runs = [(5, SECONDS), (5, SECONDS), (6, 5.0)]
    processes = [
        subprocess.Popen(
            [sys.executable, str(PROGRAM), str(seed), str(seconds)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for seed, seconds in runs
    ]
    said = [process.communicate() for process in processes]
    for process, (_, errors) in zip(processes, said, strict=True):
        assert process.returncode == 0, errors
    (first, heard, time), second, third = (text.split() for text, _ in said)
    assert second == [first, heard, time]
    assert third[0] != first
    assert float(time) == pytest.approx(SECONDS, abs=0.01)
    assert int(heard) > LINES
