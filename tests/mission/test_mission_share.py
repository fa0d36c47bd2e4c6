"""Shared runs: what is in the one file, what is left out for room or for privacy, broken runs."""

from __future__ import annotations

import base64
import json
import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_runs import SCENE, furnished, read_packed, unpacked
from test_mission_fuzz import ANY, GOOD, KEYS, KINDS, ROOMS

from usarsim_mission.errors import MissionError
from usarsim_mission.model import Mission, World
from usarsim_mission.sharing import file
from usarsim_mission.sharing.contents import LEVELS, Shown
from usarsim_mission.sharing.file import LIMIT, share
from usarsim_mission.sharing.story import Story
from usarsim_server.cli import main


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """The frame of the page; its style and its program are others' matter."""
    folder = tmp_path / "page"
    folder.mkdir()
    (folder / "share.html").write_text(
        '<title><!--title--></title><style>/*style*/</style><script type="application/octet-stream"'
        ' id="run"><!--run--></script><script>/*program*/</script>'
    )
    (folder / "share.css").write_text("body { margin: 0 }")
    (folder / "share.js").write_text('"</script>"')
    return folder


def test_what_happened_is_in_the_file(played: Path, page: Path, tmp_path: Path) -> None:
    """Places to the millimetre, rows without a place as absent, finds, marks, who drove when."""
    out = tmp_path / "one.html"
    size, _ = share(played, out, page)
    assert size == out.stat().st_size < LIMIT
    contents, arrays = unpacked(out)
    assert contents["title"] == "three rooms"
    assert "mission scripted" in contents["about"]
    for step in range(1, 251):
        row = step - 1
        assert arrays["time"][row] == 100 * step
        assert arrays["0.there"][row] == (step != 60)  # its height was no number there
        if step != 60:
            assert abs(arrays["0.x"][row] / 1000 - (1.0 + 0.1 * step)) < 1e-3
    assert arrays["0.left"][18:20].tolist() == [0, 50]
    assert arrays["0.source"][[18, 19, 89]].tolist() == [0, 1, 3]
    found = {one["name"]: one["found"] for one in contents["victims"]}
    assert found == {"Anna": 4.0, "Ben": 16.0, "Carl": None}
    assert [one[0] for one in contents["marks"]] == ["1", "2", "3"]
    assert [one[5] for one in contents["marks"]] == ["found", "found", "wrong"]
    words = [one[3] for one in contents["events"]]
    assert "R1 touches door" in words
    assert "R1 enters hall (orange)" in words
    assert contents["scores"][-1] == [25.0, round(contents["total"], 4)]
    assert contents["maps"]["steps"][0][0] == 25.0
    assert len(arrays["map.index"]) == contents["maps"]["steps"][0][1]
    assert "<\\/script>" in out.read_text()
    assert any("scenery was not kept" in one for one in contents["notes"])


def test_nobody_is_named(page: Path, tmp_path: Path) -> None:
    """HRI-16: names of people and notes of theirs are left out."""
    out = tmp_path / "one.html"
    share(furnished(tmp_path / "run"), out, page)
    text = json.dumps(unpacked(out)[0])
    assert "Secret" not in text
    assert "operator 1 comes" in text
    assert [one[1:] for one in unpacked(out)[0]["selected"]] == [[1, "R1"], [1, ""]]
    assert "Red herrings" in text


@pytest.mark.parametrize("told", ["--blind", "blind = true", "blind = ["])
def test_a_blind_study_names_no_condition(page: Path, tmp_path: Path, told: str) -> None:
    """HRI-05: neither mission nor team nor device, by option or by the study that it lies in."""
    study = tmp_path / "study"
    run = furnished(study / "participants" / "K7" / "trial-1")
    (study / "study.toml").write_text("" if told == "--blind" else told)
    out = tmp_path / "one.html"
    share(run, out, page, told == "--blind")
    contents, _ = unpacked(out)
    text = json.dumps(contents) + out.read_text()
    for secret in ("scripted", "three rooms", "Red herrings", "gamepad"):
        assert secret not in text
    assert contents["title"] == "A run"
    assert contents["about"] == "of a blind study"
    (study / "study.toml").write_text("blind = false")
    share(run, out, page)
    assert "Red herrings" in json.dumps(unpacked(out)[0])


def _large() -> dict[str, Any]:
    """Scenery with a picture, a large shape and small ones that nothing compresses."""
    noise = random.Random(1)
    data = base64.b64encode(noise.randbytes(300_000)).decode()
    meshes = {"m:1": _mesh(noise, 30_000)}
    meshes |= {f"m:{number}": _mesh(noise, 3000) for number in range(2, 10)}
    textures = {"t:1": {**SCENE["textures"]["t:1"], "data": data}}
    return {**SCENE, "meshes": meshes, "textures": textures}


def _mesh(noise: random.Random, count: int) -> dict[str, str]:
    vertices = np.array([noise.uniform(-2, 2) for _ in range(count)], "<f4").tobytes()
    return {"vertices": base64.b64encode(vertices).decode(), "faces": ""}


@pytest.mark.parametrize(
    ("limit", "rate", "left"),
    [
        (900_000, 10.0, ()),
        (450_000, 5.0, ("Pictures on walls",)),
        (220_000, 2.0, ("Pictures on walls", "1 large shapes are drawn as boxes")),
        (20_000, 1.0, ("The scenery is too large",)),
    ],
)
def test_what_has_no_room_is_said(
    page: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    limit: int,
    rate: float,
    left: tuple[str, ...],
) -> None:
    """Rows, pictures, shapes, scenery go one after another; the file says so, and its places are
    still the true ones."""
    monkeypatch.setattr(file, "LIMIT", limit)
    out = tmp_path / "one.html"
    size, detail = share(furnished(tmp_path / "run", _large()), out, page)
    assert size <= limit
    contents, arrays = unpacked(out)
    assert detail.rate == rate
    for words in left:
        assert any(words in one for one in contents["notes"])
    assert rate == 10.0 or f"kept {rate:g} times a second" in " ".join(contents["notes"])
    there = arrays["0.there"] == 1
    places = 1.0 + arrays["time"] / 1000
    assert np.abs(arrays["0.x"] / 1000 - places)[there].max() < 1e-3
    assert arrays["time"][-1] == 25_000
    if contents["scenery"] and left[1:]:
        box = np.frombuffer(
            base64.b64decode(contents["scenery"]["meshes"]["m:1"]["vertices"]), "<f4"
        )
        assert box.shape == (24,)
        assert box.max() == pytest.approx(2.0, abs=0.01)


def test_sixteen_robots_for_twenty_minutes_fit() -> None:
    """The longest usual run stays below 5 MB with all of its rows: an eighth of it, 2.5 minutes
    of trembling ways that nothing foretells, takes an eighth of the room."""
    story, noise = Story(), np.random.default_rng(1)
    rows, robots = 1500, 16
    turns = np.cumsum(noise.normal(0, 0.05, (rows, robots)), axis=0)
    x = np.cumsum(0.05 * np.cos(turns) + noise.normal(0, 5e-4, turns.shape), axis=0)
    y = np.cumsum(0.05 * np.sin(turns) + noise.normal(0, 5e-4, turns.shape), axis=0)
    for row in range(rows):
        story.times.append(0.1 * row)
        for one in range(robots):
            half = turns[row, one] / 2
            pose = (x[row, one], y[row, one], 0.17, math.cos(half), 0.0, 0.0, math.sin(half))
            story.robot(f"R{one}").poses.append((row, pose))
    result = {
        "ended": {"began": 0.0, "why": "time"}, "victims": [], "values": {}, "total": 0.0,
        "rules": "none",
    }  # fmt: skip
    shown = Shown(Mission(), World(), story, result, None, (), False)
    assert len(shown.packed(LEVELS[0])) * 4 / 3 < (LIMIT - 700_000) / 8


def test_a_run_that_broke_off_is_shown(page: Path, tmp_path: Path) -> None:
    """Without score.json, with a last line that is cut off: what is there, and what is not."""
    run = furnished(tmp_path / "run")
    (run / "score.json").unlink()
    log = run / "truth.jsonl"
    log.write_bytes(log.read_bytes()[:-40])
    out = tmp_path / "one.html"
    share(run, out, page)
    contents, arrays = unpacked(out)
    assert len(arrays["time"]) == 249
    notes = " ".join(contents["notes"])
    assert "truth.jsonl ends within a line" in notes
    assert "broken off" in notes
    assert contents["total"] > 0


@pytest.mark.parametrize(
    ("broken", "why"),
    [
        ("events.jsonl", "is no run"),
        ("truth.jsonl", "has no truth"),
        ("world.json", "is not valid JSON"),
        ("score.json", "is no result"),
        ("scene.json.gz", "is no scenery of a run"),
    ],
)
def test_broken_runs_are_refused(page: Path, tmp_path: Path, broken: str, why: str) -> None:
    """One line that names the file and a cure, and no file that looks like a run."""
    run = furnished(tmp_path / "run")
    if broken.endswith("jsonl"):
        (run / broken).unlink()
    else:
        (run / broken).write_bytes(b"{ broken")
    out = tmp_path / "one.html"
    with pytest.raises(MissionError, match=why) as found:
        share(run, out, page)
    assert str(run) in str(found.value)
    assert not out.exists()


def test_the_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["share", str(tmp_path / "nowhere")]) == 2
    told = capsys.readouterr().err.strip()
    assert len(told.splitlines()) == 1
    assert "nowhere" in told
    assert "is no run" in told or "build the page" in told


ODD = st.builds(
    lambda kind, facts: {**facts, "kind": kind},
    st.sampled_from((*KINDS, "input", "select", "found", "inject", "zone", "collision", "connect")),
    st.dictionaries(st.sampled_from((*KEYS, "page", "total", "victim")), ANY, max_size=6),
)


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.floats(0.0, 3.0), GOOD | ODD), min_size=1, max_size=12))
def test_any_log_is_packed_or_refused(steps: list[tuple[float, dict[str, Any]]]) -> None:
    """What a log can hold is packed and read again, row for row; the rest is damage."""
    story, time, taken = Story(), 0.0, 0
    story.take({"kind": "truth", "t_sim": 0.0, "robots": []})
    for gap, facts in steps:
        time += gap
        try:
            story.take({**facts, "t_sim": time})
        except file.DAMAGED:
            return
        taken += facts["kind"] == "truth"
    result = {"ended": {"began": None, "why": None}, "victims": [], "values": {}, "total": 0.0}
    shown = Shown(Mission(), ROOMS, story, {**result, "rules": ""}, None, (), False)
    for detail in (LEVELS[0], LEVELS[-1]):
        contents, arrays = read_packed(shown.packed(detail))
        assert len(arrays["time"]) == taken + 1 or detail.rate < 10.0
        assert arrays["time"][-1] == pytest.approx(1000 * story.times[-1], abs=0.6)
        assert len(contents["robots"]) == len(story.robots)
