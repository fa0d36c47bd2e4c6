"""What a page is told to show at a step: the texts of the desk's protocol, as JSON objects.

In a blind study nothing here tells a condition: what drives is not said, and forms call conditions
by when they came.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from usarsim_study.forms import Form, FormState
from usarsim_study.session.notebook import CUT_OFF
from usarsim_study.session.steps import Past, Session, Step, Task, form_of
from usarsim_study.study_file import Study

Message = dict[str, Any]
DRIVES: Mapping[str, str] = {
    "any": "Drive with the keyboard or a gamepad.",
    "keyboard": "Drive with the keyboard.",
    "gamepad": "Drive with the gamepad.",
}
KEYS = (
    "W, A, S, D or arrows drive, 1 to 9 choose a robot, M and then Enter mark a victim, "
    "Shift slows down, Space stops everything"
)
"""What keys do unless they were changed: as the table of docs/console.md (a test compares them)."""
PAD = (
    "hold RB and move the left stick to drive, A, B, X, Y choose a robot, LB slows down, both "
    "sticks pressed stop everything; a double click on the map, or the keys M and then Enter, "
    "mark a victim"
)
"""What a pad does; as `KEYS`."""
BEGIN, GO_ON, AGREE = "Begin", "Go on", "I agree"


def device_line(study: Study, step: Step) -> str:
    """What to drive with; not in a blind study."""
    assert step.task is not None
    assert step.task.cell is not None
    if study.blind:
        return ""
    return DRIVES[study.condition_named(step.task.cell.condition).device]


def controls_line(study: Study, step: Step) -> str:
    """What keys or the pad do; in a blind study both, since it must not be told which counts."""
    assert step.task is not None
    assert step.task.cell is not None
    device = study.condition_named(step.task.cell.condition).device
    keys, pad = f"Keyboard: {KEYS}.", f"Gamepad: {PAD}."
    if study.blind or device == "any":
        return f"{keys} {pad}"
    return keys if device == "keyboard" else pad


def panel_line(study: Study, step: Step, lasts: float | None = None) -> str:
    """What stands above the panel all the time; a training has a second line.

    Args:
        study: which. step: a training or a trial. lasts: s that it lasts at most; None: not known.
    """
    line = " ".join(one for one in (device_line(study, step), controls_line(study, step)) if one)
    if step.task is None or step.task.kind != "training":
        return line
    told = " ".join(training_lines(study, lasts)).replace("\n", " ")
    return f"{line}\n{told}"


def training_lines(study: Study, lasts: float | None) -> list[str]:
    """What a training asks for, what is there, and how long it lasts, s."""
    training = study.training
    assert training is not None
    asked = (
        f"Training: mark {many(training.victims, 'victim')}, and touch at most "
        f"{many(training.contacts, 'thing')}."
    )
    ends = "It ends as soon as all that is asked for is marked"
    ends += "." if lasts is None else f", or after {duration(lasts)}."
    return [one for one in (asked, training.text.strip(), ends) if one]


def duration(seconds: float) -> str:
    """s in words."""
    if seconds < 60.0:
        return many(round(seconds), "second")
    minutes, rest = divmod(round(seconds), 60)
    return many(minutes, "minute") + (f" and {many(rest, 'second')}" if rest else "")


def plain(session: Session, step: Step, past: Past) -> tuple[str, str]:
    """What stands before the participant, and what comes next, in words for the experimenter."""
    if past.status != "running":
        return "the session has ended", "the next participant"
    task = step.task
    if step.kind == "wait" and task is not None and task.joint:
        now = f"waiting for the other operator before {task_told(session, task)}"
    elif step.kind == "ready" and task is not None:
        now = f"before {task_told(session, task)}: waits until the participant begins"
    elif task is not None:
        now = task_told(session, task)
    else:
        now = "waiting for the other operator" if step.kind == "wait" else "the end"
    if step.kind == "ready" and task is not None:
        return now, task_told(session, task)
    following = session.following(step)
    return now, "the end" if following is None else task_told(session, following)


def task_told(session: Session, task: Task) -> str:
    """A task in words; no condition is in them."""
    match task.kind:
        case "welcome":
            return "the welcome"
        case "consent":
            return "the consent"
        case "form":
            form = form_of(session.study, session.order, task)
            after = f" after trial {task.number}" if task.number else ""
            return f"the form {form.title or task.form}{after}"
        case "training":
            trainings = [one for one in session.tasks if one.kind == "training"]
            which = f" {task.number} of {len(trainings)}" if len(trainings) > 1 else ""
            return f"training{which}"
        case "trial":
            return f"trial {task.number} of {len(session.order)}"
        case "break":
            return f"the break after trial {task.number}"


def form_message(number: int, form: Form, state: FormState, page: int, freeze: bool) -> Message:
    """A form as far as it is filled in."""
    return {
        "type": "step",
        "step": number,
        "kind": "form",
        "form": form.description(),
        "answers": dict(state.answers),
        "page": page,
        "freeze": freeze,
    }


def text_message(number: int, title: str, text: str, button: str | None) -> Message:
    """A text, with a button or without."""
    return {
        "type": "step",
        "step": number,
        "kind": "text",
        "title": title,
        "text": text,
        "button": button,
    }


def wait_message(number: int, text: str) -> Message:
    """Something is not ready yet."""
    return {"type": "step", "step": number, "kind": "wait", "text": text}


def panel_message(number: int, url: str, line: str) -> Message:
    """The gateway's page."""
    return {"type": "step", "step": number, "kind": "panel", "url": url, "line": line}


def end_message(number: int, past: Past, code: str) -> Message:
    """The session is over; code: of the participant, by which all that is stored is found again."""
    texts = {
        "excluded": "The training was not passed, so the session ends here. Thank you for coming.",
        "withdrawn": "The session was ended. Thank you for coming.",
    }
    told = (
        f"Your code is {code}. What you did and answered is stored under it, without your name. "
        "Note the code: to have all of it deleted, tell the experimenter this code."
    )
    text = texts.get(past.status, "That was all. Thank you for taking part.") + f"\n\n{told}"
    return {"type": "step", "step": number, "kind": "end", "title": "The end", "text": text}


def message(
    session: Session,
    past: Past,
    step: Step,
    page: int,
    consent: str,
    code: str = "",
    lasts: float | None = None,
) -> Message:
    """What stands before a seat, panels apart.

    Args:
        session: the plan. past: what has happened. step: what stands there.
        page: of a form, from 1. consent: the text to agree to. code: of the participant.
        lasts: s that a training or trial lasts at most; None: it is none, or not known.
    """
    study, number = session.study, step.number
    match step.kind:
        case "welcome":
            return text_message(number, study.title, study.welcome.strip(), GO_ON)
        case "consent":
            return text_message(number, study.title, consent, AGREE)
        case "form":
            assert step.form is not None
            assert step.state is not None
            return form_message(number, step.form, step.state, page, freeze=False)
        case "break":
            text = "Take a break if you like. Go on when you are ready."
            return text_message(number, "Break", text, GO_ON)
        case "ready":
            return _ready(session, past, step, lasts)
        case "panel":
            return wait_message(number, "The robots are coming into the world.")
        case "wait":
            return wait_message(number, "Please wait for the other operator.")
        case "end":
            return end_message(number, past, code)


def _ready(session: Session, past: Past, step: Step, lasts: float | None) -> Message:
    """Before a training or a trial: what is to be done."""
    study, task = session.study, step.task
    assert task is not None
    lines = [device_line(study, step), controls_line(study, step)]
    attempts = past.attempts(task)
    if task.kind == "training":
        title = "Training"
        training = study.training
        assert training is not None
        lines += training_lines(study, lasts)
        if attempts and attempts[-1].status == "failed":
            left = training.attempts - sum(one.status == "failed" for one in attempts)
            lines.insert(0, f"{attempts[-1].reason} You can try {many(left, 'time')} more.")
    else:
        title = f"Trial {task.number} of {len(session.order)}"
        lines.append("Find as many victims as you can, and mark each one that you see.")
        if lasts is not None:
            lines.append(f"The trial lasts at most {duration(lasts)}.")
    if attempts and attempts[-1].status == "void":
        why = "" if attempts[-1].reason == CUT_OFF else " by a fault"
        lines.insert(0, f"The last attempt was interrupted{why}; it does not count.")
    lines.append(f"It begins when you press {BEGIN}.")
    return text_message(step.number, title, "\n\n".join(one for one in lines if one), BEGIN)


def many(count: int, what: str) -> str:
    """A count with its noun."""
    return f"{count} {what}" + ("" if count == 1 else "s")
