"""Decorators for the checks of each side channel, with what all of them have in common."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from usarsim_conformance.registry import ONCE, Function, check
from usarsim_conformance.verdicts import Severity

Decorator = Callable[[Function], Function]


def checks_of(
    service: str, *, reference: str = "side channels reference"
) -> Callable[..., Decorator]:
    """A decorator like `registry.check` for one side channel.

    Dialects play no part there, so every check runs once.

    Args:
        service: the channel; the identifiers begin with it.
        reference: where the numbers of sources are found.
    """
    return partial(_check, service, reference)


def _check(
    service: str,
    reference: str,
    id: str,
    title: str,
    source: str,
    severity: Severity = Severity.MUST,
    *,
    exclusive: bool = False,
) -> Decorator:
    return check(
        f"{service}.{id}",
        title,
        source=f"{reference} {source}",
        severity=severity,
        dialects=ONCE,
        service=service,
        exclusive=exclusive,
    )
