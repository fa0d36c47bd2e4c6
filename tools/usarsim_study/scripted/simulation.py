"""A study before its first participant: what synthetic ones would do, and what that would tell.

Each participant of a pool goes through the steps of a session and drives all trials, without a
server (`trials.py`). Power is the share of studies, drawn from the pool participant by participant,
in which the test of the primary measure rejects. Without a planted advantage conditions of each
drawn participant are exchanged at random, so the hypothesis of no difference is exactly true.
"""

from __future__ import annotations

import multiprocessing
import random
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from statistics import fmean

from usarsim_mission.scenario.reader import read_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_report.statistics import (
    differences,
    paired,
    rank_sum,
    rejects,
    several_paired,
    several_unpaired,
    signed_rank,
)
from usarsim_server.base.launch import safe_pool
from usarsim_study.assignment import Cell, Order
from usarsim_study.forms import FormState
from usarsim_study.layouts import mission_file
from usarsim_study.scripted.answers import Feeling, answer
from usarsim_study.scripted.skill import Device, careful, drawn
from usarsim_study.scripted.trials import Ground, ground, run_trial, values_of_trial
from usarsim_study.session.steps import Attempt, Past, next_step
from usarsim_study.study_file import Study, read_study

MOST_STEPS = 500
EXTREME = 0.25
"""Share of trials at the end of what can be found from which on a study tells too little."""
UNEQUAL = 0.25
"""Layouts may differ by this share of the mean of the primary measure."""
_PER_ITEM = 4.0  # s that an answer takes
_READS = 20.0  # s that a text takes


@dataclass(frozen=True, slots=True)
class Driven:
    """A trial that was driven. values: the team's measures; victims: that there are."""

    participant: int
    trial: int
    condition: str
    layout: str
    victims: int
    values: Mapping[str, float | None]


@dataclass(frozen=True, slots=True)
class Plan:
    """What is simulated.

    Attributes:
        file: of the study. advantage: of the gamepad. seconds: longest a trial may be; None: as
            its mission says.
    """

    file: Path
    advantage: float
    seconds: float | None = None


@lru_cache(maxsize=1)
def _study(file: Path) -> Study:
    return read_study(file)


@lru_cache(maxsize=16)
def _ground(file: Path, name: str, seed: int | None, robots: int | None, alone: str) -> Ground:
    from usarsim_mission.match.conditions import Conditions

    staged = stage(read_scenario(mission_file(name, file.parent)), seed=seed)
    return ground(Conditions(Path(), robots=robots).applied(staged), alone)


def _place(plan: Plan, study: Study, cell: Cell) -> Ground:
    condition = study.condition_named(cell.condition)
    return _ground(plan.file, *study.mission_of(cell), condition.robots, condition.unattended)


def _device(study: Study, cell: Cell) -> Device:
    return "gamepad" if study.condition_named(cell.condition).device == "gamepad" else "keyboard"


def drive(job: tuple[Plan, int]) -> list[Driven]:
    """All trials of one participant of the pool, by number from 1."""
    plan, number = job
    study = _study(plan.file)
    skill, found = drawn(study.seed, number, plan.advantage), []
    for trial, cell in enumerate(study.allocation.order(number), start=1):
        place = _place(plan, study, cell)
        seed = random.Random(f"{study.seed}/{number}/{trial}").getrandbits(32)
        records = run_trial(place, skill, _device(study, cell), seed, plan.seconds)
        values = values_of_trial(records)
        victims = len(place.world.victims)
        found.append(Driven(number, trial, cell.condition, cell.layout, victims, values))
    return found


def drive_all(plan: Plan, participants: int, jobs: int) -> list[Driven]:
    """The trials of so many participants, some at a time."""
    work = [(plan, number) for number in range(1, participants + 1)]
    if jobs == 1:
        return [one for job in work for one in drive(job)]
    with safe_pool(), multiprocessing.get_context("spawn").Pool(jobs) as pool:
        return [one for rows in pool.imap(drive, work) for one in rows]


# -- power ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Power:
    """Of the test of the primary measure.

    Attributes:
        share: of the drawn studies that reject. dz: of the pool, of the last condition less the
            first; None: it has no spread, or there is more to compare.
    """

    share: float
    dz: float | None


def power(
    study: Study, pool: Sequence[Driven], n: int, repeats: int, seed: int, *, exchange: bool
) -> Power:
    """How often a study of n participants drawn from a pool would find a difference.

    Args:
        study: which. pool: driven trials. n: participants of a study. repeats: studies.
        seed: of the draws. exchange: conditions of each one drawn are exchanged at random.
    """
    names = [one.name for one in study.condition]
    chance, rejected = random.Random(seed), 0
    if study.design == "between":
        groups: dict[str, list[float]] = defaultdict(list)
        for one in pool:
            groups[one.condition].append(one.values[study.primary] or 0.0)
        everybody = [value for rows in groups.values() for value in rows]
        for _ in range(repeats):
            rows = [
                chance.choices(everybody if exchange else groups[name], k=n // len(names))
                for name in names
            ]
            rejected += _rejects(rows, study.alpha, within=False)
        return Power(rejected / repeats, None)
    table: dict[int, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for one in pool:
        if (value := one.values.get(study.primary)) is not None:
            table[one.participant][one.condition].append(value)
    lines = [
        [fmean(row[name]) for name in names] for row in table.values() if len(row) == len(names)
    ]
    for _ in range(repeats):
        drawn_lines = [list(line) for line in chance.choices(lines, k=n)]
        for line in drawn_lines if exchange else ():
            chance.shuffle(line)
        columns = [list(column) for column in zip(*drawn_lines, strict=True)]
        rejected += _rejects(columns, study.alpha, within=True)
    found = paired(*zip(*lines, strict=True)) if len(names) == 2 and lines else None
    return Power(rejected / repeats, None if found is None else found.dz)


def _rejects(columns: list[list[float]], alpha: float, *, within: bool) -> bool:
    if len(columns) == 2 and within:
        return rejects(signed_rank(differences(*columns))[2], alpha)
    if len(columns) == 2:
        return rejects(rank_sum(*columns)[1], alpha)
    if within:
        found = several_paired([list(row) for row in zip(*columns, strict=True)])
    else:
        found = several_unpaired(columns)
    return found is not None and rejects(found.p, alpha)


# -- faults of the protocol -----------------------------------------------------------------------


def faults(plan: Plan, study: Study, pool: Sequence[Driven]) -> Iterator[str]:
    """What would go wrong, in words for who wrote the study."""
    for order in study.orders:
        yield from _walk(study, order)
    shortest = min((one.values.get("trial_time") or 0.0 for one in pool), default=0.0)
    for number, probe in enumerate(study.probe, start=1):
        if probe.at >= shortest:
            yield f"probe {number}: at {probe.at:g} s a trial of {shortest:g} s is over"
    missing = sum(one.values.get(study.primary) is None for one in pool)
    if missing:
        yield f"{study.primary} is missing in {missing} of {len(pool)} trials"
    if study.primary in ("victims_found", "victims_credited", "marks_valid"):
        values = [(one.values.get(study.primary), one.victims) for one in pool]
        none = sum(value == 0.0 for value, _ in values) / max(1, len(values))
        most = sum(value == victims for value, victims in values) / max(1, len(values))
        if none >= EXTREME:
            yield f"nobody is found in {100 * none:.0f} % of the trials: give them more time"
        if most >= EXTREME:
            yield f"everybody is found in {100 * most:.0f} % of the trials: give them less time"
    yield from _layouts(study, pool)
    yield from _training(plan, study)


def _walk(study: Study, order: Order) -> Iterator[str]:
    """Go through a session on paper: every form can be filled in, and there is an end."""
    past, feeling = Past(), Feeling(random.Random(1))
    forms: dict[tuple[int, str, int], FormState] = {}
    runs: dict[str, list[Attempt]] = {"trial": [], "training": []}
    passed: set[tuple[str, int]] = set()
    for _ in range(MOST_STEPS):
        step = next_step(study, order, past)
        if step.kind == "end":
            return
        task = step.task
        if task is None or step.kind == "wait":
            return  # for the other operator, who does the same
        if step.kind == "form" and step.state is not None and step.form is not None:
            for page in step.form.description()["pages"]:
                for item in page:
                    if (value := answer(item, feeling)) is not None:
                        step.state.answer(item["name"], value, _PER_ITEM)
            step.state.hand_in()
            forms[task.number, task.form, 1] = step.state
        elif step.kind in ("ready", "panel"):
            row = Attempt(task.number, 1, "complete" if task.kind == "trial" else "passed")
            runs[task.kind].append(row)
        else:
            passed.add((task.key, 1))
        past = Past(
            passed=frozenset(passed),
            forms=dict(forms),
            trials=tuple(runs["trial"]),
            trainings=tuple(runs["training"]),
        )
    yield f"a session does not come to its end in {MOST_STEPS} steps"


def _layouts(study: Study, pool: Sequence[Driven]) -> Iterator[str]:
    found: dict[str, list[float]] = defaultdict(list)
    for one in pool:
        if (value := one.values.get(study.primary)) is not None:
            found[one.layout].append(value)
    means = {name: fmean(values) for name, values in found.items()}
    if len(means) < 2:
        return
    least, most = min(means, key=means.__getitem__), max(means, key=means.__getitem__)
    middle = fmean(means.values())
    if middle and means[most] - means[least] > UNEQUAL * abs(middle):
        yield (
            f"layouts are unequal: {study.primary} is {means[least]:.2f} in {least} and "
            f"{means[most]:.2f} in {most}"
        )


def _training(plan: Plan, study: Study) -> Iterator[str]:
    """Whether the criterion of the training can be met."""
    training = study.training
    if training is None:
        return
    place = _ground(plan.file, training.mission, None, None, "mission")
    skill = careful(drawn(study.seed, 1, plan.advantage), "keyboard")
    passed = 0
    for attempt in range(training.attempts):
        values = values_of_trial(
            run_trial(place, skill, "keyboard", attempt, plan.seconds, told=True)
        )
        bumps = (values["collisions"] or 0.0) * (values["trial_time"] or 0.0) / 60.0
        touched = bumps + (values["victim_contacts"] or 0.0)
        enough = (values["marks_valid"] or 0.0) >= training.victims
        passed += enough and touched <= training.contacts + 1e-6
    if not passed:
        yield f"the training was not passed in {training.attempts} attempts"


def minutes(plan: Plan, study: Study, pool: Sequence[Driven]) -> float:
    """How long a session takes, without training, about; min."""
    by: dict[int, float] = defaultdict(float)
    for one in pool:
        by[one.participant] += one.values.get("trial_time") or 0.0
    trials = len(study.orders[0])
    asked = sum(
        _READS + _PER_ITEM * len(form.items) * (trials if when == "after_trial" else 1)
        for when in ("before", "after_trial", "after")
        for form in study.forms(when)
    )
    return (fmean(by.values()) + asked) / 60.0
