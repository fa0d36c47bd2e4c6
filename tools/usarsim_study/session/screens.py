"""What a page is told to show at a step: the texts of the desk's protocol, as JSON objects.

In a blind study nothing here tells a condition: what drives is not said, and forms call conditions
by when they came.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from usarsim_study.forms import Form, FormState
from usarsim_study.session.notebook import CUT_OFF
from usarsim_study.session.steps import Past, Session, Step
from usarsim_study.study_file import Study

Message = dict[str, Any]
DRIVES: Mapping[str, str] = {
    "any": "Drive with the keyboard or a gamepad.",
    "keyboard": "Drive with the keyboard.",
    "gamepad": "Drive with the gamepad.",
}
BEGIN, GO_ON, AGREE = "Begin", "Go on", "I agree"
_CODE = "Your answers are kept under a code that was drawn at random."


def device_line(study: Study, step: Step) -> str:
    """What to drive with; not in a blind study."""
    assert step.task is not None
    assert step.task.cell is not None
    if study.blind:
        return ""
    return DRIVES[study.condition_named(step.task.cell.condition).device]


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


def end_message(number: int, past: Past) -> Message:
    """The session is over."""
    texts = {
        "excluded": "The training was not passed, so the session ends here. Thank you for coming.",
        "withdrawn": "The session was ended. Thank you for coming.",
    }
    text = texts.get(past.status, f"That was all. Thank you for taking part.\n\n{_CODE}")
    return {"type": "step", "step": number, "kind": "end", "title": "The end", "text": text}


def message(session: Session, past: Past, step: Step, page: int, consent: str) -> Message:
    """What stands before a seat, panels apart.

    Args:
        session: the plan. past: what has happened. step: what stands there.
        page: of a form, from 1. consent: the text to agree to.
    """
    study, number = session.study, step.number
    match step.kind:
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
            return _ready(session, past, step)
        case "panel":
            return wait_message(number, "The robots are coming into the world.")
        case "wait":
            return wait_message(number, "Please wait for the other operator.")
        case "end":
            return end_message(number, past)


def _ready(session: Session, past: Past, step: Step) -> Message:
    """Before a training or a trial: what is to be done."""
    study, task = session.study, step.task
    assert task is not None
    lines = [device_line(study, step)]
    attempts = past.attempts(task)
    if task.kind == "training":
        title = "Training"
        training = study.training
        assert training is not None
        lines.append(
            f"Drive without touching more than {_many(training.contacts, 'thing')}, and mark "
            f"{_many(training.victims, 'victim')}."
        )
        if attempts and attempts[-1].status == "failed":
            left = training.attempts - sum(one.status == "failed" for one in attempts)
            lines.insert(0, f"{attempts[-1].reason} You can try {_many(left, 'time')} more.")
    else:
        title = f"Trial {task.number} of {len(session.order)}"
        lines.append("Find as many victims as you can, and mark each one that you see.")
    if attempts and attempts[-1].status == "void":
        why = "" if attempts[-1].reason == CUT_OFF else " by a fault"
        lines.insert(0, f"The last attempt was interrupted{why}; it does not count.")
    lines.append("It begins as soon as you say so.")
    return text_message(step.number, title, "\n\n".join(one for one in lines if one), BEGIN)


def _many(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")
