"""A scenario: environment, team, radio, strategy, seed, end rules and events, in one TOML file.

    seed = 1
    [environment]
    name = "office"
    [team]
    robots = 4
    [radio]
    model = "path-loss"
    [strategy]
    name = "frontier"

Every key may be absent but the environment's; unknown ones are errors. Files that it names lie
beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from usarsim_exploration import teams, worlds
from usarsim_exploration.cycle import BASE, Member
from usarsim_exploration.ending import End
from usarsim_exploration.environment import Cell
from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.events import Event, read_events
from usarsim_exploration.levels.discs import Discs
from usarsim_exploration.levels.physics import Physics
from usarsim_exploration.radio import PathLoss, Radio, create_radio
from usarsim_exploration.radio.models import DEFAULT
from usarsim_exploration.rules import NEWEST, OLDEST, RULES, RunRules
from usarsim_exploration.strategy import TYPES, Strategy
from usarsim_exploration.strategy_file import load_strategy, split
from usarsim_exploration.worlds import World, scale_of
from usarsim_exploration.worlds.catalogue import Recipe
from usarsim_exploration.worlds.fitting import note
from usarsim_exploration.worlds.generators import KINDS, Shape
from usarsim_exploration.worlds.pictures import Rules
from usarsim_server.base.fields import field, keys
from usarsim_server.base.tables import Table
from usarsim_server.base.toml import parse_toml, read_toml

OPTIONS = "options"
"""Where a scenario stands that no file holds, for errors."""
Content = dict[str, object]


@dataclass(frozen=True)
class Basics:
    """Keys at the top of a scenario."""

    seed: int = field(default=1, low=0, high=2**63 - 1, help="of all that the strategies draw")
    links: Literal["after", "before"] = field(
        default="after", help="whether links are those of after the moves of a step or before"
    )
    backend: Literal["grid", "discs", "server"] = field(
        default="grid",
        help="who moves the robots: cells alone; cells, but robots take room and time to turn; or "
        "a server with physics",
    )
    rules: int = field(
        default=NEWEST, low=OLDEST, high=NEWEST,
        help="number of the rules; results carry theirs, and older ones run again by older rules",
    )  # fmt: skip
    mresim: bool = field(
        default=False,
        help="robots plan by MRESim's rules: random first steps, anew at each contact, to the "
        "middle of what is not certain",
    )

    @property
    def holding(self) -> RunRules:
        """The rules of the run."""
        return RULES[self.rules].by_mresim() if self.mresim else RULES[self.rules]


@dataclass(frozen=True)
class Place:
    """Keys of `[environment]`; those of a shape only beside `generator`."""

    name: str = field(
        default="",
        help="of a shipped environment, a map file (picture, text, YAML of ROS), or a world folder",
    )
    compat: bool = field(default=False, help="a map file is read by MRESim's rules")
    cell: float | None = field(
        default=None, above=0.0, high=100.0, unit="m", help="width of a cell of a map file"
    )
    generator: str = field(
        default="", choices=tuple(sorted(KINDS)), help="draws an environment, instead of `name`"
    )
    seed: int = field(default=1, low=0, high=2**63 - 1, help="of the generator")


@dataclass(frozen=True, eq=False)
class Scenario:
    """All that decides a run.

    Attributes:
        world: the truth; a run works on a copy. team: the base first.
        strategy: a pattern, each robot gets a copy; strategy_name: as written.
        basics: seed, and when links are found. discs, physics: mean something to the
            backends of these names only.
        content: the tables that it was read from, with the options that were given.
        mapped: the environment comes from a file or folder.
        files: that `content` names beside, by the name that it uses.
    """

    world: World
    team: tuple[Member, ...]
    radio: Radio
    strategy: Strategy
    strategy_name: str
    basics: Basics
    discs: Discs
    physics: Physics
    end: End
    events: tuple[Event, ...]
    content: Mapping[str, object]
    mapped: bool
    files: Mapping[str, Path]

    @property
    def rules(self) -> RunRules:
        """Those of its number, or MRESim's."""
        return self.basics.holding

    @property
    def scale(self) -> float:
        """Cells that are as long as 0.1 m, for what robots with bodies keep and need."""
        return scale_of(self.world.environment.cell) if self.rules.starts else 1.0

    @property
    def resolved(self) -> Content:
        """The same scenario, with what the team and the strategy have by default."""
        found: Content = {key: getattr(self.basics, key) for key in ("seed", "links", "rules")}
        if self.basics.mresim:
            found["mresim"] = True
        if self.basics.backend == "discs":
            discs = declared(self.discs) | {"width": self.discs.wide(self.scale)}
            found |= {"backend": "discs", "discs": discs}
        elif self.basics.backend == "server":
            found |= {"backend": "server", "physics": declared(self.physics)}
        for name in ("environment", "radio", "strategy", "end"):
            table = self.content.get(name, {})
            assert isinstance(table, Mapping)
            found[name] = {"model": DEFAULT, **table} if name == "radio" else dict(table)
        found["strategy"] = {"name": self.strategy_name, **declared(self.strategy)}
        found["end"] = {**declared(self.end), "base": self.end.base or "off"}
        found |= teams.written(self.team)
        if "event" in self.content:
            found["event"] = self.content["event"]
        return found


def load(path: Path, options: Iterable[str] = (), *, code: bool = True) -> Scenario:
    """Read a file.

    Args:
        path: of the file. options: `table.key=value`, instead of what is written there.
        code: see `read`.

    Raises:
        UsarsimError: naming the file, what is wrong, and the cure.
    """
    content = read_toml(path, ExplorationError, "robot")
    return read(merge(content, options), path, code=code)


def read(
    content: Mapping[str, object], path: Path | str = OPTIONS, *, code: bool = True
) -> Scenario:
    """A scenario from its tables.

    Args:
        content: as TOML gives it. path: of the file that names further files, and for errors.
        code: a strategy that stands in a file is run. Results may come from a stranger: who reads
            those runs it only if the user says so.

    Raises:
        UsarsimError: see `load`.
    """
    table = Table(content, path, ExplorationError)
    folder = path.parent if isinstance(path, Path) else Path()
    files: dict[str, Path] = {}
    basics = table.read(Basics)
    rules, bodies = basics.holding, basics.backend != "grid"
    world, mapped = _find_world(table.table("environment"), folder, bodies=bodies and rules.starts)
    name, strategy = _strategy(table.table("strategy"), folder, files, code)
    radio_table = table.table("radio")
    radio = create_radio(radio_table)
    radio_table.finish()
    if rules.mresim and isinstance(radio, PathLoss):
        radio = replace(radio, by_first=True)
    team = teams.read_team(table, world, strategy.formation, basics.seed, rules, bodies=bodies)
    end = table.one("end", End)
    discs, physics = table.one("discs", Discs), table.one("physics", Physics)
    events = read_events(table, [one.name for one in team], world.environment)
    table.finish({"robots": "write it in [team]", "world": "write [environment] name"})
    if bodies and (told := _forbidden(world, team[BASE].cell, basics, discs)):
        world = replace(world, notes=(*world.notes, told))
    return Scenario(
        world, team, radio, strategy, name, basics, discs, physics, end, events, dict(content),
        mapped, files,
    )  # fmt: skip


def merge(content: Mapping[str, object], options: Iterable[str]) -> Content:
    """Tables with some keys replaced.

    Args:
        content: stays as it is. options: each `table.key=value`, or `key=value` of the top; a
            value that is no TOML is text.

    Raises:
        ExplorationError: an option has no such form.
    """
    found: Content = {
        key: dict(value) if isinstance(value, Mapping) else value for key, value in content.items()
    }
    for option in options:
        place, equals, value = option.partition("=")
        table, dot, key = place.strip().rpartition(".")
        if not equals or not key or "." in table or (dot and not table):
            cure = "write TABLE.KEY=VALUE, for example strategy.replan=20"
            raise ExplorationError(f"{OPTIONS}: {option!r} sets nothing ({cure})")
        below = found.setdefault(table, {}) if table else found
        if not isinstance(below, dict):
            raise ExplorationError(f"{OPTIONS}: {table!r} is no table (write it in a file)")
        below[key] = _value(value.strip())
    return found


def declared(value: Any) -> Content:
    """The declared fields of a dataclass as they stand in a file."""
    found: Content = {}
    kind: Any = type(value)
    for key in keys(kind):
        one = getattr(value, key.name)
        found[key.key] = list(one) if isinstance(one, tuple) else one
    return found


def _value(text: str) -> object:
    try:
        return parse_toml(f"value = {text}", Path(OPTIONS), ExplorationError)["value"]
    except ExplorationError:
        return text


def _forbidden(world: World, base: Cell, basics: Basics, discs: Discs) -> str:
    """What the width of robots keeps them from."""
    scale = scale_of(world.environment.cell) if basics.holding.starts else 1.0
    if basics.backend == "discs":
        return note(world.environment, base, discs.wide(scale), "cure: a smaller discs.width")
    cure = "cure: wider passages, or backend = discs with a smaller discs.width"
    return note(world.environment, base, Discs().wide(scale), cure)


def _find_world(table: Table, folder: Path, *, bodies: bool) -> tuple[World, bool]:
    """The world, and whether it comes from a file. bodies: see `Rules`."""
    place = table.read(Place)
    if place.generator:
        shape = table.read(Shape)
        if table.has("name"):
            raise table.error("name", "means nothing beside a generator", "remove it")
        table.finish()
        recipe = Recipe(place.generator, f"Generated {place.generator}", shape, place.seed)
        return recipe.make(f"{place.generator}-{place.seed}"), False
    table.text("name")  # tells that it is missing
    table.finish({"columns": "write a generator", "seed": "write a generator"})
    if place.name in worlds.names():
        return worlds.find(place.name), False
    path = folder / Path(place.name).expanduser()
    rules = Rules(compat=place.compat, cell=place.cell, bodies=bodies)
    return worlds.find(str(path) if path.exists() else place.name, rules), True


def _strategy(
    table: Table, folder: Path, files: dict[str, Path], code: bool
) -> tuple[str, Strategy]:
    name = table.text("name", "frontier")
    parts = split(name)
    if parts is not None:
        path = folder / parts[0].expanduser()
        if not code:
            problem = f"{path} is a program that came with the results"
            raise table.error("name", problem, "read it, then let it run by --run-code")
        strategy = table.read(load_strategy(path, parts[1]))
        files[str(parts[0])] = path
    else:
        name = table.choice("name", TYPES.names(), "frontier", any_case=True)
        strategy = table.read(TYPES.find(name, table.place))
    table.finish()
    return name, strategy
