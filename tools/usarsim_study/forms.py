"""Forms that participants fill in: what is asked, what was answered so far, what it scores.

A `Form` is a fixed description (`description()` gives it to a page as JSON); a `FormState` holds
the answers to one copy of it. Neither reads a file, a clock or a socket: the caller says when an
answer was given, and keeps `state.as_json()` wherever it must survive a reload or a crash.

What was not answered is missing: a score that needs it is None, never 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from usarsim_study.errors import StudyError

ItemKind = Literal["scale", "choice", "text", "flag"]
Value = float | str | bool
"""An answer: a number of a scale, a word of a choice, a text, or yes and no."""

LONGEST_TEXT = 4000
"""Characters of a text that a participant types."""


@dataclass(frozen=True, slots=True)
class Item:
    """One question.

    Attributes:
        name: key of its answer.
        text: what is asked.
        kind: how it is answered.
        low, high, step: of a scale; every answer is low plus a whole number of steps.
        left, right: words at the ends of a scale.
        choices: answers to choose from: name and what is shown.
        required: it must be answered before the next page.
        page: on which it stands, from 1.
    """

    name: str
    text: str
    kind: ItemKind = "scale"
    low: float = 0.0
    high: float = 100.0
    step: float = 1.0
    left: str = ""
    right: str = ""
    choices: tuple[tuple[str, str], ...] = ()
    required: bool = True
    page: int = 1

    def fault(self, value: object) -> str | None:
        """Why a value is no answer; None if it is one."""
        match self.kind:
            case "scale":
                if isinstance(value, bool) or not isinstance(value, int | float):
                    return "is not a number"
                if not self.low <= value <= self.high:  # also refuses NaN
                    return f"is not from {self.low:g} to {self.high:g}"
                steps = (value - self.low) / self.step
                if not math.isclose(steps, round(steps), abs_tol=1e-9):
                    return f"is not a multiple of {self.step:g} above {self.low:g}"
            case "choice":
                names = [name for name, _ in self.choices]
                if value not in names:
                    return f"is none of {', '.join(names)}"
            case "flag":
                if not isinstance(value, bool):
                    return "is neither true nor false"
            case "text":
                if not isinstance(value, str):
                    return "is not a text"
                if len(value) > LONGEST_TEXT:
                    return f"is longer than {LONGEST_TEXT} characters"
                if self.required and not value.strip():
                    return "is empty"
        return None


Scores = dict[str, float | None]
Answers = Mapping[str, Value]


def _no_scores(answers: Answers) -> Scores:
    return {}


@dataclass(frozen=True, slots=True)
class Form:
    """A form.

    Attributes:
        name: under which its answers are kept.
        kind: `nasa-tlx`, `nasa-tlx-weighted`, `sus`, `sart`, `preference` or `questionnaire`.
        title, instructions: shown above the items.
        items: in the order in which they are shown.
        scoring: makes numbers of answers.
        source: of the form, for the report.
    """

    name: str
    kind: str
    title: str
    instructions: str
    items: tuple[Item, ...]
    scoring: Callable[[Answers], Scores] = _no_scores
    source: str = ""

    @property
    def pages(self) -> int:
        """How many there are."""
        return max((item.page for item in self.items), default=1)

    def item(self, name: str) -> Item:
        """An item by its name.

        Raises:
            StudyError: there is none.
        """
        for item in self.items:
            if item.name == name:
                return item
        raise StudyError(f"form {self.name}: has no item {name!r} (ask for description)")

    def description(self) -> dict[str, Any]:
        """What a page needs to show this form, for JSON.

        `{"form", "kind", "title", "instructions", "pages": [[item, ...], ...]}`; an item has
        `name`, `text`, `kind`, `required`, a scale also `low`, `high`, `step`, `left`, `right`, a
        choice `choices`: [{"name", "text"}].
        """
        pages: list[list[dict[str, Any]]] = [[] for _ in range(self.pages)]
        for item in self.items:
            told: dict[str, Any] = {
                "name": item.name,
                "text": item.text,
                "kind": item.kind,
                "required": item.required,
            }
            if item.kind == "scale":
                told |= {"low": item.low, "high": item.high, "step": item.step}
                told |= {"left": item.left, "right": item.right}
            if item.kind == "choice":
                told["choices"] = [{"name": name, "text": text} for name, text in item.choices]
            pages[item.page - 1].append(told)
        return {
            "form": self.name,
            "kind": self.kind,
            "title": self.title,
            "instructions": self.instructions,
            "pages": pages,
        }

    def score(self, answers: Answers) -> Scores:
        """Numbers by name; None where an answer is missing that they need."""
        return self.scoring(answers)


@dataclass(slots=True)
class FormState:
    """One copy of a form, as far as it is filled in.

    Attributes:
        form: what is asked.
        answers: by item.
        times: s since the form was shown at which each was last given.
        done: it was handed in.
    """

    form: Form
    answers: dict[str, Value] = field(default_factory=dict)
    times: dict[str, float] = field(default_factory=dict)
    done: bool = False

    def answer(self, name: str, value: Value | None, time: float) -> None:
        """Give, change or (None) take back an answer.

        Args:
            name: of the item.
            value: the answer.
            time: s since the form was shown.

        Raises:
            StudyError: there is no such item, the value is no answer to it, or the form was handed
                in.
        """
        item = self.form.item(name)
        if self.done:
            raise StudyError(f"form {self.form.name}: was handed in (open a new one)")
        if value is None:
            self.answers.pop(name, None)
            self.times.pop(name, None)
            return
        fault = item.fault(value)
        if fault is not None:
            raise StudyError(f"form {self.form.name}: {name}: {value!r:.60} {fault}")
        self.answers[name] = value
        self.times[name] = time

    def missing(self, page: int | None = None) -> tuple[str, ...]:
        """Required items without an answer, of one page or of all."""
        return tuple(
            item.name
            for item in self.form.items
            if item.required and item.name not in self.answers and page in (None, item.page)
        )

    @property
    def page(self) -> int:
        """The first page with a required item that is not answered; the last one if there is none.

        After a reload the participant goes on there.
        """
        return min(
            (item.page for item in self.form.items if item.name in self.missing()),
            default=self.form.pages,
        )

    def hand_in(self) -> None:
        """Close the form.

        Raises:
            StudyError: a required answer is missing.
        """
        if missing := self.missing():
            raise StudyError(f"form {self.form.name}: not answered: {', '.join(missing)}")
        self.done = True

    def scores(self) -> Scores:
        """See `Form.score`."""
        return self.form.score(self.answers)

    def as_json(self) -> dict[str, Any]:
        """Everything, for a file or the record `form` of a log.

        `typed` names the answers that are free text, which no export may hold.
        """
        return {
            "form": self.form.name,
            "form_kind": self.form.kind,
            "typed": [item.name for item in self.form.items if item.kind == "text"],
            "answers": dict(self.answers),
            "times": dict(self.times),
            "done": self.done,
        }

    @classmethod
    def from_json(cls, form: Form, stored: object) -> FormState:
        """A state that `as_json` told.

        Raises:
            StudyError: it is something else, or of another form.
        """
        state = cls(form)
        if not isinstance(stored, Mapping) or stored.get("form") != form.name:
            raise StudyError(f"form {form.name}: what was stored is no state of it (start it anew)")
        answers, times = stored.get("answers"), stored.get("times")
        if not isinstance(answers, Mapping) or not isinstance(times, Mapping):
            raise StudyError(f"form {form.name}: what was stored has no answers (start it anew)")
        for name, value in answers.items():
            time = times.get(name, 0.0)
            number = isinstance(time, int | float) and math.isfinite(time)
            state.answer(str(name), value, float(time) if number else 0.0)
        state.done = stored.get("done") is True and not state.missing()
        return state
