"""What a planted fault is, and how all are found."""

from __future__ import annotations

import fnmatch
import importlib
import pkgutil
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_NAME = re.compile(r"[a-z0-9]+(\.[a-z0-9-]+)+")


@dataclass(frozen=True, slots=True)
class Edit:
    """One change of a file."""

    file: str  # path from the folder that holds `usarsim_server`, `robots` and `worlds`
    old: str  # text that stands there exactly once
    new: str  # what is put in its place


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One wrong number or sign."""

    name: str  # words joined by points, the area first: `sensors.gps.north-halved`
    edits: tuple[Edit, ...]  # of the server's files
    notices: tuple[str, ...]  # identifiers of the checks that have to fail, every one
    field: str  # pattern that their message fits, the name of the field that is wrong
    robot: str  # class that the checks take
    dialect: str | None  # to judge in; None for all that the server speaks
    options: tuple[str, ...]  # further ones of `usarsim serve`


_FAULTS: dict[str, Fault] = {}


def plant(
    name: str,
    file: str,
    old: str,
    new: str,
    *,
    notices: str | Sequence[str],
    field: str,
    also: Iterable[tuple[str, str, str]] = (),
    robot: str = "P2AT",
    dialect: str | None = "ut2004",
    options: Sequence[str] = (),
) -> None:
    """Enter a fault; see `Fault`.

    Args:
        name: of the fault.
        file: of its only, or first, edit.
        old: text there.
        new: text in its place.
        notices: the check, or the checks, that have to notice.
        field: as a regular expression.
        also: further edits: file, old text, new text.
        robot: class.
        dialect: one is enough for most, and faster.
        options: of the server.

    Raises:
        ValueError: if the name is taken or malformed.
    """
    if not _NAME.fullmatch(name) or name in _FAULTS:
        raise ValueError(f"{name!r} is taken, or no name of a fault like sensors.gps.noise")
    _FAULTS[name] = Fault(
        name=name,
        edits=(Edit(file, old, new), *(Edit(*one) for one in also)),
        notices=(notices,) if isinstance(notices, str) else tuple(notices),
        field=field,
        robot=robot,
        dialect=dialect,
        options=tuple(options),
    )


def all_faults() -> tuple[Fault, ...]:
    """Every fault of the files `faults_*.py` beside this one, in their order."""
    import usarsim_conformance.planted as package

    for entry in pkgutil.iter_modules(package.__path__):
        if entry.name.startswith("faults_"):
            importlib.import_module(f"{package.__name__}.{entry.name}")
    return tuple(_FAULTS.values())


def select_faults(faults: Iterable[Fault], pattern: str) -> tuple[Fault, ...]:
    """Those whose name a pattern fits; patterns as in `registry.select`."""
    words = [word.strip() for word in pattern.split(",") if word.strip()]
    globs = [word if any(sign in word for sign in "*?[") else f"*{word}*" for word in words]
    return tuple(
        one for one in faults if any(fnmatch.fnmatchcase(one.name, glob) for glob in globs)
    )
