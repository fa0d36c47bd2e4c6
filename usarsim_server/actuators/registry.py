"""Which effector types exist, and how one of them is made from a table of a robot file.

Built-in types are found by importing every module of this package, so a new file is enough.
Outside packages announce a class in the entry point group `usarsim_server.effectors`; the name of
the entry point should be the type.
"""

from __future__ import annotations

import difflib
import importlib
import logging
import pkgutil
import threading
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import TypeVar

import usarsim_server.actuators as package
from usarsim_server.actuators.effector import Effector
from usarsim_server.errors import RobotDescriptionError, at
from usarsim_server.robots.description import EffectorDescription, RobotDescription

__all__ = ["GROUP", "create_effector", "create_effectors", "effector_types", "register_effector"]

GROUP = "usarsim_server.effectors"
"""Entry point group for effector types of other packages."""

EffectorClass = TypeVar("EffectorClass", bound=type[Effector])

_log = logging.getLogger(__name__)
_lock = threading.RLock()
_types: dict[str, tuple[str, type[Effector]]] = {}
_discovered = False


def register_effector(*names: str) -> Callable[[EffectorClass], EffectorClass]:
    """Class decorator: make an effector available under these types of a robot file.

    Names are compared without case; the spelling given here is the one shown to users.

    Raises:
        ValueError: a name is taken by another class.
    """

    def enter(cls: EffectorClass) -> EffectorClass:
        for name in names:
            _enter(name, cls)
        return cls

    return enter


def create_effector(description: EffectorDescription, robot: RobotDescription) -> Effector:
    """Make the effector that a robot file asks for.

    Raises:
        RobotDescriptionError: the type is unknown, or a parameter is unknown or ill-typed.
    """
    effector = _class_of(description)(description, robot)
    effector.parameters.finish()
    return effector


def create_effectors(robot: RobotDescription) -> tuple[Effector, ...]:
    """Make all effectors of a robot, in the order of its file.

    Raises:
        RobotDescriptionError: see `create_effector`.
    """
    return tuple(create_effector(description, robot) for description in robot.effectors)


def effector_types() -> list[str]:
    """All types a robot file may name, sorted."""
    _discover()
    return sorted((name for name, _ in _types.values()), key=str.lower)


def _enter(name: str, cls: type[Effector]) -> None:
    with _lock:
        taken = _types.get(name.lower())
        if taken is not None and taken[1] is not cls:
            owner = f"{taken[1].__module__}.{taken[1].__qualname__}"
            raise ValueError(f"effector type {name!r} is already registered by {owner}")
        _types[name.lower()] = (name, cls)


def _class_of(description: EffectorDescription) -> type[Effector]:
    _discover()
    item = description.item
    found = _types.get(item.type.strip().lower())
    if found is not None:
        return found[1]
    near = difflib.get_close_matches(item.type.strip().lower(), _types, n=1, cutoff=0.5)
    hint = f"did you mean {_types[near[0]][0]}? " if near else ""
    cure = f"{hint}known types: {', '.join(effector_types())}"
    place = item.where or f"effector {item.name}"
    raise RobotDescriptionError(
        at(place, f"unknown effector type {item.type!r}", cure, where="type")
    )


def _discover() -> None:
    global _discovered
    with _lock:
        if _discovered:
            return
        _discovered = True
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{package.__name__}.{module.name}")
        for point in entry_points(group=GROUP):
            # One broken outside package must not keep the server from starting.
            try:
                loaded = point.load()
                if isinstance(loaded, type) and issubclass(loaded, Effector):
                    _enter(point.name, loaded)
            except Exception as error:
                _log.warning("effector type %s (%s) failed: %s", point.name, point.value, error)
