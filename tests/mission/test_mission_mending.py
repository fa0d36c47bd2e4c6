"""Runs that were cut off are closed and lose nothing; long runs take little room (HRI-20)."""

from __future__ import annotations

import json
import math
import random
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from scripted import rules
from whole_run import begin, play

from usarsim_mission.errors import RunLogError
from usarsim_mission.live import LiveRun
from usarsim_mission.mending import CUT, close_run
from usarsim_mission.model import Mission, Start, Victim, World
from usarsim_mission.referee import Referee
from usarsim_mission.rescoring import rescore
from usarsim_mission.runlog import EVENTS, TRUTH, RunFolder, RunWriter
from usarsim_mission.state import STATE, thinned
from usarsim_mission.truth_lines import Packer, Thinner, Unpacker
from usarsim_server.cli import main


def _cut(played: Path, folder: Path, events: int, truth: int) -> Path:
    """The run, with so many bytes of each log, as a kill leaves it."""
    shutil.copytree(played, folder)
    (folder / "score.json").unlink()
    for name, size in ((EVENTS, events), (TRUTH, truth)):
        (folder / name).write_bytes((played / name).read_bytes()[:size])
    return folder


def _before(played: Path, kind: str) -> tuple[int, int]:
    """How much of each log there was when the first line of a kind was written."""
    events, truth = (played / EVENTS).read_bytes(), (played / TRUTH).read_bytes()
    at = events.rindex(b"\n", 0, events.index(kind.encode())) + 1
    number = json.loads(events[at : events.index(b"\n", at)])["seq"]
    rows = [line for line in truth.splitlines(keepends=True) if json.loads(line)["seq"] < number]
    return at, sum(map(len, rows))


def _whole_lines(folder: Path) -> list[str]:
    names = (EVENTS, TRUTH, CUT)
    texts = ((folder / one).read_text() for one in names if (folder / one).exists())
    return sorted(line for text in texts for line in text.splitlines(keepends=True))


def test_a_run_that_was_cut_off_is_closed_with_a_reason(
    played: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """O-47: in the middle of lines, between a record and what follows from it, and where a log
    lacks what the other one goes on from; then it is scored without a difference."""
    size = [(played / name).stat().st_size for name in (EVENTS, TRUTH)]
    cuts = (
        (0.5, 0.5, "aborted"),
        (0.2, 0.9, "aborted"),
        (1.0, 0.98, "aborted"),
        (0.999, 1.0, "operator"),  # in the score that follows from the end
        (0.0, 0.0, "aborted"),  # between a second and the score that follows from it
    )
    for number, (events, truth, why) in enumerate(cuts):
        cut = round(events * size[0]), round(truth * size[1])
        if not events:
            cut = _before(played, '"kind":"score"')
        folder = _cut(played, tmp_path / str(number), *cut)
        before = [line for line in _whole_lines(folder) if line.endswith("\n")]
        if not events:
            assert main(["mission", "score", str(folder)]) == 0
        assert main(["mission", "score", str(folder), "--write"]) == 0
        found = rescore(folder)
        assert (found.differences, found.damage, found.live) == ([], [], found.result)
        assert found.result["ended"]["why"] == why
        records = list(RunFolder(folder).records())
        assert [one["seq"] for one in records] == list(range(len(records)))
        (end,) = [one for one in records if one["kind"] == "trial_end"]
        assert end["text"] == ("the run was cut off" if why == "aborted" else "")
        after = _whole_lines(folder)
        assert set(before) <= set(after)
        assert (folder / "state.csv").read_text().count("\n") > 10
        again = [(folder / name).read_bytes() for name in (EVENTS, TRUTH, "score.json")]
        assert close_run(folder) == found.result  # once more changes nothing
        assert [(folder / name).read_bytes() for name in (EVENTS, TRUTH, "score.json")] == again
    capsys.readouterr()


def test_a_run_that_goes_on_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nobody closes what is being written; what comes later has the next number."""
    run = begin(tmp_path / "run")
    run.tell("session", 0.0, robots=[])
    assert main(["mission", "score", str(tmp_path / "run"), "--write"]) == 2
    assert "is being written (wait for the end of the run)" in capsys.readouterr().err
    play(run)
    run.close()
    last = list(RunFolder(tmp_path / "run").records())[-1]
    log = RunWriter.reopen(tmp_path / "run", last)
    form = log.write({"kind": "form", "t_sim": 26.0, "answers": {"mental": 55}})
    log.close()
    assert form["seq"] == last["seq"] + 1
    assert form["t_wall"] >= last["t_wall"]
    assert list(RunFolder(tmp_path / "run").records())[-1] == form


def test_nothing_whole_cannot_be_closed(played: Path, tmp_path: Path) -> None:
    folder = _cut(played, tmp_path / "run", 20, 0)
    with pytest.raises(RunLogError, match="has no whole record"):
        close_run(folder)


def test_rows_stand_in_a_log_without_what_can_be_told_again() -> None:
    """What is read is what was told, whatever it was; only what no rule counts is gone."""

    def view(robot: str, victim: str, angle: float, clear: bool = True) -> dict[str, Any]:
        return {"robot": robot, "victim": victim, "angle": angle, "distance": 3.0, "clear": clear}

    def robot(name: str, *touched: str) -> dict[str, Any]:
        contacts = [{"with": "world", "name": one, "time": 1.0} for one in touched]
        places = {key: [1.0, 2.0, 0.1] for key in ("pos", "linear", "angular")}
        quat = [1.0, 0.0, 0.0, 0.0]
        return {"name": name, **places, "quat": quat, "battery": None, "contacts": contacts}

    victims = [{"name": "A", "pos": [1.0, 2.0, 0.1]}]
    seen = [view("R1", "A", 0.1), view("R2", "A", 0.5), view("R2", "B", 0.7, clear=False)]
    rows: list[dict[str, Any]] = [
        {"robots": [robot("R1", "wall"), robot("R2")], "victims": victims, "views": seen},
        {"robots": [robot("R1"), {"name": "R2"}], "victims": victims, "views": []},
        {"robots": [robot("R1"), robot("R1")], "victims": [], "views": [*seen, seen[0]]},
        {"robots": None, "victims": victims, "views": [seen[0], seen[1], view("R1", "B", 0.2)]},
        {"robots": [3], "victims": victims, "views": [{"robot": "R1"}]},
        {"robots": [{**robot("R1"), "name": 3}], "victims": victims},
    ]
    packer, unpacker = Packer(), Unpacker()
    packed = [json.loads(json.dumps(packer.pack(row))) for row in rows]
    assert packed[0]["views"] == {
        "R1": {"A": [0.1, 3.0]},
        "R2": {"A": [0.5, 3.0], "B": [0.7, 3.0, False]},
    }
    assert [len(one) for one in packed[0]["robots"].values()] == [6, 5]
    assert ["victims" in one for one in packed] == [True, False, True, True, False, False]
    assert [unpacker.unpack(one) for one in packed] == rows
    for hidden, half_angle in ((False, 20.0), (True, 45.0)):
        using = rules(line_of_sight=not hidden, half_angle=half_angle)
        kept = Thinner(using).thin({"views": seen})["views"]
        assert kept == (seen if hidden else seen[:2])


def _hall(seconds: int) -> Iterator[dict[str, Any]]:
    """16 robots and 20 victims in an open hall, a third of them before each camera; commands."""
    dice = random.Random(3)
    victims = [{"name": f"MaleVictim_{one}", "pos": list(one_of(dice, 3))} for one in range(20)]
    for step in range(1, 10 * seconds + 1):
        time = round(0.1 * step, 6)
        robots, views = [], []
        for robot in range(16):
            name = f"Robot{robot}"
            quat = [*one_of(dice, 1, 1.0), *one_of(dice, 2, 1e-4), *one_of(dice, 1, 1.0)]
            row: dict[str, Any] = {"name": name, "pos": one_of(dice, 3), "quat": quat}
            for key in ("linear", "angular"):
                row[key] = [*one_of(dice, 2, 1.0), *one_of(dice, 1, 1e-3)]
            robots.append({**row, "battery": round(dice.random(), 6), "contacts": []})
            for number, victim in enumerate(victims):
                turned = 1.3 * robot + 0.7 * number + 0.02 * step
                angle = abs(math.remainder(turned, math.tau))
                if angle <= math.pi / 3.0:
                    seen = {"angle": round(angle, 6), "distance": round(dice.random() + 9.0, 6)}
                    views.append({"robot": name, "victim": victim["name"], **seen, "clear": True})
            text = f"DRIVE {{Left {dice.random():.4f}}} {{Right {dice.random():.4f}}}"
            told = {"robot": name, "source": "autonomy", "text": text}
            yield {"t_sim": time, "kind": "command", **told}
        state = f"{dice.getrandbits(128):032x}"
        facts = {"state": state, "robots": robots, "victims": victims, "views": views}
        yield {"t_sim": time, "kind": "truth", **facts}


def one_of(dice: random.Random, count: int, size: float = 20.0) -> list[float]:
    """So many numbers as rows have them."""
    return [round(dice.uniform(-size, size), 6) for _ in range(count)]


def test_logs_of_sixteen_robots_are_small_and_credit_the_same(tmp_path: Path) -> None:
    """HRI-20: 20 minutes of 16 robots and 20 victims take less than 100 MB where everybody sees
    everybody; the referee says the same to what is logged as to what was told."""
    seconds = 20
    people = tuple(Victim(f"MaleVictim_{one}", (0.0, 0.0, 0.0)) for one in range(20))
    world, mission = World("hall", victims=people), Mission("hall", 1, seconds + 1.0)
    using = rules(credit="view", dwell=1.0)
    run = LiveRun(RunWriter(tmp_path, "", mission, using, world), Referee(mission, using, world))
    plain, kinds = Referee(mission, using, world), Counter[str]()
    start = {"t_sim": 0.0, "kind": "trial_start", "limit": seconds + 1.0}
    for record in (start, *_hall(seconds)):
        then = [json.loads(json.dumps(one)) for one in plain.feed(record)]
        facts = {key: value for key, value in record.items() if key not in ("kind", "t_sim")}
        _, *now = run.tell(record["kind"], record["t_sim"], **facts)
        assert [
            {key: one[key] for key in one if key not in ("seq", "t_wall")} for one in now
        ] == then
        kinds.update(one["kind"] for one in then)
    run.close()
    assert kinds["found"] == 20
    assert kinds["victim_visible_end"] > 10
    sizes = [(tmp_path / name).stat().st_size * 1200 / seconds / 1e6 for name in (EVENTS, TRUTH)]
    rows = (tmp_path / STATE).read_bytes().splitlines(keepends=True)
    assert len(rows) == 1 + 16 * 10 * seconds  # a short one is not thinned
    every = thinned(12_000, 16)
    sizes.append(sum(map(len, rows)) * 1200 / seconds / every / 1e6)
    assert sum(sizes) < 99.0, sizes


def test_states_of_a_long_run_are_thinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """HRI-20: beyond so many rows every second instant stands in `state.csv`, the first one too,
    each with all robots; four robots for 20 minutes are not thinned."""
    assert [thinned(12_000, robots) for robots in (0, 4, 8, 16, 64)] == [1, 1, 1, 2, 8]
    monkeypatch.setattr("usarsim_mission.state.MOST", 160)
    world, mission = (
        World("hall", starts=tuple(Start(f"Robot{n}") for n in range(16))),
        Mission("hall", 1, 9.0),
    )
    run = LiveRun(
        RunWriter(tmp_path, "", mission, rules(), world), Referee(mission, rules(), world)
    )
    run.tell("trial_start", 0.0, limit=9.0)
    for record in _hall(2):
        run.tell(**record)
    run.close()
    lines = (tmp_path / STATE).read_text().splitlines()[1:]
    times = [line.partition(",")[0] for line in lines[::16]]
    assert times == [f"{0.1 + 0.2 * n:.1f}" for n in range(10)]
    assert len(lines) == 160
