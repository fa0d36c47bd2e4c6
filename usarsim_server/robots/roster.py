"""All robot classes that clients can ask for."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from usarsim_server.data import data_directory
from usarsim_server.errors import RobotDescriptionError, at
from usarsim_server.logs import Log
from usarsim_server.protocol.names import LONGEST_NAME, clean_name
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.loader import Library, RobotFile

__all__ = ["Roster", "load_roster"]

_log = Log("robots")


class Roster:
    """Robot classes by the names that clients use; immutable once made."""

    def __init__(self, layers: Sequence[Sequence[RobotFile]]) -> None:
        """Take robots in layers; a later layer has precedence over an earlier one.

        Aliases outlive the file that says them: they mean the newest robot of that class.

        Raises:
            RobotDescriptionError: if two robots of one layer claim the same name.
        """
        classes: dict[str, RobotDescription] = {}
        names: dict[str, tuple[str, str]] = {}
        patterns: list[tuple[str, str]] = []
        for layer in layers:
            classes.update((file.description.name.lower(), file.description) for file in layer)
            names.update(_claims(layer))
            # Newest first, because the first pattern that matches wins.
            patterns[:0] = [
                (pattern.lower(), file.description.name.lower())
                for file in layer
                for pattern in file.alias_patterns
            ]
        self._classes = tuple(classes[name] for name in sorted(classes))
        self._names = {
            key: replace(classes[class_name], name=name)
            for key, (name, class_name) in names.items()
        }
        self._exact = {
            name: replace(classes[class_name], name=name)
            for layer in layers
            for name, class_name in _exact_claims(layer).items()
        }
        self._patterns = [(pattern, classes[class_name]) for pattern, class_name in patterns]

    def find(self, class_name: str) -> RobotDescription | None:
        """The robot that a client means, None if there is none.

        Args:
            class_name: as sent; a package before the last point does not matter, nor, as a rule,
                does case.

        Returns:
            The robot under its own name, under the name of the alias, or, if a pattern matched,
            under the client's own spelling, which has to be a name (see `protocol.names`).
        """
        wanted = class_name.strip().rpartition(".")[2]
        found = self._exact.get(wanted) or self._names.get(wanted.lower())
        if found is not None:
            return found
        if len(wanted) > LONGEST_NAME or clean_name(wanted) != wanted:
            return None
        for pattern, robot in self._patterns:
            if fnmatch.fnmatchcase(wanted.lower(), pattern):
                return replace(robot, name=wanted)
        return None

    def names(self) -> tuple[str, ...]:
        """Names of all classes in alphabetical order, aliases left out."""
        return tuple(robot.name for robot in self._classes)

    def descriptions(self) -> tuple[RobotDescription, ...]:
        """All classes, in the order of `names`."""
        return self._classes


def load_roster(extra: Sequence[Path] = (), *, allow_outside: bool = False) -> Roster:
    """Load the shipped robots and those of further folders.

    Args:
        extra: folders of robot files; a class in a later folder replaces one of the same name in
            an earlier folder and the shipped one, and may extend what it replaces.
        allow_outside: model files may be read wherever they lie.

    Raises:
        RobotDescriptionError: if a folder is missing or a file cannot be used.
    """
    library = Library([data_directory("robots"), *extra], allow_outside=allow_outside)
    for path in library.replacements():
        _log.info("robot class is replaced", name=path.stem, by=path)
    return Roster(library.layers())


def _claims(layer: Iterable[RobotFile]) -> dict[str, tuple[str, str]]:
    """Every name that the robots of a layer answer to: lower case to spelling and class."""
    claims: dict[str, tuple[str, str]] = {}
    sources: dict[str, Path] = {}
    for file in layer:
        robot = file.description
        for name in (robot.name, *file.aliases):
            other = sources.setdefault(name.lower(), robot.source)
            if other != robot.source:
                raise RobotDescriptionError(
                    at(robot.source, f"{name!r} is also a name in {other}", "rename one of them")
                )
            claims.setdefault(name.lower(), (name, robot.name.lower()))
    return claims


def _exact_claims(layer: Iterable[RobotFile]) -> dict[str, str]:
    """The names of a layer that count in one spelling only, and their classes."""
    claims: dict[str, str] = {}
    sources: dict[str, Path] = {}
    for file in layer:
        robot = file.description
        for name in file.exact_aliases:
            other = sources.setdefault(name, robot.source)
            if other != robot.source:
                problem = f"{name!r} is also an exact alias in {other}"
                raise RobotDescriptionError(at(robot.source, problem, "rename one of them"))
            claims[name] = robot.name.lower()
    return claims
