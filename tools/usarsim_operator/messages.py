"""Texts of a page, checked: what comes out has its type, its fields, and numbers in their range."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from usarsim_operator import scenarios
from usarsim_operator.injects import WHOM
from usarsim_operator.roles import LONGEST
from usarsim_server.protocol.json_text import parse_json

LATER = object()
"""What a handler of a text returns whose answer comes later."""
Fields = Mapping[str, Any]
Check = Callable[[Any], Any]
"""Makes a field of what JSON says.

Raises:
    ValueError: with what it must be.
"""


class PageError(ValueError):
    """A text that makes no sense. id: which one it was; None if that cannot be told."""

    def __init__(self, why: str, id: int | None = None) -> None:
        super().__init__(why)
        self.id = id


@dataclass(frozen=True, slots=True)
class Request:
    """A text of a page.

    Attributes:
        type: what it wants. id: for its answer. fields: the others, checked.
        limited: in words, what was beyond its limit and is taken for that.
        clock: s of the page's clock when it was said; None if it does not tell.
    """

    type: str
    id: int | None
    fields: Mapping[str, Any]
    clock: float | None = None
    limited: str = ""


def _text(longest: int) -> Check:
    def check(value: Any) -> str:
        if not isinstance(value, str) or not 0 < len(value) <= longest:
            raise ValueError(f"must be a text of 1 to {longest} characters")
        if any(ord(one) < 32 for one in value):
            raise ValueError("must have no control characters")
        return value

    return check


def _note(value: Any) -> str:
    if not isinstance(value, str) or len(value) > 1000:
        raise ValueError("must be a text of at most 1000 characters")
    return value


def _file(value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= scenarios.LONGEST:
        raise ValueError(f"must be the text of a file, of at most {scenarios.LONGEST} characters")
    return value


def _number(least: float, most: float) -> Check:
    def check(value: Any) -> float:
        fits = isinstance(value, int | float) and not isinstance(value, bool)
        if not fits or not least <= value <= most:  # also NaN
            raise ValueError(f"must be a number from {least:g} to {most:g}")
        return float(value)

    return check


def _part(value: Any) -> float:
    """A part of full power, forward or back; beyond that it is `_Limited`."""
    asked: float = _number(-math.inf, math.inf)(value)
    if abs(asked) <= 1.0:
        return asked
    return _Limited(math.copysign(1.0, asked), asked)


class _Limited(float):
    """A number that stands for one beyond its limit. asked: that one."""

    asked: float

    def __new__(cls, taken: float, asked: float) -> _Limited:
        found = super().__new__(cls, taken)
        found.asked = asked
        return found


def _whole(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**53:
        raise ValueError("must be a whole number")
    return value


def _switch(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError("must be true or false")
    return value


def _one_of(*words: str) -> Check:
    def check(value: Any) -> str:
        if not isinstance(value, str) or value not in words:
            raise ValueError(f"must be one of {', '.join(words)}")
        return value

    return check


def _place(value: Any) -> tuple[float, float, float]:
    check = _number(-1e6, 1e6)
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError("must be three numbers")
    x, y, z = (check(one) for one in value)
    return x, y, z


def _angles(value: Any) -> dict[str, float]:
    check, name = _number(-math.tau, math.tau), _text(40)
    if not isinstance(value, dict) or not 0 < len(value) <= 16:
        raise ValueError("must be angles by the names of 1 to 16 joints")
    return {name(key): check(one) for key, one in value.items()}


def _ages(value: Any) -> dict[str, float]:
    check, name = _number(0.0, 1e6), _text(200)
    if not isinstance(value, dict) or len(value) > 250:
        raise ValueError("must be ages by the names of at most 250 robots")
    return {name(key): check(one) for key, one in value.items()}


def _route(value: Any) -> list[tuple[float, float]]:
    check = _number(-1e6, 1e6)
    if not isinstance(value, list) or not 2 <= len(value) <= 200:
        raise ValueError("must be a list of 2 to 200 places")
    if not all(isinstance(place, list) and len(place) == 2 for place in value):
        raise ValueError("must be a list of places [x, y]")
    return [(check(x), check(y)) for x, y in value]


def _or_none(check: Check) -> Check:
    return lambda value: None if value is None else check(value)


_ROBOT = {"robot": _text(200)}
_PART = _part
_DEVICE = {"device?": _one_of("keyboard", "pad", "touch", "program")}
_DRIVING = frozenset({"drive", "fly", "steer"})
_STATUS = {"status?": _note, "note?": _note}
_CLOCK = _number(-1e15, 1e15)

FIELDS: Mapping[str, Mapping[str, Check]] = {
    "hello": {
        "token": _text(200),
        "name?": _text(40),
        "webgl?": _switch,
        "shown?": _switch,
        "ready?": _switch,
    },
    "ping": {"answered?": _CLOCK, "round?": _number(0.0, 1e6), "ages?": _ages},
    "shown": {"count": _whole},
    "ready": {"on": _switch},
    "select": _ROBOT,
    "take": {**_ROBOT, "force?": _switch},
    "reply": {**_ROBOT, "to": _whole, "grant": _switch},
    "hand_back": _ROBOT,
    "drive": {**_ROBOT, "left": _PART, "right": _PART, **_DEVICE},
    "fly": {
        **_ROBOT,
        **dict.fromkeys(("altitude", "linear", "lateral", "rotational"), _PART),
        **_DEVICE,
    },
    "steer": {**_ROBOT, "speed": _PART, "steer": _PART, **_DEVICE},
    "rotate": {**_ROBOT, "degrees": _number(-3600.0, 3600.0), "speed?": _number(0.01, 1.0)},
    "travel": {**_ROBOT, "metres": _number(-1000.0, 1000.0), "speed?": _number(0.01, 1.0)},
    "enable": {**_ROBOT, "on": _switch},
    "policy": {**_ROBOT, "policy": _text(80), "route?": _route},
    "light": {**_ROBOT, "on": _switch},
    "flippers": {**_ROBOT, "angles": _angles},
    "camera_pose": {
        **_ROBOT,
        **dict.fromkeys(("pan?", "tilt?"), _number(-math.tau, math.tau)),
        "zoom?": _number(0.0, math.pi),
    },
    "estop": {},
    "estop_reset": {},
    "camera": {**_ROBOT, "on": _switch},
    "laser": {**_ROBOT, "on": _switch},
    "spawn": {"class": _text(80), "name?": _text(80), "start?": _text(80), "place?": _place},
    "remove": _ROBOT,
    "mark": {**_ROBOT, "place": _place, **_STATUS},
    "mark_edit": {"mark": _whole, "place?": _place, **_STATUS},
    "mark_delete": {"mark": _whole},
    "avoid": {"name": _text(80), "place": _place, "radius": _number(0.0, 10.0)},
    "follow": {**_ROBOT, "name": _or_none(_text(80)), "within": _number(0.0, 1000.0)},
    "acknowledge": {"alarm": _whole},
    "pace": {
        "action": _one_of("pause", "run", "step", "speed", "reset"),
        "seconds?": _number(0.0, 3600.0),
        "factor?": _number(0.01, 100.0),
    },
    "inject": {
        "do": _one_of(*WHOM),
        **dict.fromkeys(("robot?", "victim?"), _text(200)),
        "text?": _note,
        "lasts?": _number(0.1, 86400.0),
        "name?": _text(80),
    },
    "load": {"scenario": _file},
    "close": {},
    "lines": {"robot": _or_none(_text(200))},
}
"""Fields of each type; those with a question mark may be missing. Each may have `clock`, too."""


def driving(kind: str) -> bool:
    """Whether texts of a type drive, of which fewer are allowed."""
    return kind in _DRIVING


def read(text: str) -> Request:
    """Check a text.

    Raises:
        PageError: saying what is wrong with it, in words for who writes pages.
    """
    if len(text) > LONGEST:
        raise PageError(f"a text has at most {LONGEST} bytes")
    try:
        message = parse_json(text, finite=True)
    except ValueError:
        raise PageError("this is no JSON") from None
    if not isinstance(message, dict):
        raise PageError("this is no JSON object")
    id = message.get("id")
    if id is not None:
        try:
            id = _whole(id)
        except ValueError:
            raise PageError("id: must be a whole number") from None
    kind = message.get("type")
    known = FIELDS.get(kind) if isinstance(kind, str) else None
    if known is None or not isinstance(kind, str):
        raise PageError("there is no such type", id)
    fields: dict[str, Any] = {}
    for name, check in (*known.items(), ("clock?", _CLOCK)):
        key = name.rstrip("?")
        if key not in message:
            if name == key:
                raise PageError(f"{kind}: {key} is missing", id)
            continue
        try:
            fields[key] = check(message[key])
        except ValueError as error:
            raise PageError(f"{kind}: {key} {error}", id) from None
    clock = fields.pop("clock", None)
    beyond = [
        f"{key} {value.asked:g} is beyond the limit: {value:g} is taken"
        for key, value in fields.items()
        if isinstance(value, _Limited)
    ]
    return Request(kind, id, fields, clock, "; ".join(beyond))
