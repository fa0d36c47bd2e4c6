"""What the small server of the control port can get wrong, and which check is meant to notice."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from usarsim_conformance.mutants.control_server import Session

Pairs = list[tuple[str, str]]
"""Segments: names and values."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A server with one fault.

    Attributes:
        kind: what serves its connections.
        check: identifier of the check that is meant to notice.
        dialect: to judge it in; empty for all that it speaks.
    """

    kind: type[Session]
    check: str
    dialect: str


_FAULTS: dict[str, Fault] = {}


def fault(check: str, dialect: str = "ut2004") -> Callable[[type[Session]], type[Session]]:
    """Make a class a fault, known by its name; see `Fault`."""

    def enter(kind: type[Session]) -> type[Session]:
        _FAULTS[kind.__name__] = Fault(kind, check, dialect)
        return kind

    return enter


def all_faults() -> Mapping[str, Fault]:
    """Every fault of the files `control_faults_*.py` beside this one, by name."""
    import usarsim_conformance.mutants as package

    for entry in pkgutil.iter_modules(package.__path__):
        if entry.name.startswith("control_faults_"):
            importlib.import_module(f"{package.__name__}.{entry.name}")
    return dict(_FAULTS)
