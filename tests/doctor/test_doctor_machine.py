"""The machine: where a warning begins, and what it advises."""

from __future__ import annotations

import pytest

from usarsim_server.doctor.checks.machine import (
    Activity,
    judge_activity,
    judge_cores,
    judge_descriptors,
    judge_memory,
)
from usarsim_server.doctor.registry import Context, Mark
from usarsim_server.processes import Process
from usarsim_server.settings import Settings

HERE = Context(Settings(), (("--world", "office"),))
MIB = 1 << 20


def test_one_processor_is_few() -> None:
    """With a single processor fewer pictures are advised; two are enough."""
    finding = judge_cores(1.0, HERE)
    assert finding.mark is Mark.WARNING
    assert finding.cure == "usarsim serve --world office --camera-rate 5"
    assert judge_cores(2.0, HERE).mark is Mark.OK


@pytest.mark.parametrize(
    ("free", "mark"),
    [(300 * MIB, Mark.PROBLEM), (700 * MIB, Mark.WARNING), (2048 * MIB, Mark.OK)],
)
def test_memory_has_two_limits(free: int, mark: Mark) -> None:
    """Below what a server takes is a problem, little above it a warning."""
    finding = judge_memory(free, 4096 * MIB)
    assert finding.mark is mark
    assert (finding.cure is None) is (mark is Mark.OK)
    assert finding.values == {"available_bytes": free, "total_bytes": 4096 * MIB}


def test_a_program_that_keeps_the_machine_busy_is_named() -> None:
    """It is told to stand back by its number; nothing is advised that would end it."""
    busy = judge_activity(Activity(2, 1.1, Process(4242, "blender scene", 1.0)), 1.3)
    assert busy.mark is Mark.WARNING
    assert "1.1 of 2 processors" in busy.text
    assert "blender scene (pid 4242)" in busy.text
    assert busy.cure is not None
    assert busy.cure.endswith("renice -n 19 -p 4242")


def test_many_small_programs_are_nobodys_fault() -> None:
    """Where nobody stands out, a way to look is advised; a little work is no warning."""
    crowd = judge_activity(Activity(8, 4.0, Process(7, "sh", 0.2)), 4.0)
    assert (crowd.mark, crowd.cure) == (Mark.WARNING, "top -o %CPU")
    assert judge_activity(Activity(8, 1.0, Process(7, "sh", 1.0)), 4.0).mark is Mark.OK
    assert judge_activity(Activity(2, 0.0, None), 0.0).mark is Mark.OK


def test_few_descriptors_are_a_warning() -> None:
    """The limit must hold the control connections of the settings and all the rest."""
    assert judge_descriptors(256, 64).mark is Mark.WARNING
    assert judge_descriptors(1024, 64).mark is Mark.OK
    assert judge_descriptors(1024, 1024).cure == "ulimit -n 4096"
    assert judge_descriptors(-1, 1024).mark is Mark.OK
