"""Whole sessions of scripted participants at a desk, without a browser, with a server behind it."""

from __future__ import annotations

import asyncio
import json
import random
from pathlib import Path
from typing import Any

import psutil
import pytest
from desk_pages import STUDY, write_study

pytest.importorskip("scipy")

from usarsim_client.truth import TruthRow
from usarsim_study.dataset import collect
from usarsim_study.scripted.answers import Feeling, answer, load_of
from usarsim_study.scripted.crowd import Crowd, run_scripted
from usarsim_study.session.attempt import Attempt
from usarsim_study.session.opening import open_folder
from usarsim_study.session.staging import Options

NEAR = """\
schema = "usar-mission/1"
title = "One victim ahead, one robot in the way"
world = "empty"
time_limit = 8.5
scoring = "rsarsim"
[[robot]]
name = "R1"
class = "P2AT"
position = [0.0, 0.0, 0.25]
[[robot]]
name = "R2"
class = "P2AT"
position = [0.9, 0.0, 0.25]
[[victim]]
name = "MaleVictim_0"
position = [3.0, 1.2, 0.12]
[[zone]]
name = "start"
colour = "orange"
x = [-0.5, 0.6]
y = [-1.0, 1.0]
"""
PROBE = """
[[probe]]
at = 2.0
question = "moving"
"""
TRIES = (
    (0.2, "estop"),
    (0.4, "estop_reset"),
    (0.5, "laser off"),
    (0.8, "laser on"),
    (1.0, "camera off"),
    (1.3, "camera on"),
    (1.5, "ahead"),
    (7.0, "acknowledge"),
    (7.4, "mark_edit"),
    (7.8, "mark_delete"),
)
KINDS = frozenset(
    [
        "session",
        "trial_start",
        "trial_end",
        "select",
        "input",
        "command",
        "mode",
        "estop",
        "connect",
        "laser",
        "camera",
        "zone",
        "bumper",
        "collision",
        "victim_visible_begin",
        "victim_visible_end",
        "mark_set",
        "mark_edit",
        "mark_delete",
        "credit",
        "score",
        "probe",
        "form",
        "impairment",
        "error",
    ]
)
"""Of section 5 of the facts on operators: all that a log of a session may hold."""


def records_of(run: Path) -> list[dict[str, Any]]:
    """Those of a log, in the order of their numbers."""
    lines = [
        line
        for name in ("events.jsonl", "truth.jsonl")
        for line in (run / name).read_text().splitlines()
    ]
    return sorted((json.loads(line) for line in lines), key=lambda one: one["seq"])


@pytest.mark.slow
def test_a_session_runs_unattended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """O-41: consent, forms, two trials that are driven, a probe in each, the export. O-46: every
    kind of record, and numbers without gaps. O-45: the server of the second trial is killed; the
    trial is void and repeated."""
    text = STUDY.replace('name = "plain"', 'name = "plain"\ndevice = "keyboard"').replace(
        'name = "delayed"', 'name = "delayed"\ndevice = "gamepad"\nimpair = "late.toml"'
    )
    (tmp_path / "late.toml").write_text("[link]\ndelay_ms = 1\n")
    meanwhile = Crowd.meanwhile
    others = set(psutil.Process().children(recursive=True))  # servers that further tests share

    async def deadly(self: Crowd, attempt: Attempt, row: TruthRow) -> None:
        await meanwhile(self, attempt, row)
        if (attempt.task.number, attempt.step.attempt) == (2, 1) and row.time > 0.5:
            for one in {*psutil.Process().children(recursive=True)} - others:
                one.kill()

    monkeypatch.setattr(Crowd, "meanwhile", deadly)
    folder = open_folder(str(write_study(tmp_path, text + PROBE, NEAR)), None)
    work = run_scripted(folder, Options("max"), 1, hands="gateway", advantage=0.0, tries=TRIES)
    crowd = asyncio.run(work)
    assert crowd.faults == []
    data = collect(folder)
    assert [one.status for one in data.participants] == ["complete"]
    assert [(one.status, one.attempt) for one in data.trials] == [("complete", 1), ("complete", 2)]
    assert data.trials[1].values["victims_found"] == 1.0
    for one in data.trials:
        assert one.values["tlx_raw"] is not None
        assert (one.values["teleoperations"] or 0.0) >= 1.0
    assert {one.form for one in data.answers} >= {"experience", "workload", "which"}
    found: set[str] = set()
    for run in tmp_path.glob("participants/*/trial-*"):
        records = records_of(run)
        assert [one["seq"] for one in records] == list(range(len(records)))
        found |= {one["kind"] for one in records}
        drives = [one["text"] for one in records if one["kind"] == "input"]
        assert len({one["device"] for one in drives if one["type"] == "drive"}) <= 1
    assert found >= KINDS, KINDS - found


@pytest.mark.parametrize("load", [0.0, 0.5, 1.0])
def test_answers_are_answers(load: float) -> None:
    """Workloads are multiples of the step within the scale, around how hard it was (O-42)."""
    feeling = Feeling(random.Random(1), load)
    item = {"kind": "scale", "low": 0.0, "high": 100.0, "step": 5.0}
    given = [answer(item, feeling) for _ in range(200)]
    assert all(0.0 <= one <= 100.0 and one % 5.0 == 0.0 for one in given)
    assert sum(given) / len(given) == pytest.approx(100.0 * load, abs=10.0)


def test_what_is_liked_is_chosen_where_it_can_be() -> None:
    item = {"kind": "choice", "choices": [{"name": "a"}, {"name": "b"}]}
    assert {answer(item, Feeling(random.Random(n), likes=frozenset("b"))) for n in range(9)} == {
        "b"
    }
    assert {answer(item, Feeling(random.Random(n))) for n in range(20)} == {"a", "b"}
    assert answer({"kind": "text", "required": False}, Feeling(random.Random(1))) is None
    assert load_of(0.3, 4) > load_of(0.7, 4)
    assert load_of(0.5, 12) > load_of(0.5, 4)
