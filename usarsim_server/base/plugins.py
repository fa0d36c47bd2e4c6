"""Classes that register themselves by type name: how sensors, effectors and the like are found.

Built-in types are found by importing every module of their packages, so a new file is enough.
Outside packages announce a class or a module in an entry point group; the name of the entry point
should be the type.
"""

from __future__ import annotations

import difflib
import errno
import importlib
import os
import pkgutil
import threading
from collections.abc import Callable, Iterable
from importlib.metadata import entry_points
from typing import Generic, TypeVar

from usarsim_server.base.errors import RobotDescriptionError, at
from usarsim_server.base.logs import Log

T = TypeVar("T")
C = TypeVar("C", bound=type)

_DESCRIPTORS = 8
"""That imports need at once: a file, its folder, its compiled form; and some for other threads."""

_log = Log("plugins")


class PluginTypes(Generic[T]):
    """The types of one kind of plug-in; names are compared without case. Thread-safe."""

    def __init__(self, kind: str, base: type, packages: Iterable[str], group: str) -> None:
        """Start empty; nothing is imported before the first question.

        Args:
            kind: what users call it, for example `sensor`.
            base: class that all of them derive from (abstract as a rule, hence not `type[T]`).
            packages: names of those that hold the built-in ones.
            group: entry point group of outside packages.
        """
        self._kind = kind
        self._base = base
        self._packages = tuple(packages)
        self._group = group
        self._lock = threading.RLock()
        self._types: dict[str, tuple[str, type[T]]] = {}
        self._broken: dict[str, str] = {}
        self._discovered = False

    def register(self, *names: str) -> Callable[[C], C]:
        """Class decorator: make a class available under these names, spelt so for users.

        Raises:
            ValueError: a name is taken by another class.
        """

        def enter(cls: C) -> C:
            for name in names:
                self._enter(name, cls)
            return cls

        return enter

    def names(self) -> list[str]:
        """All types a robot file may name, sorted, aliases included."""
        self._discover()
        return sorted((name for name, _ in self._types.values()), key=str.lower)

    def find(self, wanted: str, place: str) -> type[T]:
        """The class of a type name.

        Args:
            wanted: as the robot file spells it.
            place: where it stands, for the error.

        Raises:
            RobotDescriptionError: there is none, or the package that brings it failed to load.
        """
        self._discover()
        key = wanted.strip().lower()
        found = self._types.get(key)
        if found is not None:
            return found[1]
        if key in self._broken:
            problem = f"the package that provides {wanted!r} failed to load"
            raise RobotDescriptionError(at(place, problem, self._broken[key], where="type"))
        near = difflib.get_close_matches(key, self._types, n=1, cutoff=0.5)
        hint = f"did you mean {self._types[near[0]][0]}? " if near else ""
        cure = f"{hint}known types: {', '.join(self.names())}"
        problem = f"unknown {self._kind} type {wanted!r}"
        raise RobotDescriptionError(at(place, problem, cure, where="type"))

    def _enter(self, name: str, cls: type) -> None:
        with self._lock:
            taken = self._types.get(name.lower())
            # A module whose import failed half-way makes its classes once more when it is retried.
            if taken is not None and _address(taken[1]) != _address(cls):
                owner = _address(taken[1])
                raise ValueError(f"{self._kind} type {name!r} is already registered by {owner}")
            self._types[name.lower()] = (name, cls)

    def _discover(self) -> None:
        with self._lock:
            if self._discovered:
                return
            self._discovered = True  # modules that are being imported may ask for names
            try:
                _check_descriptors()
                for package in self._packages:
                    folders = importlib.import_module(package).__path__
                    for module in pkgutil.iter_modules(folders, f"{package}."):
                        importlib.import_module(module.name)
                self._load_entry_points()
            except BaseException as error:
                self._discovered = False
                importlib.invalidate_caches()
                if not isinstance(error, OSError):
                    raise
                problem = f"the {self._kind} types cannot be looked for: {error.strerror}"
                cure = "end other programs, or allow more with `ulimit -n`"
                raise RobotDescriptionError(at(self._packages[0], problem, cure)) from error

    def _load_entry_points(self) -> None:
        """One broken outside package must not keep the server from starting: log it and go on."""
        for point in entry_points(group=self._group):
            try:
                loaded = point.load()
                if isinstance(loaded, type) and issubclass(loaded, self._base):
                    self._enter(point.name, loaded)
            except Exception as error:
                if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
                    raise  # not the package's fault, and perhaps over by the next question
                self._broken[point.name.lower()] = f"{point.value}: {error}"
                _log.warning(
                    f"{self._kind} type {point.name} ({point.value}) is not usable: {error}"
                )


def _address(cls: type) -> str:
    return f"{cls.__module__}.{cls.__qualname__}"


def _check_descriptors() -> None:
    """Refuse to look around while files can hardly be opened.

    Python takes a folder that it cannot open for an empty one, and remembers that.

    Raises:
        OSError: there are too few descriptors.
    """
    found: list[int] = []
    try:
        for _ in range(_DESCRIPTORS):
            found.append(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC))
    finally:
        for descriptor in found:
            os.close(descriptor)
