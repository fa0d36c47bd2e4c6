"""The server: whether it starts with these settings; another process puts it together."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from usarsim_doctor.isolation import Outcome, attempt
from usarsim_doctor.registry import Context, Finding, Mark, check

SERVER_TIMEOUT = 90.0


@check("server", "Server", order=60)
def look_at_server(context: Context) -> Iterator[Finding]:
    """Let another process put it together."""
    settings = context.settings
    if Path(settings.world).expanduser().is_file():
        text = f"{settings.world} is a map, which the server imports when it starts"
        cure = f"usarsim import {settings.world}"
        yield Finding("world", Mark.NOTE, f"{text}; this shows how that goes", cure)
        return
    yield from judge_server(attempt(["server"], settings, SERVER_TIMEOUT)["server"])


def judge_server(outcome: Outcome) -> Iterator[Finding]:
    """What to say after the trial."""
    if outcome.failure is not None:
        text = outcome.failure if outcome.told else f"a defect, {outcome.failure}"
        yield Finding("start", Mark.PROBLEM, f"would not start: {text}", advice=outcome.advice)
        return
    values = outcome.values
    seconds = float(values["seconds"])
    text = f"would start, in {seconds:.1f} s, with the world {values['world']}"
    yield Finding("start", Mark.OK, text, values={"world": values["world"], "start_s": seconds})
    broken = values["broken"]
    if values["tried"] > len(broken):
        text = f"{values['tried'] - len(broken)} of your own can be put into the world"
        yield Finding("robots", Mark.OK, text)
    for robot in broken:
        text = f"cannot be put into the world: {robot['problem']}"
        yield Finding(robot["name"], Mark.WARNING, text, advice=robot["advice"])
    reason = values["not_compiled"]
    if reason:
        text = f"not compiled, so somewhat slower: {reason}"
        yield Finding("steps", Mark.NOTE, text)
    else:
        yield Finding("steps", Mark.OK, "servos, contact compensation and rays are compiled")
