"""What a sweep runs: a TOML file with options of `usarsim serve`, commands, and parameters.

    seeds = 3
    [serve]
    world = "empty"
    lockstep = true
    [[controller]]
    command = ["{python}", "drive.py", "{port}", "--gain", "{gain}"]
    [grid]
    timestep = [0.002, 0.004]
    gain = [0.5, 1.0]

A parameter is an option of the server, or stands in braces in a command.
"""

from __future__ import annotations

import hashlib
import math
import random
import re
from collections.abc import Iterator, Mapping
from contextlib import chdir, suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from usarsim_batch.errors import BatchError
from usarsim_batch.tasks import Row
from usarsim_server.base.errors import UsarsimError, problem_and_advice
from usarsim_server.base.fields import field
from usarsim_server.base.files import read_regular
from usarsim_server.base.tables import Table, shown, suggest
from usarsim_server.base.toml import read_toml
from usarsim_server.options import OPTIONS, load_settings

MOST = 1_000_000
"""Runs of a sweep."""
PLACE = re.compile(r"\{(\w+)\}")
SERVICES = ("images", "groundtruth", "wireless", "truth", "comserver", "scene")
"""Names of further ports, as the READY line has them."""
GIVEN = ("host", "port", "seed", "robot", "out", "python", *(f"{one}_port" for one in SERVICES))
"""What may stand in braces in every command."""
_TAIL = 2000
"""Characters of a log."""
_BY_NAME = {option.key: option for option in OPTIONS if option.metavar is not None}
_PORTS = [option.key for option in OPTIONS if option.port]
_OPEN = {"port": 0, "image_port": 0, "groundtruth_port": 0, "wireless_port": 0, "truth_port": 0}
Value = str | int | float | bool
Point = dict[str, Value]


@dataclass(frozen=True)
class End:
    """When a run is over, if not all its controllers have ended before."""

    simulated: float | None = field(
        default=None, unit="s", above=0.0, high=1e6, help="time in the world"
    )
    wall: float | None = field(default=None, unit="s", above=0.0, high=1e6, help="wall time")


@dataclass(frozen=True)
class Controller:
    """A program that drives."""

    command: tuple[str, ...] = field(help="its words; what stands in braces is filled in")
    count: int = field(default=1, low=1, high=256, help="how many of it")


@dataclass(frozen=True, eq=False)
class SweepTask:
    """One run of a sweep.

    Attributes:
        key: its number. parameters, seed: what distinguishes it.
        options: of `usarsim serve`. commands: of controllers, with places in braces.
        folder: where commands run: that of the sweep's file. out: of the run's own files.
    """

    key: str
    parameters: Mapping[str, Value]
    seed: int
    options: tuple[str, ...]
    commands: tuple[tuple[str, ...], ...]
    end: End
    folder: Path
    out: Path

    def facts(self) -> Row:
        """How results name it."""
        return {"run": self.key, "parameters": dict(self.parameters), "seed": self.seed}

    def log(self) -> str:
        """The ends of what its programs said."""
        found = []
        for path in sorted(self.out.glob("*.log")):
            with suppress(OSError):
                with path.open("rb") as file:
                    file.seek(max(path.stat().st_size - _TAIL, 0))
                    text = file.read().decode(errors="replace").strip()
                found += [f"{path.stem}: {line}" for line in text.splitlines()]
        return "\n".join(found)[-_TAIL:]


@dataclass(frozen=True)
class Plan:
    """A sweep. content: of its file. points: of parameters, each run with each seed."""

    path: Path
    content: Mapping[str, object]
    serve: Mapping[str, object]
    controllers: tuple[Controller, ...]
    end: End
    points: tuple[Point, ...]
    seeds: tuple[int, ...]

    def resolved(self) -> dict[str, object]:
        """All that is run, with digests of the files that commands name."""
        files = {}
        for word in sorted({word for one in self.controllers for word in one.command}):
            with suppress(OSError, ValueError):
                digest = hashlib.sha256(read_regular(self.path.parent / word)).hexdigest()
                files[word] = digest
        return {**self.content, "files": files}

    def tasks(self, out: Path) -> list[SweepTask]:
        """All runs, each seed with everything before the next one.

        Args:
            out: folder of all files of runs.

        Raises:
            BatchError: options of a server that do not fit.
        """
        commands = tuple(one.command for one in self.controllers for _ in range(one.count))
        folder, out = self.path.parent.absolute(), out.absolute()
        found: list[SweepTask] = []
        with chdir(folder):
            for seed, point in product(self.seeds, self.points):
                key = f"{len(found) + 1:06}"
                options = self._options(point, seed)
                task = SweepTask(key, point, seed, options, commands, self.end, folder, out / key)
                found.append(task)
        return found

    def _options(self, point: Point, seed: int) -> tuple[str, ...]:
        """Of the server, checked."""
        own = {key: value for key, value in point.items() if key in _BY_NAME}
        scene = {"scene_port": 0} if self.end.simulated is not None else {}
        values = {**_OPEN, **scene, **self.serve, **own, "seed": seed}
        texts: dict[str, Any] = {
            key: [_text(one) for one in value] if isinstance(value, list) else _text(value)
            for key, value in values.items()
        }
        try:
            load_settings(texts)
        except UsarsimError as error:
            problem, cure = problem_and_advice(str(error))
            raise BatchError(f"{self.path}: [serve]: {problem} ({cure})") from None
        return tuple(
            f"{_BY_NAME[key].flag}={one}"
            for key, value in texts.items()
            for one in (value if isinstance(value, list) else [value])
        )


def read_plan(path: Path) -> Plan:
    """The sweep of a file.

    Raises:
        BatchError: naming the file, what is wrong, and the cure.
    """
    content = read_toml(path, BatchError, "controller")
    table = Table(content, path, BatchError)
    table.text("title", "")
    serve = dict(table.free("serve"))
    inner = Table(serve, path, BatchError, "[serve]")
    for key, value in serve.items():
        _check_option(inner, key, value)
    controllers = table.all("controller", Controller)
    if not controllers:
        raise table.error("controller", "is missing", "add [[controller]] with a command")
    end = table.one("end", End)
    seeds = _seeds(table)
    points = tuple(
        {**one, **other, **third} for one, other, third in product(
            _grid(table), _listed(table), list(_random(table)))
    )  # fmt: skip
    table.finish()
    if len(points) * len(seeds) > MOST:
        cure = f"make it at most {MOST}"
        raise table.error("", f"{len(points) * len(seeds)} runs are too many", cure)
    _check_places(table, controllers, set().union(*points))
    return Plan(path, content, serve, controllers, end, points, seeds)


def _check_places(table: Table, controllers: tuple[Controller, ...], names: set[str]) -> None:
    """Every parameter is for something, and nothing in braces is left."""
    asked = {one for each in controllers for word in each.command for one in PLACE.findall(word)}
    for name in sorted(asked - names - {*GIVEN}):
        cure = f"known are {', '.join(sorted({*GIVEN, *names}))}"
        raise table.error("controller", f"nothing is called {{{name}}}", cure)
    for name in sorted(names - asked - {*_BY_NAME}):
        cure = f"{suggest(name, [*_BY_NAME])} Or write {{{name}}} in a command"
        raise table.error(name, "is no option of `usarsim serve`, and in no command", cure)


def _check_option(table: Table, key: str, value: object) -> None:
    if key in ("host", "seed"):
        raise table.error(key, "is not for a sweep to say", "leave it out; see seeds")
    if key not in _BY_NAME:
        raise table.error(key, "is no option of `usarsim serve`", suggest(key, [*_BY_NAME]))
    if key in _PORTS and value not in (0, "off"):
        raise table.error(key, "ports come from the system", 'write 0 or "off"')
    if isinstance(value, Mapping):
        raise table.wrong(key, value, "a value", "the path of a file with it")


def _seeds(table: Table) -> tuple[int, ...]:
    value = table.raw("seeds") if table.has("seeds") else 1
    if isinstance(value, list) and value and all(type(one) is int for one in value):
        if len(set(value)) < len(value):
            raise table.error("seeds", "a seed is there twice", "write each once")
        return tuple(value)
    return tuple(range(1, table.count("seeds", 1, low=1, high=MOST) + 1))


def _grid(table: Table) -> list[Point]:
    inner = table.table("grid")
    found: list[Point] = [{}]
    for key, values in table.free("grid").items():
        if not isinstance(values, list) or not values:
            raise inner.wrong(key, values, "a list with at least one value")
        for value in values:
            _check_value(inner, key, value)
        found = [{**point, key: value} for point in found for value in values]
        if len(found) > MOST:
            raise inner.error(key, "makes too many runs", f"make it at most {MOST}")
    return found


def _listed(table: Table) -> list[Point]:
    found: list[Point] = []
    for inner in table.tables("list"):
        point: dict[str, Any] = inner.rest()
        for key, value in point.items():
            _check_value(inner, key, value)
        found.append(point)
    return found or [{}]


def _random(table: Table) -> Iterator[Point]:
    """Draws of all parameters of `[random.of]`: of a range, or among values."""
    if not table.has("random"):
        yield {}
        return
    inner = table.table("random")
    count, seed = inner.count("count", low=1, high=MOST), inner.count("seed", 1, low=0, high=2**63)
    of = inner.table("of")
    draws: dict[str, tuple[Any, bool]] = {}
    for key in inner.free("of"):
        one = of.table(key)
        _check_value(of, key, 0)
        if one.has("among"):
            among = one.raw("among")
            if not isinstance(among, list) or not among:
                raise one.wrong("among", among, "a list with at least one value")
            draws[key] = (among, False)
        else:
            low, log = one.number("low"), one.flag("log", False)
            high = one.number("high", low=low)
            if log and low <= 0:
                raise one.error("low", f"{shown(low)} has no logarithm", "write more than 0")
            draws[key] = ((low, high), log)
        one.finish()
    inner.finish()
    generator = random.Random(seed)
    for _ in range(count):
        yield {key: _drawn(generator, values, log) for key, (values, log) in draws.items()}


def _drawn(generator: random.Random, values: Any, log: bool) -> Value:
    if isinstance(values, list):
        chosen: Value = generator.choice(values)
        return chosen
    low, high = values
    if log:
        return math.exp(generator.uniform(math.log(low), math.log(high)))
    return generator.uniform(low, high)


def _check_value(table: Table, key: str, value: object) -> None:
    if key in GIVEN or key in _PORTS:
        raise table.error(key, "is not for a sweep to say", "call it something else; see seeds")
    if not re.fullmatch(r"\w+", key):
        raise table.error(key, "is no name", "use letters, digits and _")
    if not isinstance(value, str | int | float):
        raise table.wrong(key, value, "a text, a number or a truth")


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
