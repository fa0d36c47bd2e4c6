"""Which sensor types exist, and how one of them is made from a line of a robot file.

Built-in types are found by importing every module of this package, so a new file is enough.
Outside packages announce a class or a module in the entry point group `usarsim_server.sensors`;
the name of the entry point should be the type.
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

import usarsim_server.sensors as package
from usarsim_server.errors import RobotDescriptionError, at
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext

__all__ = ["GROUP", "create_sensor", "register", "sensor_types"]

GROUP = "usarsim_server.sensors"
"""Entry point group for sensor types of other packages."""

SensorClass = TypeVar("SensorClass", bound=type[Sensor])

_log = logging.getLogger(__name__)
_lock = threading.RLock()
_types: dict[str, tuple[str, type[Sensor]]] = {}
_broken: dict[str, str] = {}
_discovered = False


def register(*names: str) -> Callable[[SensorClass], SensorClass]:
    """Class decorator: make a sensor available under these types of a robot file.

    Names are compared without case; the spelling given here is the one shown to users.

    Raises:
        ValueError: a name is taken by another class.
    """

    def enter(cls: SensorClass) -> SensorClass:
        for name in names:
            _enter(name, cls)
        return cls

    return enter


def create_sensor(item: ItemDescription, context: SensorContext) -> Sensor:
    """Make the sensor that a robot file asks for.

    Raises:
        RobotDescriptionError: the type is unknown, or a parameter is unknown or ill-typed.
    """
    sensor = _class_of(item)(item, context)
    sensor.parameters.finish()
    return sensor


def sensor_types() -> list[str]:
    """All types a robot file may name, sorted, aliases included."""
    _discover()
    return sorted((name for name, _ in _types.values()), key=str.lower)


def _enter(name: str, cls: type[Sensor]) -> None:
    with _lock:
        taken = _types.get(name.lower())
        if taken is not None and taken[1] is not cls:
            owner = f"{taken[1].__module__}.{taken[1].__qualname__}"
            raise ValueError(f"sensor type {name!r} is already registered by {owner}")
        _types[name.lower()] = (name, cls)


def _class_of(item: ItemDescription) -> type[Sensor]:
    _discover()
    found = _types.get(item.type.strip().lower())
    if found is not None:
        return found[1]
    place = item.where or f"sensor {item.name}"
    if item.type.lower() in _broken:
        problem = f"the package that provides {item.type!r} failed to load"
        raise RobotDescriptionError(at(place, problem, _broken[item.type.lower()], where="type"))
    near = difflib.get_close_matches(item.type.strip().lower(), _types, n=1, cutoff=0.5)
    hint = f"did you mean {_types[near[0]][0]}? " if near else ""
    cure = f"{hint}known types: {', '.join(sensor_types())}"
    problem = f"unknown sensor type {item.type!r}"
    raise RobotDescriptionError(at(place, problem, cure, where="type"))


def _discover() -> None:
    global _discovered
    with _lock:
        if _discovered:
            return
        _discovered = True
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{package.__name__}.{module.name}")
        _load_entry_points()


def _load_entry_points() -> None:
    """One broken outside package must not keep the server from starting: log it and go on."""
    for point in entry_points(group=GROUP):
        try:
            loaded = point.load()
            if isinstance(loaded, type) and issubclass(loaded, Sensor):
                _enter(point.name, loaded)
        except Exception as error:
            _broken[point.name.lower()] = f"{point.value}: {error}"
            _log.warning("sensor type %s (%s) is not usable: %s", point.name, point.value, error)
