"""What a check is, what it can find, the decorators that enter one, and how all are found.

A check function says what it found by returning or by raising.
"""

from __future__ import annotations

import fnmatch
import importlib
import inspect
import pkgutil
import re
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from usarsim_conformance.case import Case


class Verdict(Enum):
    """What a check found."""

    PASS = "pass"
    FAIL = "fail"
    NOT_APPLICABLE = "not applicable"
    INCONCLUSIVE = "inconclusive"


class Severity(Enum):
    """How bad it is to break a rule.

    MUST: clients in the field stop working. SHOULD: some clients suffer, or the original's
    behaviour differs for no good reason. INFORMATIVE: worth knowing, no fault.
    """

    MUST = "must"
    SHOULD = "should"
    INFORMATIVE = "informative"


class Failed(Exception):  # noqa: N818  (a verdict, as the next two)
    """The rule is broken; the text says what was seen and what was expected."""


class NotApplicable(Exception):  # noqa: N818
    """The rule says nothing about this server; the text says why."""


class Inconclusive(Exception):  # noqa: N818
    """The rule could not be judged; the text says what stood in the way."""


class Crowded(Inconclusive):
    """The rule could not be judged beside other checks, whose robots had all there is of
    something; it is judged again when they are gone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The verdict of one check in one dialect."""

    check: str  # identifier of the check
    dialect: str  # that the server was asked to speak; empty for checks to which it does not matter
    verdict: Verdict  # what was found
    reason: str = ""  # what was seen, for every verdict but a pass
    seconds: float = 0.0  # of wall time that the check took
    transcript: tuple[str, ...] = ()
    """What was sent and received, shortened; kept for every verdict but a pass."""


DIALECTS = ("ut2004", "udk", "gazebo")
"""All dialects of the protocol: a check for these runs once in each that the server speaks."""
UNREAL = ("ut2004", "udk")
"""The dialects of the two Unreal generations."""
UT2004 = ("ut2004",)
UDK = ("udk",)
GAZEBO = ("gazebo",)
ONCE: tuple[str, ...] = ()
"""For rules in which the dialect plays no part: the check runs once."""

SERVICES = ("control", "images", "groundtruth", "wireless", "comserver", "truth")
"""What a check may talk to; all but the first exist only if the user names their port."""

Function = Callable[["Case"], Awaitable[None]]

_ID = re.compile(r"[a-z]+(\.[a-z0-9-]+)+")


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One rule, and how to find out whether a server keeps it."""

    id: str  # stable name, words joined by points, the service first: `control.init.case`
    title: str  # the rule in a few words
    rule: str  # the rule in full; the docstring of the function
    source: str  # where the rule comes from
    severity: Severity  # how bad it is to break it
    dialects: tuple[str, ...]  # in which it runs, once each; empty to run once in the server's own
    service: str  # that it is about. If the user named no port of it, it does not apply.
    exclusive: bool  # no other check may run at the same time
    function: Function  # the check itself


_CHECKS: dict[str, Check] = {}


def check(
    id: str,
    title: str,
    *,
    source: str,
    severity: Severity = Severity.MUST,
    dialects: tuple[str, ...] = DIALECTS,
    service: str = "control",
    exclusive: bool = False,
) -> Callable[[Function], Function]:
    """Make a function a check.

    The function gets a `case.Case`. It returns if the rule is kept and otherwise raises `Failed`,
    `NotApplicable` or `Inconclusive`, most easily through methods of the case. Its docstring is
    the rule, as users read it.

    Raises:
        ValueError: if the identifier is taken or malformed, or the rule is missing.
    """

    def register(function: Function) -> Function:
        rule = " ".join((inspect.getdoc(function) or "").split())
        if not _ID.fullmatch(id):
            raise ValueError(f"{id!r} is no identifier of a check; write it like control.init.case")
        if id in _CHECKS and _CHECKS[id].function.__module__ != function.__module__:
            raise ValueError(f"two checks are called {id}")
        if not rule or not source:
            raise ValueError(f"{id} needs a rule (its docstring) and a source")
        if service not in SERVICES or not set(dialects) <= set(DIALECTS):
            raise ValueError(f"{id}: unknown service {service!r} or dialect among {dialects!r}")
        _CHECKS[id] = Check(
            id=id,
            title=title,
            rule=rule,
            source=source,
            severity=severity,
            dialects=dialects,
            service=service,
            exclusive=exclusive,
            function=function,
        )
        return function

    return register


def all_checks() -> tuple[Check, ...]:
    """Every check of the files in `checks/`, by service and identifier."""
    from usarsim_conformance import checks as package

    for entry in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{entry.name}")
    return tuple(
        sorted(_CHECKS.values(), key=lambda check: (SERVICES.index(check.service), check.id))
    )


Named = TypeVar("Named")


def select(
    named: Iterable[Named], pattern: str | None, name: Callable[[Named], str] = attrgetter("id")
) -> tuple[Named, ...]:
    """Those checks, or faults, whose name a pattern fits.

    Args:
        named: to choose from.
        pattern: with `*` and `?`; several with commas between them. A plain word fits wherever it
            stands in the name. None fits all.
        name: of one of them, by default its identifier.
    """
    if pattern is None:
        return tuple(named)
    words = [word.strip() for word in pattern.split(",") if word.strip()]
    globs = [word if any(sign in word for sign in "*?[") else f"*{word}*" for word in words]
    return tuple(
        one for one in named if any(fnmatch.fnmatchcase(name(one), glob) for glob in globs)
    )


Decorator = Callable[[Function], Function]


def checks_of(
    service: str,
    *,
    reference: str = "side channels reference",
    dialects: tuple[str, ...] = ONCE,
) -> Callable[..., Decorator]:
    """A decorator like `check` for one service, which takes name, title, source and severity.

    Args:
        service: that is judged; the identifiers begin with it.
        reference: where a source is found that begins with a number.
        dialects: see `check`; on the side channels dialects play no part.
    """
    return partial(_check, service, reference, dialects)


def _check(
    service: str,
    reference: str,
    usual: tuple[str, ...],
    id: str,
    title: str,
    source: str,
    severity: Severity = Severity.MUST,
    *,
    dialects: tuple[str, ...] | None = None,
    exclusive: bool = False,
) -> Decorator:
    return check(
        f"{service}.{id}",
        title,
        source=f"{reference} {source}" if source[0].isdigit() else source,
        severity=severity,
        dialects=usual if dialects is None else dialects,
        service=service,
        exclusive=exclusive,
    )


control, once, unreal, ut2004, udk, gazebo = (
    checks_of("control", reference="protocol reference", dialects=dialects)
    for dialects in (DIALECTS, ONCE, UNREAL, UT2004, UDK, GAZEBO)
)
"""Decorators of checks of the control port, in every dialect and in some of them only."""
