"""Which checks there are, and running them so that none can spoil the report.

@check("disk", "Disk", order=25)
def look(context: Context) -> Iterator[Finding]:
    yield Finding("free space", Mark.OK, "12 GiB")
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from usarsim_server.doctor import checks as package
from usarsim_server.doctor.findings import Checked, Finding, Mark
from usarsim_server.settings import Settings

__all__ = ["Audience", "Check", "Context", "Silence", "all_checks", "check", "examine"]


@dataclass(frozen=True, slots=True)
class Context:
    """What checks may ask for.

    Attributes:
        settings: those that the server would run with.
    """

    settings: Settings


Look = Callable[[Context], Iterable[Finding]]


@dataclass(frozen=True, slots=True)
class Check:
    """One check.

    Attributes:
        key: one word, for machines.
        title: for readers.
        order: place in the report; low numbers come first.
        look: what it does.
        measures: it takes seconds, because it measures; left out when there is hurry.
    """

    key: str
    title: str
    order: int
    look: Look
    measures: bool = False


class Audience(Protocol):
    """Who is told of findings as they come."""

    def begin(self, check: Check) -> None:
        """A check begins."""

    def tell(self, finding: Finding) -> None:
        """The check that has begun found something."""


class Silence:
    """An audience that only wants the result."""

    def begin(self, check: Check) -> None:
        """Nothing."""

    def tell(self, finding: Finding) -> None:
        """Nothing."""


_CHECKS: dict[str, Check] = {}


def check(key: str, title: str, order: int, *, measures: bool = False) -> Callable[[Look], Look]:
    """Decorator: enter a function as a check (see `Check`).

    Raises:
        ValueError: if another function has that key.
    """

    def enter(look: Look) -> Look:
        known = _CHECKS.get(key)
        if known is not None and known.look.__module__ != look.__module__:
            raise ValueError(f"check {key!r} is already that of {known.look.__module__}")
        _CHECKS[key] = Check(key, title, order, look, measures)
        return look

    return enter


def all_checks() -> tuple[Check, ...]:
    """All checks in the order of the report; a file that cannot be imported is one that fails."""
    found = []
    for module in pkgutil.iter_modules(package.__path__):
        try:
            importlib.import_module(f"{package.__name__}.{module.name}")
        except Exception as error:
            found.append(Check(module.name, module.name.capitalize(), 1000, _failing(error)))
    return tuple(sorted([*found, *_CHECKS.values()], key=lambda one: one.order))


def examine(
    checks: Sequence[Check], context: Context, audience: Audience | None = None
) -> tuple[Checked, ...]:
    """Run checks one after another.

    A check that raises becomes a warning below what it found before.

    Args:
        checks: to run.
        context: for all of them.
        audience: is told meanwhile.
    """
    audience = audience or Silence()
    sections = []
    for one in checks:
        audience.begin(one)
        findings: list[Finding] = []
        for finding in _looked(one, context):
            findings.append(finding)
            audience.tell(finding)
        sections.append(Checked(one.key, one.title, tuple(findings)))
    return tuple(sections)


def _looked(one: Check, context: Context) -> Iterable[Finding]:
    try:
        yield from one.look(context)
    except Exception as error:  # whatever is wrong here, the rest of the report is still wanted
        text = " ".join(f"{type(error).__name__}: {error}".split())
        yield Finding(one.title.lower(), Mark.WARNING, f"could not be looked at: {text}")


def _failing(error: Exception) -> Look:
    def look(context: Context) -> Iterable[Finding]:
        raise error

    return look
