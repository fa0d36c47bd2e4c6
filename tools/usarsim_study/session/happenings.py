"""Says in plain sentences what happens in a trial, for whoever leads the session.

`SENTENCES` is the one table: a kind of record that is not in it is not told. What a record holds in
words of the log (causes, ends, ways to be found) is in the tables that it uses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from usarsim_study.trial import Record

ENDS: Mapping[str, str] = {
    "time": "the time is over",
    "operator": "it was ended",
    "all_found": "everybody is found",
    "aborted": "it was broken off",
    "error": "a fault ended it",
}
"""By `why` of `trial_end`."""
ALARMS: Mapping[str, str] = {
    "tipped": "it has tipped over",
    "link": "its link is lost",
    "stuck": "it is driven and does not move",
    "battery": "its battery is low",
    "collision": "it has touched something",
    "stale": "nothing is heard of it",
}
"""By `cause` of `alarm`."""
FOUND: Mapping[str, str] = {"mark": "by a mark", "view": "in its picture", "proximity": "close by"}
"""By `how` of `found`."""
LOST: Mapping[str, str] = {
    "tipped over": "it lies on its side",
    "out of bounds": "it is out of bounds",
    "link lost": "its link is lost",
    "left the world": "it has left the world",
}
"""By `why` of `lost`."""
INJECTS: Mapping[str, str] = {
    "robot_fails": "{robot} fails",
    "robot_recovers": "{robot} works again",
    "link_drops": "the link of {robot} drops",
    "link_returns": "the link of {robot} is back",
    "victim_calls": "{victim} calls",
    "message": "operators read: {text}",
}
"""By `do` of `inject`."""
STATUSES: Mapping[str, str] = {
    "complete": "is complete",
    "aborted": "was broken off and is missing",
    "void": "is void and will be repeated",
    "passed": "is passed",
    "failed": "is not passed",
}
"""How an attempt at a training or a trial ended."""


def _end(one: Record) -> str:
    why, text = _of(ENDS, one.get("why")), one.get("text")
    told = text if text and one.get("why") == "operator" else _with(why, text)
    return f"{one['what']} ends: {told}"


def _found(one: Record) -> str:
    robot, how = one.get("robot"), _of(FOUND, one.get("how"))
    return (
        f"{robot} has found {one['victim']} {how}" if robot else f"{one['victim']} is found {how}"
    )


def _credit(one: Record) -> str:
    counts = "counts" if one.get("credited") else "does not count"
    return _with(f"{one['victim']} {counts}", one.get("why"))


def _inject(one: Record) -> str:
    facts = {key: one.get(key) or "somebody" for key in ("robot", "victim", "text")}
    what = INJECTS.get(str(one.get("do")), "something happens").format_map(facts)
    if not one.get("done", True):
        return _with(f"this could not happen: {what}", one.get("why"))
    lasts = one.get("lasts")
    return f"{what}, for {lasts:g} s" if isinstance(lasts, int | float) else what


SENTENCES: Mapping[str, Callable[[Record], str]] = {
    "trial_start": lambda one: f"{one['what']} begins",
    "trial_end": _end,
    "found": _found,
    "credit": _credit,
    "lost": lambda one: f"{one['robot']} is lost: {_of(LOST, one.get('why'))}",
    "alarm": lambda one: f"alarm of {one['robot']}: {_of(ALARMS, one.get('cause'))}",
    "inject": _inject,
    "error": lambda one: _with("a fault", one.get("text")),
}
"""By kind of record, in which `what` runs stands too."""


def sentence(record: Record, elapsed: float, what: str) -> str:
    """A record with the time in the trial, s; empty: the experimenter is not told of it.

    what: a training or a trial, in words.
    """
    words = SENTENCES.get(record["kind"])
    if words is None:
        return ""
    minutes, seconds = divmod(int(max(elapsed, 0.0)), 60)
    return f"{minutes:02}:{seconds:02} {closed(words({**record, 'what': what}))}"


def closed(text: str) -> str:
    """A text as a sentence."""
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")


def attempt_told(what: str, status: str, why: str) -> str:
    """How an attempt ended. what: a training or a trial, in words."""
    return closed(_with(f"{what} {_of(STATUSES, status)}", why))


def _of(table: Mapping[str, str], word: object) -> str:
    """A word of the log in plain words; one that is not known stays, without lines below."""
    return table.get(str(word), str(word).replace("_", " "))


def _with(text: str, more: object) -> str:
    return f"{text} ({str(more).rstrip('.')})" if more else text
