"""What a participant does next, by what has happened so far; knows no file, no clock, no socket.

A session is a list of tasks that follows from the study and the participant's order: welcome,
consent, forms before, then for each trial its training (the first time that its device comes), the
trial and its forms, a break, and forms after the last one. Each operator has a seat, from 1 on;
forms and texts are done by each seat alone, training and trials by all together.

`next_step` looks for the first task that is not done. So a session that was cut off goes on where
it was as soon as somebody reads again what is on disk.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from usarsim_study.assignment import Cell, Order
from usarsim_study.forms import Form, FormState
from usarsim_study.study_file import Study

TaskKind = Literal["welcome", "consent", "form", "training", "trial", "break"]
StepKind = Literal["welcome", "consent", "form", "ready", "panel", "break", "wait", "end"]
BEFORE, AFTER = 0, 0
"""Number of the trial of forms that belong to none."""
ANY = "any"
"""Device of conditions that leave the choice."""
_TEXTS: Mapping[str, StepKind] = {"welcome": "welcome", "consent": "consent", "break": "break"}
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
"""What conditions are called in a blind study, by when the participant meets them."""


@dataclass(frozen=True, slots=True)
class Task:
    """One thing to do.

    Attributes:
        kind: what.
        number: of the trial or the training, from 1; 0: it belongs to none.
        form: name of the form.
        cell: of a trial, or of the trial that is trained for.
    """

    kind: TaskKind
    number: int = 0
    form: str = ""
    cell: Cell | None = None

    @property
    def key(self) -> str:
        """Its name in files: `consent`, `break 1`, `form 2 workload`; no condition is in it."""
        parts = (self.kind, str(self.number) if self.number or self.form else "", self.form)
        return " ".join(one for one in parts if one)

    @property
    def joint(self) -> bool:
        """Whether all operators do it together."""
        return self.kind in ("training", "trial")


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt at a trial or a training. status: `running` is under way, or was cut off."""

    number: int
    attempt: int
    status: str
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Past:
    """What has happened so far in a session.

    Attributes:
        status, reason: of the participant; other than `running`: it has ended.
        passed: tasks that need no more, by key and seat: texts that were read, forms left out.
        forms: as far as they are filled in, by trial (0: before and after), form and seat.
        trials, trainings: attempts, in order.
    """

    status: str = "running"
    reason: str = ""
    passed: frozenset[tuple[str, int]] = frozenset()
    forms: Mapping[tuple[int, str, int], FormState] = field(default_factory=dict)
    trials: tuple[Attempt, ...] = ()
    trainings: tuple[Attempt, ...] = ()

    def attempts(self, task: Task) -> list[Attempt]:
        """Those at a trial or training."""
        rows = self.trials if task.kind == "trial" else self.trainings
        return [one for one in rows if one.number == task.number]

    def last(self, task: Task) -> str | None:
        """How the last attempt ended; None: there was none."""
        return next((one.status for one in reversed(self.attempts(task))), None)


@dataclass(frozen=True, slots=True)
class Step:
    """What stands before one seat.

    Attributes:
        kind: `ready` is the text before a training or a trial, `panel` that itself.
        task: which it belongs to; None at the end.
        place: of the task in the session, from 0.
        attempt: the how manieth of a training or a trial, from 1.
        form, state: of a form, and as far as it is filled in.
    """

    kind: StepKind
    task: Task | None = None
    place: int = 0
    attempt: int = 0
    form: Form | None = None
    state: FormState | None = None

    @property
    def number(self) -> int:
        """What pages call it: the same after a restart, another for all that looks different."""
        part = {"ready": 1, "panel": 2, "wait": 3}.get(self.kind, 0)
        return 1000 * (self.place + 1) + 10 * min(self.attempt, 99) + part


def plan(study: Study, order: Order, consent: bool) -> tuple[Task, ...]:
    """All tasks of a participant, in order.

    Args:
        study: which. order: the participant's trials. consent: there is a text to agree to.
    """
    tasks = [Task("welcome")] if study.welcome.strip() else []
    tasks += [Task("consent")] if consent else []
    tasks += [Task("form", BEFORE, one.name) for one in study.form if one.when == "before"]
    trained: list[str] = []
    for number, cell in enumerate(order, start=1):
        device = study.condition_named(cell.condition).device
        if study.training is not None and device not in trained:
            trained.append(device)
            tasks.append(Task("training", len(trained), cell=cell))
        tasks.append(Task("trial", number, cell=cell))
        tasks += [Task("form", number, one.name) for one in study.form if one.when == "after_trial"]
        if number < len(order):
            tasks.append(Task("break", number))
    return (*tasks, *(Task("form", AFTER, one.name) for one in study.form if one.when == "after"))


def seats(study: Study, order: Order) -> int:
    """How many operators a session has."""
    alone = all(study.condition_named(cell.condition).operators == "one" for cell in order)
    return 1 if alone else 2


def labels(study: Study, order: Order) -> tuple[str, ...]:
    """What a blind study calls its conditions, in the order of its file; empty if it is not blind.

    Whoever answers knows them by when they came: `the first`, `the second`.
    """
    return tuple(f"the {one}" for one in codes(study, order))


def codes(study: Study, order: Order) -> tuple[str, ...]:
    """What answers call the conditions of a blind study, in the order of its file."""
    if not study.blind:
        return ()
    met = list(dict.fromkeys(cell.condition for cell in order))
    return tuple(
        ORDINALS[min(met.index(one.name), len(ORDINALS) - 1)] if one.name in met else one.name
        for one in study.condition
    )


def form_of(study: Study, order: Order, task: Task) -> Form:
    """The form of a task, as this participant sees it."""
    return study.form_shown(task.form, codes(study, order), labels(study, order))


@dataclass(frozen=True, slots=True)
class Session:
    """The plan of one participant.

    Attributes:
        study: which. order: the participant's trials. consent: there is a text to agree to.
    """

    study: Study
    order: Order
    consent: bool = False

    @property
    def tasks(self) -> tuple[Task, ...]:
        """All, in order."""
        return plan(self.study, self.order, self.consent)

    @property
    def seats(self) -> int:
        """How many operators there are."""
        return seats(self.study, self.order)

    def works(self, task: Task, seat: int) -> bool:
        """Whether a seat has part in a task: only one operator drives where one is enough."""
        if task.cell is not None and task.kind == "trial":
            return seat <= self.drivers(task.cell)
        if task.kind == "form" and task.number:
            return seat <= self.drivers(self.order[task.number - 1])
        return True

    def drivers(self, cell: Cell) -> int:
        """How many operators drive in a trial."""
        return 1 if self.study.condition_named(cell.condition).operators == "one" else 2

    def done(self, past: Past, task: Task, seat: int) -> bool:
        """Whether a seat has nothing to do any more at a task."""
        if not self.works(task, seat) or (task.key, seat) in past.passed:
            return not task.joint or self._over(past, task)
        match task.kind:
            case "form":
                if task.number and not self._counts(past, task.number):
                    return True  # there is nothing that it could be about
                state = past.forms.get((task.number, task.form, seat))
                return state is not None and state.done
            case "training" | "trial":
                return self._over(past, task)
        return False

    def _over(self, past: Past, task: Task) -> bool:
        return past.last(task) in ("passed", "complete", "aborted", "missing")

    def _counts(self, past: Past, trial: int) -> bool:
        return past.last(Task("trial", trial)) == "complete"

    def step(
        self, past: Past, seat: int = 1, ready: frozenset[tuple[int, int]] = frozenset()
    ) -> Step:
        """What stands before a seat; see `next_step`."""
        tasks = self.tasks
        if past.status != "running":
            return Step("end", place=len(tasks))
        for place, task in enumerate(tasks):
            if not self.done(past, task, seat):
                if task.joint:
                    return self._together(past, place, task, seat, ready)
                if task.kind == "form":
                    form = form_of(self.study, self.order, task)
                    state = past.forms.get((task.number, task.form, seat)) or FormState(form)
                    return Step("form", task, place, 0, form, state)
                return Step(_TEXTS[task.kind], task, place)
        others = range(1, self.seats + 1)
        if all(self.done(past, task, one) for task in tasks for one in others):
            return Step("end", place=len(tasks))
        return Step("wait", place=len(tasks))

    def _together(
        self, past: Past, place: int, task: Task, seat: int, ready: frozenset[tuple[int, int]]
    ) -> Step:
        """A training or a trial: everybody is waited for, and asked whether to begin."""
        attempts = past.attempts(task)
        running = bool(attempts) and attempts[-1].status == "running"
        attempt = len(attempts) if running else len(attempts) + 1
        everybody = range(1, self.seats + 1)
        before = self.tasks[:place]
        if not all(self.done(past, one, other) for one in before for other in everybody):
            return Step("wait", task, place, attempt)
        working = [one for one in everybody if self.works(task, one)]
        if seat not in working:
            return Step("wait", task, place, attempt)
        number = Step("ready", task, place, attempt).number
        agreed = [one for one in working if (number, one) in ready]
        if running or len(agreed) == len(working):
            return Step("panel", task, place, attempt)
        return Step("wait" if seat in agreed else "ready", task, place, attempt)

    def following(self, step: Step) -> Task | None:
        """The task after that of a step, whoever does it; None: there is none."""
        rest = self.tasks[step.place + 1 :]
        return rest[0] if rest else None

    def training_failed(self, past: Past) -> bool:
        """Whether the participant had all attempts that the study allows at a training."""
        training = self.study.training
        if training is None:
            return False
        failed = [one.number for one in past.trainings if one.status == "failed"]
        return any(failed.count(number) >= training.attempts for number in set(failed))


def next_step(
    study: Study,
    order: Order,
    past: Past,
    seat: int = 1,
    *,
    consent: bool = False,
    ready: frozenset[tuple[int, int]] = frozenset(),
) -> Step:
    """What a participant does next.

    Args:
        study: which. order: the participant's trials. past: what is on disk. seat: whose, from 1.
        consent: there is a text to agree to.
        ready: numbers of steps `ready` and seats that have said so; not on disk, so that after a
            restart everybody is asked again.
    """
    return Session(study, order, consent).step(past, seat, ready)
