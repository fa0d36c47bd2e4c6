"""A batch: environments, teams, strategies, radio models and seeds, each with each, in a TOML file.

    environments = ["office", "mine"]
    teams = [1, 4, { label = "slow", robots = 4, speed = 3 }]
    strategies = ["frontier", { label = "ratio 0.5", name = "ratio", target = 0.5 }]
    radios = ["circle", "path-loss"]
    seeds = 20
    [end]
    steps = 1000

The tables of a scenario say what all runs have in common. Those that come along are `SUITES`.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from usarsim_exploration import scenario
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.scenario import Content, Scenario
from usarsim_exploration.teams import Team
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.fields import Parse, field, keys
from usarsim_server.base.files import read_regular
from usarsim_server.base.tables import Table, shown, suggest
from usarsim_server.base.toml import read_toml

MOST = 1_000_000
"""Runs of a batch."""
SHIPPED = Path(__file__).parent / "suites"
SUITES = {path.stem: path for path in sorted(SHIPPED.glob("*.toml"))}
"""Batches that come along, by name."""
_COMMON = (
    "links",
    "backend",
    "rules",
    "mresim",
    "discs",
    "physics",
    "environment",
    "team",
    "radio",
    "strategy",
    "end",
    "robot",
    "event",
)
"""Keys of a scenario that hold for all runs."""
_LABEL = re.compile(r"[^/,\s]([^/,]*[^/,\s])?")


@dataclass(frozen=True)
class Entry:
    """One of a list. label: in results. keys: of its table of a scenario.

    Attributes:
        digest: SHA-256 of the environment, or of the file that is named; empty: not known yet.
    """

    label: str
    keys: Mapping[str, object]
    digest: str = ""


def _entries(main: str) -> Parse:
    """Reads a list of values of the main key of a table, or of whole tables."""

    def read(table: Any, key: str) -> tuple[Entry, ...]:
        values = table.raw(key)
        if not isinstance(values, list) or not values:
            raise table.wrong(key, values, "a list with at least one entry")
        found = [_entry(table, f"{key} {n}", main, value) for n, value in enumerate(values, 1)]
        labels = [one.label for one in found]
        for label in labels:
            if labels.count(label) > 1:
                cure = 'give each a label of its own, as in { label = "slow", ... }'
                raise table.error(key, f"two are called {label!r}", cure)
        return tuple(found)

    return read


def _entry(table: Table, place: str, main: str, value: object) -> Entry:
    plain = isinstance(value, str | int) and not isinstance(value, bool)
    if not isinstance(value, Mapping) and not plain:
        raise table.error(place, f"{shown(value)} is no entry", "write a name, or { key = value }")
    content = dict(value) if isinstance(value, Mapping) else {main: value}
    inner = Table(content, table.path, ExplorationError, place)
    name = Path(str(content.get(main, content.get("generator", "")))).name
    label = inner.text("label", name or None)
    if not _LABEL.fullmatch(label):
        raise inner.error("label", f"{label!r} cannot name files", "write it without / and commas")
    digest = inner.text("digest", "")
    return Entry(label, inner.rest(), digest)


def _seeds(table: Any, key: str) -> tuple[int, ...]:
    """The numbers 1 to n, or those of a list."""
    value = table.raw(key)
    if isinstance(value, list) and value:
        limits = next(one for one in keys(scenario.Basics) if one.key == "seed").limits
        found = tuple(table.check_count(key, one, limits) for one in value)
        if len(set(found)) < len(found):
            raise table.error(key, "a seed is there twice", "write each once")
        return found
    return tuple(range(1, table.count(key, low=1, high=MOST) + 1))


@dataclass(frozen=True)
class Lists:
    """Keys at the top of a batch file."""

    environments: tuple[Entry, ...] = field(
        parse=_entries("name"), expects='a list such as ["office", "mine"]',
        help="names, or tables with keys of `[environment]`",
    )  # fmt: skip
    title: str = field(default="", help="for people")
    teams: tuple[Entry, ...] = field(
        default=(Entry("4", {"robots": 4}),), shown="[4]", parse=_entries("robots"),
        expects="a list such as [1, 2, 4]",
        help="numbers of robots, or tables with keys of `[team]`",
    )  # fmt: skip
    strategies: tuple[Entry, ...] = field(
        default=(Entry("frontier", {"name": "frontier"}),), shown='["frontier"]',
        parse=_entries("name"), expects='a list such as ["frontier", "ratio"]',
        help="names, or tables with keys of `[strategy]`",
    )  # fmt: skip
    radios: tuple[Entry, ...] = field(
        default=(Entry("path-loss", {"model": "path-loss"}),), shown='["path-loss"]',
        parse=_entries("model"), expects='a list such as ["circle", "path-loss"]',
        help="models, or tables with keys of `[radio]`",
    )  # fmt: skip
    seeds: tuple[int, ...] = field(
        default=(1,), shown="1", parse=_seeds, expects="a whole number or a list of them",
        help="a number n stands for 1 to n",
    )  # fmt: skip


_TABLES = {
    "environments": "environment", "teams": "team", "strategies": "strategy", "radios": "radio",
}  # fmt: skip
"""Which table of a scenario a list is for."""


@dataclass(frozen=True, eq=False)
class Job:
    """One run of a batch. team: label, of which `robots` is the number.

    Attributes:
        content: the tables of its scenario. path: of the file beside which files lie, for errors.
    """

    environment: str
    robots: int
    team: str
    strategy: str
    radio: str
    seed: int
    content: Mapping[str, object]
    path: Path
    code: bool = True  # a strategy that stands in a file is run

    @property
    def key(self) -> str:
        """Names the run."""
        parts = self.environment, self.team, self.strategy, self.radio, str(self.seed)
        return "/".join(parts)

    @property
    def order(self) -> tuple[str, int, str, str, str, int]:
        """Its place in results."""
        return self.environment, self.robots, self.team, self.strategy, self.radio, self.seed

    def facts(self) -> dict[str, object]:
        """How results name it."""
        found: dict[str, object] = {"environment": self.environment, "robots": self.robots}
        if self.team != str(self.robots):
            found["team"] = self.team
        return found | {"strategy": self.strategy, "radio": self.radio, "seed": self.seed}

    def log(self) -> str:
        """It starts no programs."""
        return ""

    def scenario(self) -> Scenario:
        """What is run.

        Raises:
            UsarsimError: see `scenario.read`.
        """
        return scenario.read(self.content, self.path, code=self.code)


@dataclass(frozen=True)
class Batch:
    """All that a batch file says.

    Attributes:
        common: tables for all runs. path: of the file. code: strategies of files are run.
    """

    lists: Lists
    common: Mapping[str, object]
    path: Path
    code: bool = True

    def jobs(self) -> list[Job]:
        """All runs, each seed with everything before the next one."""
        one = self.lists
        each = product(one.seeds, one.environments, one.teams, one.radios, one.strategies)
        return [self._job(*choice) for choice in each]

    def resolved(self) -> Content:
        """The whole batch as tables that read as the same one, with digests of what it names.

        Raises:
            UsarsimError: something in it cannot be used, or is no longer what its digest says.
        """
        found: Content = {"title": self.lists.title}
        for name in _TABLES:
            rows = []
            for entry, job in self._each(name):
                digest = self._digest(name, entry, job)
                rows.append({"label": entry.label, **entry.keys} | digest)
            found[name] = rows
        end = self._first().scenario().resolved["end"]
        rules = {"rules": self._first().scenario().rules.number}
        return found | {"seeds": list(self.lists.seeds), **rules, **self.common, "end": end}

    def only(self, strategies: Sequence[str]) -> Batch:
        """The same with other strategies: labels of its own ones, or names."""
        own = {one.label: one for one in self.lists.strategies}
        table = Table({"--strategy": list(strategies)}, self.path, ExplorationError)
        chosen = _entries("name")(table, "--strategy")
        lists = replace(self.lists, strategies=tuple(own.get(one.label, one) for one in chosen))
        return replace(self, lists=lists)

    def _each(self, name: str) -> Iterator[tuple[Entry, Job]]:
        """The entries of a list, each with a run of it and the first ones of all others."""
        for entry in getattr(self.lists, name):
            only: dict[str, Any] = {name: (entry,)}
            yield entry, replace(self, lists=replace(self.lists, **only))._first()

    def _first(self) -> Job:
        one = self.lists
        return self._job(
            one.seeds[0], one.environments[0], one.teams[0], one.radios[0], one.strategies[0]
        )

    def _digest(self, name: str, entry: Entry, job: Job) -> dict[str, str]:
        """Of what an entry names, unless it comes along."""
        try:
            read = job.scenario()
        except UsarsimError as error:
            raise ExplorationError(self._blamed(str(error), name, entry)) from error
        file = entry.keys.get("file") if name == "radios" else None
        if name == "environments":
            digest = read.world.digest
        elif name == "strategies" and read.files:
            digest = hashlib.sha256(read_regular(next(iter(read.files.values())))).hexdigest()
        elif file is not None:
            digest = hashlib.sha256(read_regular(self.path.parent / str(file))).hexdigest()
        else:
            return {}
        if entry.digest and entry.digest != digest:
            cure, where = "take the files and the version of then", f"{name} ({entry.label})"
            raise ExplorationError(at(self.path, "is no longer the same", cure, where=where))
        return {"digest": digest}

    def _blamed(self, text: str, name: str, entry: Entry) -> str:
        """An error of a scenario, with the entry that its table comes from."""
        for other, table in _TABLES.items():
            one = entry if other == name else getattr(self.lists, other)[0]
            before, after = (
                f"{self.path}: [{table}]",
                f"{self.path}: {other} ({one.label}): [{table}]",
            )
            text = text.replace(before, after, 1) if text.startswith(before) else text
        return text

    def _job(self, seed: int, place: Entry, team: Entry, radio: Entry, strategy: Entry) -> Job:
        content: Content = dict(self.common)
        for name, entry in zip(_TABLES.values(), (place, team, strategy, radio), strict=True):
            shared = content.get(name, {})
            # There may be many runs: what all of them share is there once.
            if isinstance(shared, Mapping) and shared:
                content[name] = {**shared, **entry.keys}
            else:
                content[name] = entry.keys
        content["seed"] = seed
        rows, kit = content.get("robot"), content["team"]
        assert isinstance(kit, Mapping)
        robots = len(rows) if isinstance(rows, list) else kit.get("robots", Team.robots)
        return Job(
            place.label, int(robots) if isinstance(robots, int) else 0, team.label, strategy.label,
            radio.label, seed, content, self.path, self.code,
        )  # fmt: skip


def find_batch(name: str) -> Batch:
    """A shipped batch by name, or that of a file.

    Raises:
        ExplorationError: there is none, or it cannot be used.
    """
    if name in SUITES:  # strategy files that options name lie where the user is
        return read_batch(read_toml(SUITES[name], ExplorationError), Path(f"{name}.toml"))
    path = Path(name)
    if not path.suffix and not path.exists():
        raise ExplorationError(at(path, "there is no such batch", suggest(name, list(SUITES))))
    return read_batch(read_toml(path, ExplorationError, "robot"), path)


def read_batch(content: Mapping[str, object], path: Path, *, code: bool = True) -> Batch:
    """A batch from its tables.

    Args:
        content: as TOML gives it. path: beside which the files lie that it names, for errors, too.
        code: strategies that stand in files are run.

    Raises:
        ExplorationError: naming the file, what is wrong, and the cure.
    """
    table = Table(content, path, ExplorationError)
    lists = table.read(Lists)
    common = {key: table.raw(key) for key in _COMMON if table.has(key)}
    robots = common.get("robot")
    if isinstance(robots, list) and "teams" not in content:
        lists = replace(lists, teams=(Entry(str(len(robots)), {}),))
    for key in ("discs", "physics", "environment", "team", "radio", "strategy", "end"):
        table.free(key)
    table.finish(
        {"seed": "write seeds = [1]", "robots": "write teams = [1, 2, 4]", "radio_models": "radios"}
    )
    count = len(lists.seeds)
    for name in _TABLES:
        count *= len(getattr(lists, name))
    if count > MOST:
        raise table.error("seeds", f"{count} runs are too many", f"make it at most {MOST}")
    return Batch(lists, common, path, code)
