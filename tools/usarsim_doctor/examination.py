"""Runs all checks, so that none spoils the report of the others."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from usarsim_doctor import checks as package
from usarsim_doctor import registry
from usarsim_doctor.isolation import attempt
from usarsim_doctor.registry import Check, Context, Finding, Look, Mark

TIMEOUT = 60.0
"""s of wall time for a check in a process of its own."""


@dataclass(frozen=True, slots=True)
class Checked:
    """What one check found."""

    key: str  # of the check
    title: str  # for readers
    findings: tuple[Finding, ...]  # in the order of the report


class Audience:
    """Who is told of findings as they come; this one only wants the result."""

    def begin(self, check: Check) -> None:
        """A check begins."""

    def tell(self, finding: Finding) -> None:
        """The check that has begun found something."""


def all_checks() -> tuple[Check, ...]:
    """All checks in the order of the report; a file that cannot be imported is one that fails."""
    found = []
    for module in pkgutil.iter_modules(package.__path__):
        try:
            importlib.import_module(f"{package.__name__}.{module.name}")
        except Exception as error:
            found.append(Check(module.name, module.name.capitalize(), 1000, _failing(error)))
    return tuple(sorted([*found, *registry.CHECKS.values()], key=lambda one: one.order))


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
    audience = audience or Audience()
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
        yield from _apart(one, context) if one.apart else one.look(context)
    except Exception as error:  # whatever is wrong here, the rest of the report is still wanted
        text = " ".join(f"{type(error).__name__}: {error}".split())
        yield Finding(one.title.lower(), Mark.WARNING, f"could not be looked at: {text}")


def _apart(one: Check, context: Context) -> Iterable[Finding]:
    """Findings of a check that another process runs."""
    name = f"findings:{one.key}"
    outcome = attempt([name], context.settings, TIMEOUT)[name]
    if outcome.failure is not None:
        text = f"could not be looked at: {outcome.failure}"
        yield Finding(one.title.lower(), Mark.WARNING, text, advice=outcome.advice)
    for found in outcome.values.get("findings", ()):
        yield Finding(**{**found, "mark": Mark(found["mark"])})


def _failing(error: Exception) -> Look:
    def look(context: Context) -> Iterable[Finding]:
        raise error

    return look
