"""Makes up a study that nobody took part in, with an effect that is known.

Every participant has an ability, every trial its noise, and the second condition an effect in
standard deviations of the differences between conditions. What is made up are logs, in the files
of a real study, so that everything behind them (measures, tables, statistics, report) is tried on
them; with effect 0 nothing may be found.
"""

from __future__ import annotations

import json
import random
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usarsim_server.base.files import write_text
from usarsim_study.folder import FORMS, StudyFolder, append_form
from usarsim_study.forms import FormState
from usarsim_study.instruments import nasa_tlx
from usarsim_study.study_file import FILE

LENGTH = 600.0
"""s of a trial."""
VICTIMS = 20
SPREAD = 2.0
"""Standard deviation of the difference in victims between two trials of a participant."""
DAY = "2026-01-15"

STUDY = """\
title = "Keyboard or gamepad, made up"
seed = {seed}
participants = {participants}
primary = "victims_found"
secondary = ["tlx_raw", "collisions", "marks_wrong", "display_to_mark", "switches", "distance"]

[[condition]]
name = "keyboard"
label = "Keyboard"
device = "keyboard"

[[condition]]
name = "gamepad"
label = "Gamepad"
device = "gamepad"

[[layout]]
name = "A"
mission = "office-a.toml"

[[layout]]
name = "B"
mission = "office-b.toml"

[[form]]
name = "workload"
kind = "nasa-tlx"
when = "after_trial"

[[form]]
name = "which"
kind = "preference"
when = "after"
"""


@dataclass(frozen=True, slots=True)
class Plan:
    """What is made up.

    Attributes:
        participants: a multiple of four.
        effect: of the last condition, in standard deviations (dz); half of it shows in workload
            and collisions.
        learning: victims more in each further trial.
        aborted: trials of so many participants are cut off.
        excluded: so many participants do not pass the training.
        skipped: so many leave an item of the workload form out.
        seed: of everything that is drawn.
    """

    participants: int = 16
    effect: float = 0.0
    learning: float = 0.5
    aborted: int = 0
    excluded: int = 0
    skipped: int = 0
    seed: int = 1


class _Log:
    """Records, numbered when they are written."""

    def __init__(self) -> None:
        self._rows: list[dict[str, Any]] = []

    def say(self, time: float, kind: str, **fields: Any) -> None:
        wall = round(time, 3)
        self._rows.append({"t_sim": wall, "t_wall": wall, "kind": kind, **fields})

    def write(self, path: Path, kinds: Mapping[str, bool]) -> None:
        """Two files: kinds that are truth, and the others."""
        self._rows.sort(key=lambda row: float(row["t_sim"]))
        lines: dict[bool, list[str]] = {False: [], True: []}
        for seq, row in enumerate(self._rows):
            lines[kinds.get(row["kind"], False)].append(json.dumps({"seq": seq, **row}))
        write_text(path / "events.jsonl", "\n".join(lines[False]) + "\n")
        write_text(path / "truth.jsonl", "\n".join(lines[True]) + "\n")


def make_study(path: Path, plan: Plan, text: str = STUDY) -> StudyFolder:
    """Make up a whole study in a new folder.

    Args:
        path: the folder; it may exist, but hold no study.
        plan: how many and which effect.
        text: of the study file.
    """
    path.mkdir(parents=True, exist_ok=True)
    write_text(path / FILE, text.format(seed=plan.seed, participants=plan.participants))
    folder = StudyFolder(path)
    folder.begin()
    for place in range(plan.participants):
        _participant(folder, plan, place)
    return folder


def _participant(folder: StudyFolder, plan: Plan, place: int) -> None:
    study = folder.study
    chance = random.Random(f"{plan.seed}/{place}")
    one = folder.admit(DAY)
    ability = chance.gauss(0.0, 2.0)
    conditions = [condition.name for condition in study.condition]
    if place >= plan.participants - plan.excluded:
        text = "did not pass the training"
        folder.store(type(one)(one.code, one.number, one.day, "excluded", text))
        return
    for trial, cell in enumerate(folder.orders[one.number], start=1):
        run = folder.new_trial(one.code, trial)
        step = conditions.index(cell.condition) / max(1, len(conditions) - 1)
        skill = ability + plan.effect * SPREAD * step + plan.learning * (trial - 1)
        cut = place < plan.aborted and trial == len(folder.orders[one.number])
        skip = plan.aborted <= place < plan.aborted + plan.skipped and trial == 1
        _trial(run, chance, skill, plan.effect * step, cut, skip)
        folder.close_trial(run, "aborted" if cut else "complete", "pad lost" if cut else "")
    if study.form_named("which") is not None:
        liked = plan.effect * 0.6 + chance.gauss(0.0, 1.0) > 0.0
        state = FormState(next(form for form in study.forms("after") if form.name == "which"))
        state.answer("preferred", conditions[-1] if liked else conditions[0], 4.0)
        state.answer("strength", chance.randint(1, 5), 6.5)
        state.hand_in()
        append_form(folder.place(one.code) / FORMS, [state.as_json()])
    folder.store(type(one)(one.code, one.number, one.day, "complete"))


def _trial(
    run: Path, chance: random.Random, skill: float, effect: float, cut: bool, skip: bool
) -> None:
    """The log of one trial: two robots, chosen and driven in turn, victims marked on the way."""
    log = _Log()
    robots = [{"name": name, "class": "P3AT"} for name in ("R1", "R2")]
    log.say(0.0, "session", mission="made-up", seed=0, robots=robots, operators=1)
    log.say(0.0, "connect", page=1, role="operator", name="operator", on=True)
    log.say(0.0, "trial_start", limit=LENGTH)
    time, robot = 1.0, 0
    driven: list[tuple[str, float, float]] = []
    while time < LENGTH - 40.0:
        name = f"R{robot % 2 + 1}"
        log.say(time, "select", page=1, robot=name)
        begin = time + chance.uniform(0.5, 2.5)
        end = begin + chance.uniform(10.0, 35.0)
        log.say(begin, "command", robot=name, source="operator", left=0.6, right=0.6)
        log.say(end, "command", robot=name, source="operator", left=0.0, right=0.0)
        driven.append((name, begin, end))
        time, robot = end + chance.uniform(0.0, 3.0), robot + 1
    count = round(10.0 + skill + chance.gauss(0.0, SPREAD / 2**0.5))
    for victim in range(min(max(count, 0), VICTIMS)):
        at = chance.uniform(10.0, LENGTH - 5.0)
        name, mark = f"V{victim + 1}", victim + 1
        log.say(at, "mark_set", mark=mark, robot="R1", place=[0, 0, 0], by="operator", page=1)
        log.say(at, "found", victim=name, robot="R1", how="mark", mark=mark)
        credited = chance.random() < 0.9
        log.say(at, "credit", victim=name, robot="R1", credited=credited, why="")
        _display(log, name, at - chance.uniform(3.0, 6.0), at + 1.0)
    for number in range(max(0, round(chance.gauss(2.0, 1.0)))):
        log.say(chance.uniform(10.0, LENGTH), "wrong", mark=100 + number)
    for _ in range(max(0, round(chance.gauss(9.0 - 1.5 * effect, 3.0)))):
        where = {"with": "world", "name": "wall"}
        log.say(chance.uniform(5.0, LENGTH), "collision", robot="R1", **where)
    _ways(log, driven)
    log.say(LENGTH, "score", total=float(count), values={"A": 0.5, "M": 0.5})
    if not cut:
        log.say(LENGTH, "trial_end", why="time", text="")
    state = FormState(nasa_tlx("workload"))
    for item in state.form.items:
        load = 50.0 - 6.0 * effect + chance.gauss(0.0, 12.0)
        state.answer(item.name, 5 * round(min(max(load, 0.0), 100.0) / 5.0), 3.0)
    if skip:
        state.answer("effort", None, 0.0)
    log.say(LENGTH + 5.0, "form", **state.as_json())
    log.write(run, {"truth": True})


def _display(log: _Log, victim: str, begin: float, end: float) -> None:
    seen = {"robot": "R1", "victim": victim, "angle": 0.2, "distance": 4.0, "clear": True}
    log.say(begin, "truth", robots=[], victims=[], views=[seen])
    log.say(end, "truth", robots=[], victims=[], views=[])


def _ways(log: _Log, driven: list[tuple[str, float, float]]) -> None:
    """Rows of truth at the ends of every way, at 0.4 m/s."""
    places = {"R1": 0.0, "R2": 0.0}
    for name, begin, end in driven:
        for time, speed in ((begin, 0.4), (end, 0.0)):
            places[name] += 0.4 * (end - begin) if speed == 0.0 else 0.0
            row = {"name": name, "pos": [places[name], 0.0, 0.2], "linear": [speed, 0.0, 0.0]}
            log.say(time, "truth", robots=[row], victims=[])
