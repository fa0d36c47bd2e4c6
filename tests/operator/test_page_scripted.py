"""A scripted participant at the real pages: forms by clicks, keys, pad and mouse in the panel."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

pytest.importorskip("aiohttp")
pytest.importorskip("scipy")

from console_browser import executable

from usarsim_study.dataset import collect
from usarsim_study.scripted.crowd import run_scripted
from usarsim_study.session.opening import open_folder
from usarsim_study.session.staging import Options

STUDY = """\
title = "Keyboard or gamepad"
seed = 5
participants = 2
primary = "victims_found"
[[condition]]
name = "keyboard"
device = "keyboard"
[[condition]]
name = "gamepad"
device = "gamepad"
[[layout]]
name = "A"
mission = "one.toml"
[[form]]
name = "before"
kind = "questionnaire"
when = "before"
title = "Before we begin"
[[form.item]]
name = "words"
text = "What do you expect?"
kind = "text"
[[form.item]]
name = "glasses"
text = "Do you wear glasses?"
kind = "flag"
page = 2
[[form]]
name = "workload"
kind = "nasa-tlx"
when = "after_trial"
[[form]]
name = "which"
kind = "preference"
when = "after"
"""
MISSION = """\
schema = "usar-mission/1"
title = "One victim ahead"
world = "empty"
time_limit = 16
scoring = "rsarsim"
[[robot]]
name = "R1"
class = "P3DX"
position = [0.0, 0.0, 0.25]
[[victim]]
name = "MaleVictim_0"
position = [2.5, 0.6, 0.12]
"""


@pytest.mark.slow
def test_a_session_at_real_pages(tmp_path: Path, page_folder: Path) -> None:
    """O-41, HRI-02: one participant drives by keys, then by the pad, marks on the map, and fills in
    all forms."""
    executable()
    pytest.importorskip("playwright.async_api")
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "one.toml").write_text(MISSION)
    folder = open_folder(str(tmp_path / "study.toml"), None)
    crowd = asyncio.run(run_scripted(folder, Options("max"), 1, advantage=0.0, tries=()))
    assert crowd.faults == []
    data = collect(folder)
    assert [one.status for one in data.trials] == ["complete", "complete"]
    assert {one.form for one in data.answers} == {"before", "workload", "which"}
    for one in data.trials:
        (run,) = tmp_path.glob(f"participants/*/trial-{one.trial}")
        rows = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
        said = [row["text"] for row in rows if row["kind"] == "input"]
        devices = {text["device"] for text in said if text["type"] == "drive"}
        assert devices == {"keyboard" if one.condition == "keyboard" else "pad"}
        assert one.values["victims_found"] == 1.0, "the mark on the map is where the victim is"
        assert one.values["tlx_raw"] is not None
