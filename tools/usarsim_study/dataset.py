"""All numbers of a study in four tables of plain rows, as they are exported and judged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from usarsim_study.assignment import Cell, Order
from usarsim_study.folder import Participant, StudyFolder, TrialFolder, values_of
from usarsim_study.measures import MEASURES, Value
from usarsim_study.measures.answers import latest_forms
from usarsim_study.misread import in_columns
from usarsim_study.session.steps import codes
from usarsim_study.study_file import Study
from usarsim_study.trial import Record


@dataclass(frozen=True, slots=True)
class ParticipantRow:
    """One participant; status other than `complete` needs a reason. scripted: 1: made by code."""

    participant: str
    number: int
    sequence: int
    day: str
    status: str
    reason: str
    scripted: int = 0


@dataclass(frozen=True, slots=True)
class TrialRow:
    """One trial that was planned; of several attempts the last.

    Attributes:
        values: the team's by measure. scripted: of the participant.
        inferred_stops: see `Trial.inferred_stops`; None: there is no log, or nobody knows.
    """

    participant: str
    trial: int
    attempt: int
    condition: str
    layout: str
    status: str
    reason: str
    values: dict[str, float | None]
    scripted: int = 0
    inferred_stops: float | None = None


@dataclass(frozen=True, slots=True)
class PartRow:
    """A value of one operator or robot in a trial."""

    participant: str
    trial: int
    level: str
    who: str
    measure: str
    value: float | None


@dataclass(frozen=True, slots=True)
class AnswerRow:
    """An answer to an item. trial: 0 stands for before and after. time: s since it was shown."""

    participant: str
    trial: int
    form: str
    form_kind: str
    item: str
    answer: str
    number: float | None
    time: float | None


@dataclass(frozen=True, slots=True)
class Dataset:
    """A study in numbers. about: title, design, outcomes, conditions, as JSON."""

    about: dict[str, Any]
    participants: tuple[ParticipantRow, ...]
    trials: tuple[TrialRow, ...]
    parts: tuple[PartRow, ...]
    answers: tuple[AnswerRow, ...]


def misread_words(dataset: Dataset) -> dict[str, tuple[str, ...]]:
    """By column the words that pandas and R read as missing values."""
    return in_columns(
        {
            "participant": [one.participant for one in dataset.participants],
            "condition": [one.condition for one in dataset.trials],
            "layout": [one.layout for one in dataset.trials],
            "reason": [
                *(one.reason for one in dataset.participants),
                *(one.reason for one in dataset.trials),
            ],
            "who": [one.who for one in dataset.parts],
            "form": [one.form for one in dataset.answers],
            "item": [one.item for one in dataset.answers],
            "answer": [one.answer for one in dataset.answers],
        }
    )


def collect(folder: StudyFolder) -> Dataset:
    """Read a study folder.

    Raises:
        StudyError: a file is damaged.
    """
    people, trials, parts, answers = [], [], [], []
    for one in folder.participants():
        order = folder.orders[one.number]
        index = folder.study.orders.index(order) + 1 if order in folder.study.orders else 0
        told = (one.code, one.number, index, one.day, one.status, one.reason, int(one.scripted))
        people.append(ParticipantRow(*told))
        answers += _unblinded(_answers(one.code, 0, folder.forms(one.code)), folder.study, order)
        attempts = {attempt.trial: attempt for attempt in folder.attempts(one.code)}
        for number, cell in enumerate(order, start=1):
            row, values, forms = _trial(one, number, cell, attempts.get(number))
            trials.append(row)
            parts += _parts(one.code, number, values)
            answers += _answers(one.code, number, forms)
    return Dataset(about(folder), tuple(people), tuple(trials), tuple(parts), tuple(answers))


def about(folder: StudyFolder) -> dict[str, Any]:
    """What tables need to be judged without the study file."""
    study = folder.study
    return {
        "title": study.title,
        "design": study.design,
        "alpha": study.alpha,
        "planned": study.participants,
        "primary": study.primary,
        "secondary": list(study.secondary),
        "conditions": [{"name": one.name, "title": one.title} for one in study.condition],
        "allocation": study.allocation.digest,
    }


def _trial(
    one: Participant, number: int, cell: Cell, attempt: TrialFolder | None
) -> tuple[TrialRow, list[Value], list[Record]]:
    values: list[Value] = []
    forms: list[Record] = []
    count, status, reason, inferred = 0, "missing", one.reason, None
    if attempt is not None:
        count, status, reason = attempt.attempt, attempt.status, attempt.reason
        if status == "running":
            status, reason = "aborted", reason or "cut off"
        if status == "complete":
            values, forms, inferred = values_of(attempt.path)
    team: dict[str, float | None] = dict.fromkeys(MEASURES)
    team |= {value.measure: value.value for value in values if value.level == "team"}
    told = (one.code, number, count, cell.condition, cell.layout, status, reason, team)
    row = TrialRow(*told, int(one.scripted), inferred)
    return row, values, forms


def _parts(code: str, trial: int, values: list[Value]) -> list[PartRow]:
    """Operators are numbered: what they call themselves stays in the log."""
    operators = list(dict.fromkeys(one.who for one in values if one.level == "operator"))
    return [
        PartRow(
            code,
            trial,
            one.level,
            f"operator {operators.index(one.who) + 1}" if one.level == "operator" else one.who,
            one.measure,
            one.value,
        )
        for one in values
        if one.level != "team"
    ]


def _unblinded(rows: list[AnswerRow], study: Study, order: Order) -> list[AnswerRow]:
    """With the names of conditions where a blind study had called them by when they came."""
    words = codes(study, order)
    meant = {word: one.name for word, one in zip(words, study.condition, strict=False)}
    return [
        replace(one, answer=meant.get(one.answer, one.answer))
        if (one.form_kind, one.item) == ("preference", "preferred")
        else one
        for one in rows
    ]


def _answers(code: str, trial: int, records: list[Record]) -> list[AnswerRow]:
    """What was answered, without what was typed: that never leaves the machine."""
    found = []
    for name, form in latest_forms(records).items():
        times = form.get("times", {})
        typed = set(form.get("typed", ()))
        for item, value in form.get("answers", {}).items():
            if item in typed:
                continue
            number = None if isinstance(value, bool | str) else float(value)
            text = str(value).lower() if isinstance(value, bool) else str(value)
            time = times.get(item)
            found.append(
                AnswerRow(
                    code,
                    trial,
                    name,
                    str(form.get("form_kind", "")),
                    item,
                    text if number is None else f"{number:g}",
                    number,
                    None if time is None else float(time),
                )
            )
    return found
