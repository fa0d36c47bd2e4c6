"""Robot files become descriptions, and all of them the classes that clients can ask for.

A robot file (TOML, in the wire frame) names one class, `P2AT.toml` the class P2AT. It may extend
another class and then says only what differs. Every key is described in docs/robot-files.md.
"""

from __future__ import annotations

import fnmatch
import functools
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from usarsim_server.base.errors import RobotDescriptionError, at
from usarsim_server.base.files import data_directory, is_folder
from usarsim_server.base.logs import Log
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import parse_toml, read_text, read_toml
from usarsim_server.protocol.values import LONGEST_NAME, Dialect, clean_name
from usarsim_server.robots import model_files
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import families, find_family
from usarsim_server.robots.reading import limbs, parts

_CLASS_NAME = re.compile(r"[A-Za-z0-9_-]+")
_FIRST_TABLE = re.compile(r"^[ \t]*\[", re.MULTILINE)
_log = Log("robots")

ParentFinder = Callable[[str], RobotDescription | None]


@dataclass(frozen=True, slots=True)
class RobotFile:
    """What one robot file says; `description` reads the robot itself where that is still to do."""

    source: Path  # the file
    name: str  # of the class
    describe: Callable[[], RobotDescription]
    aliases: tuple[str, ...] = ()
    """Further class names for it, which clients get back as they are spelled here."""
    alias_patterns: tuple[str, ...] = ()
    """Shell patterns of class names; clients get their own spelling back."""
    exact_aliases: tuple[str, ...] = ()
    """Further names that mean this robot only in exactly this spelling, whatever else they mean in
    another one."""

    @property
    def description(self) -> RobotDescription:
        """The robot itself.

        Raises:
            RobotDescriptionError: if the file, or one that it extends, cannot be used.
        """
        return self.describe()


def load_robot(path: Path) -> RobotDescription:
    """Load one robot file.

    What it extends is looked for beside it first, then among the shipped robots.

    Raises:
        RobotDescriptionError: if the file, or one that it extends, cannot be used.
    """
    shipped, folder = data_directory("robots"), path.parent
    folders = [shipped] if folder.resolve() == shipped.resolve() else [shipped, folder]
    return Library(folders).load(path, len(folders) - 1).description


class Library:
    """Folders of robot files, read on demand because files may extend each other.

    A class in a later folder replaces one of the same name in an earlier folder. Thread-safe.
    """

    def __init__(self, folders: Sequence[Path], *, allow_outside: bool = False) -> None:
        """List the folders, first the one with the lowest precedence.

        Args:
            folders: of robot files.
            allow_outside: model files may be read wherever they lie.

        Raises:
            RobotDescriptionError: if a folder is missing or two of its files differ by case only.
        """
        self._layers = [_files(folder) for folder in folders]
        self._allow_outside = allow_outside
        self._read: dict[Path, RobotFile] = {}
        self._reading: list[Path] = []
        self._lock = threading.RLock()

    def layers(self) -> list[list[RobotFile]]:
        """All files, folder by folder.

        Raises:
            RobotDescriptionError: if a file cannot be used.
        """
        return [
            [self.load(path, number) for path in layer.values()]
            for number, layer in enumerate(self._layers)
        ]

    def names(self) -> list[list[RobotFile]]:
        """All files, folder by folder, of which only the names are read; each is read as a whole
        when somebody asks what robot it describes.

        Raises:
            RobotDescriptionError: if a file cannot be read, or its names cannot be used.
        """
        return [
            [self._names(path, number) for path in layer.values()]
            for number, layer in enumerate(self._layers)
        ]

    def _names(self, path: Path, number: int) -> RobotFile:
        text = read_text(path, RobotDescriptionError)
        first = _FIRST_TABLE.search(text)
        try:
            # Names stand above the first table.
            head = parse_toml(text[: first.start()] if first else text, path, RobotDescriptionError)
        except RobotDescriptionError:
            return self.load(path, number)  # a list may have such a line, too
        return _robot_file(
            Table(head, path, RobotDescriptionError),
            path,
            lambda: self.load(path, number).description,
        )

    def replacements(self) -> list[Path]:
        """Files whose class is also in a folder of lower precedence."""
        return [
            path
            for number, layer in enumerate(self._layers)
            for name, path in layer.items()
            if any(name in lower for lower in self._layers[:number])
        ]

    def load(self, path: Path, number: int) -> RobotFile:
        """Read a file of folder `number`, and before it whatever it extends.

        Raises:
            RobotDescriptionError: if one of the files cannot be used.
        """
        with self._lock:
            if path in self._reading:
                raise RobotDescriptionError(
                    at(path, "extends itself in a circle", "extend a class that stands on its own")
                )
            if path not in self._read:
                self._reading.append(path)
                try:
                    self._read[path] = _read(
                        path, lambda name: self._parent(path, number, name), self._allow_outside
                    )
                finally:
                    self._reading.remove(path)
            return self._read[path]

    def _parent(self, path: Path, number: int, name: str) -> RobotDescription | None:
        # A file that extends its own class means the one that it replaces.
        own = name.lower() == path.stem.lower()
        for below in reversed(range(number if own else len(self._layers))):
            parent = self._layers[below].get(name.lower())
            if parent is not None:
                return self.load(parent, below).description
        return None


def _files(folder: Path) -> dict[str, Path]:
    """Robot files of a folder by class name in lower case."""
    if not is_folder(folder):
        raise RobotDescriptionError(at(folder, "no such folder", "name a folder of robot files"))
    files: dict[str, Path] = {}
    for path in sorted(folder.glob("*.toml")):
        other = files.setdefault(path.stem.lower(), path)
        if other is not path:
            raise RobotDescriptionError(
                at(path, f"differs from {other.name} by case only", "rename one of them")
            )
    return files


def _read(path: Path, find_parent: ParentFinder, allow_outside: bool) -> RobotFile:
    reader = Table(read_toml(path, RobotDescriptionError, "wheel"), path, RobotDescriptionError)
    name = _class_name(reader, path)
    robot = _robot(reader, path, name, _parent(reader, find_parent), allow_outside)
    file = _robot_file(reader, path, lambda: robot)
    reader.finish()
    return file


def _robot_file(reader: Table, path: Path, describe: Callable[[], RobotDescription]) -> RobotFile:
    return RobotFile(
        path,
        _class_name(reader, path),
        describe,
        _class_names(reader, "aliases"),
        reader.texts("alias_patterns"),
        _class_names(reader, "exact_aliases"),
    )


def _class_name(reader: Table, path: Path) -> str:
    name = reader.text("name", path.stem)
    if not _CLASS_NAME.fullmatch(name):
        raise reader.error("name", f"is {name!r}", "use letters, digits, _ and - only")
    if name.lower() != path.stem.lower():
        raise reader.error("name", f"is {name!r}", f"call the file {name}.toml, or drop the key")
    return name


def _class_names(reader: Table, key: str) -> tuple[str, ...]:
    names = reader.texts(key)
    for name in names:
        if not _CLASS_NAME.fullmatch(name):
            raise reader.error(key, f"has {name!r}", "use letters, digits, _ and - only")
    return names


def _parent(reader: Table, find_parent: ParentFinder) -> RobotDescription | None:
    if not reader.has("extends"):
        return None
    name = reader.text("extends")
    parent = find_parent(name)
    if parent is None:
        raise reader.error(
            "extends", f"no robot class {name!r}", "extend a class that has a robot file"
        )
    return parent


def _robot(
    reader: Table,
    path: Path,
    name: str,
    parent: RobotDescription | None,
    allow_outside: bool,
) -> RobotDescription:
    dialects = [dialect.value for dialect in Dialect]
    kind = reader.choice("kind", families(), parent.kind if parent else None)
    family_type = find_family(kind)
    dialect = Dialect(reader.choice("dialect", dialects, parent.dialect.value if parent else None))
    if parent is not None and family_type.wheeled != parent.family.wheeled:
        raise reader.error("kind", f"is {kind}, {parent.name} is {parent.kind}", "drop it")
    body = model_files.read_body(reader, path.parent, dialect, allow_outside=allow_outside)
    actuators = limbs.read_actuators(reader, parent, dialect, body.actuators if body else ())
    wheels = parts.read_wheels(reader, family_type.wheeled, actuators, parent)
    casters = parts.read_casters(reader, parent)
    shapes = parts.read_shapes(reader, parent, body.shapes if body else ())
    parts.check_weight(reader, shapes, casters)
    drive = parts.read_drive(reader, wheels, parent)
    effectors = limbs.read_effectors(reader, parent, actuators, dialect)
    links = [link.body for actuator in actuators for link in actuator.links]
    carriers = [*(wheel.name for wheel in wheels), *links]
    mass = sum(piece.mass for piece in shapes) + sum(piece.mass for piece in casters)
    mass += sum(wheel.mass for wheel in wheels)
    mass += sum(link.mass for actuator in actuators for link in actuator.links)
    mass += sum(effector.mass for effector in effectors if not effector.detached)
    inherited = parent.family if parent is not None else None
    family = family_type.read(
        reader, inherited if isinstance(inherited, family_type) else None, wheels, actuators
    )
    announced = reader.table("report")
    read = RobotDescription(
        name=name,
        model=name,
        kind=kind,
        dialect=dialect,
        description=reader.text("description", parent.description if parent else ""),
        shapes=shapes,
        wheels=wheels,
        casters=casters,
        rest_height=parts.read_rest_height(
            reader, wheels, actuators, parent, family.support(actuators)
        ),
        drive=drive,
        battery=parts.read_battery(reader, parent),
        report=(
            parts.read_report(announced, wheels, actuators, mass, drive, parent, family)
            if wheels
            else parts.read_platform_report(announced, mass, parent)
        ),
        items=parts.read_items(reader, carriers, parent),
        source=path,
        actuators=actuators,
        effectors=effectors,
        cameras=limbs.read_cameras(reader, carriers, parent),
        family=family,
    )
    robot = family.finish(read)
    limbs.check_names(reader, _bodies(robot))
    if parent is not None and _body(robot) == _body(parent):
        return replace(robot, model=parent.model)
    return robot


def _body(robot: RobotDescription) -> tuple[object, ...]:
    """Everything that the physics depends on; robots equal in it are interchangeable there."""
    # The speed limit is kept by the drive law, outside the physics.
    drive = replace(robot.drive, max_wheel_speed=0.0)
    body = (robot.kind, robot.shapes, robot.wheels, robot.casters, robot.rest_height, drive)
    return *body, robot.actuators, robot.effectors, robot.family


def _bodies(robot: RobotDescription) -> Iterator[str]:
    """Names of all parts that have one."""
    yield from (wheel.name for wheel in robot.wheels)
    yield from (link.body for link in robot.links)
    yield from (effector.name for effector in robot.effectors)


class RobotCatalog:
    """Robot classes by the names that clients use; immutable once made, and thread-safe."""

    def __init__(self, layers: Sequence[Sequence[RobotFile]]) -> None:
        """Take robots in layers; a later layer has precedence over an earlier one.

        Aliases outlive the file that says them: they mean the newest robot of that class.

        Raises:
            RobotDescriptionError: if two robots of one layer claim the same name.
        """
        classes: dict[str, RobotFile] = {}
        names: dict[str, tuple[str, str]] = {}
        patterns: list[tuple[str, str]] = []
        for layer in layers:
            classes.update((file.name.lower(), file) for file in layer)
            names.update(_claims(layer))
            # Newest first, because the first pattern that matches wins.
            patterns[:0] = [
                (pattern.lower(), file.name.lower())
                for file in layer
                for pattern in file.alias_patterns
            ]
        self._classes = tuple(classes[name] for name in sorted(classes))
        self._names = {key: (name, classes[class_]) for key, (name, class_) in names.items()}
        self._exact = {
            name: (name, classes[class_name])
            for layer in layers
            for name, class_name in _exact_claims(layer).items()
        }
        self._patterns = [(pattern, classes[class_name]) for pattern, class_name in patterns]
        self._named = functools.cache(_named)

    def find(self, class_name: str) -> RobotDescription | None:
        """The robot that a client means, None if there is none.

        Args:
            class_name: as sent; a package before the last point does not matter, nor, as a rule,
                does case.

        Returns:
            The robot under its own name, under the name of the alias, or, if a pattern matched,
            under the client's own spelling, which may hold letters, digits, `_` and `-` only.

        Raises:
            RobotDescriptionError: if its file was not read yet and cannot be used.
        """
        wanted = class_name.strip().rpartition(".")[2]
        found = self._exact.get(wanted) or self._names.get(wanted.lower())
        if found is not None:
            return self._named(*found)
        if len(wanted) > LONGEST_NAME or clean_name(wanted) != wanted:
            return None
        for pattern, robot in self._patterns:
            if fnmatch.fnmatchcase(wanted.lower(), pattern):
                return replace(robot.description, name=wanted)
        return None

    def names(self) -> tuple[str, ...]:
        """Names of all classes in alphabetical order, aliases left out."""
        return tuple(robot.name for robot in self._classes)

    def descriptions(self) -> tuple[RobotDescription, ...]:
        """All classes, in the order of `names`.

        Raises:
            RobotDescriptionError: if a file was not read yet and cannot be used.
        """
        return tuple(robot.description for robot in self._classes)


def _named(name: str, file: RobotFile) -> RobotDescription:
    return replace(file.description, name=name)


def load_catalog(extra: Sequence[Path] = (), *, allow_outside: bool = False) -> RobotCatalog:
    """Load the shipped robots and those of further folders.

    Of the shipped files alone only the names are read at first, which is a tenth of the work; with
    further folders all files are, as one of those may be wrong, or spoil a class that extends it.

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
    return RobotCatalog(library.layers() if extra else library.names())


def _claims(layer: Iterable[RobotFile]) -> dict[str, tuple[str, str]]:
    """Every name that the robots of a layer answer to: lower case to spelling and class."""
    names = ((file, name) for file in layer for name in (file.name, *file.aliases))
    return {
        key: (name, robot.name.lower())
        for key, (name, robot) in _unique(names, str.lower, "a name").items()
    }


def _exact_claims(layer: Iterable[RobotFile]) -> dict[str, str]:
    """The names of a layer that count in one spelling only, and their classes."""
    names = ((file, name) for file in layer for name in file.exact_aliases)
    claims = _unique(names, str, "an exact alias")
    return {name: robot.name.lower() for name, (_, robot) in claims.items()}


def _unique(
    names: Iterable[tuple[RobotFile, str]], key: Callable[[str], str], kind: str
) -> dict[str, tuple[str, RobotFile]]:
    """First spelling and robot by key; refuses names that two robots claim."""
    claims: dict[str, tuple[str, RobotFile]] = {}
    for robot, name in names:
        _, other = claims.setdefault(key(name), (name, robot))
        if other.source != robot.source:
            problem = f"{name!r} is also {kind} in {other.source}"
            raise RobotDescriptionError(at(robot.source, problem, "rename one of them"))
    return claims
