"""The scoring file `usar-score/1`: what makes a victim found, and how many points all is worth.

TOML, or YAML or JSON with the same keys; metres, seconds and degrees. Either `total` says by an
expression what the score is, or it is the sum of points less penalties; the rule about operators
divides both. Presets lie beside this module.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from usarsim_mission.errors import ScoringError
from usarsim_mission.expression import Expression, ExpressionError, Range
from usarsim_mission.marked_up import open_marked_up
from usarsim_server.base.errors import at
from usarsim_server.base.fields import field
from usarsim_server.base.lined import LinedTable, open_toml
from usarsim_server.base.tables import Table, suggest

SCHEMA = "usar-score/1"
PRESETS = Path(__file__).parent / "presets"

Mode = Literal["autonomous", "teleoperated"]

VARIABLES: dict[str, tuple[Range, str]] = {
    "V": ((1.0, 1e6), "victims in the world"),
    "VF": ((0.0, 1e6), "victims found"),
    "VC": ((0.0, 1e8), "victims credited, each by the factor of its zone"),
    "ID": ((0.0, 1e6), "victims found and named by their mark"),
    "ST": ((0.0, 1e6), "victims found whose status their mark tells rightly"),
    "LO": ((0.0, 1e6), "victims found that have a valid mark"),
    "FM": ((0.0, 1e6), "wrong marks"),
    "A": ((0.0, 1.0), "share of the reachable floor that was seen"),
    "M": ((0.0, 1.0), "quality of the map"),
    "T": ((0.0, 1.0), "share of the time limit that remains"),
    "C": ((0.0, 1e6), "contacts with victims"),
    "K": ((0.0, 1e6), "collisions with the world and of robots"),
    "L": ((0.0, 1e6), "robots lost"),
    "B": ((-1e9, 1e9), "bonus by hand"),
    "N": ((1.0, 1e3), "operators"),
}
"""Range and meaning of what stands in `total`. Without victims V is 0: see `Rules.check`."""

_RANGES = {name: limits for name, (limits, _) in VARIABLES.items()}
_DECIMALS = 9
"""Of a score: 0.1 + 0.2 makes 0.3."""


@dataclass(frozen=True, slots=True)
class Points:
    """Points per credited victim, where there is no `total`."""

    found: float = field(
        default=0.0, low=-1e6, high=1e6, help="per credited victim, by the factor of its zone"
    )
    id: float = field(default=0.0, low=-1e6, high=1e6, help="per victim named by its mark")
    status: float = field(default=0.0, low=-1e6, high=1e6, help="per victim with the right status")
    location: float = field(default=0.0, low=-1e6, high=1e6, help="per victim with a valid mark")


@dataclass(frozen=True, slots=True)
class VictimRules:
    """What makes a victim found."""

    credit: Literal["mark", "proximity", "view"] = field(
        default="mark", help="a mark near it, a robot near it, or its sight for a while"
    )
    mark_tolerance: float = field(
        default=1.0, unit="m", above=0.0, high=1e3, help="how far off a mark may be on the floor"
    )
    radius: float = field(
        default=2.0, unit="m", above=0.0, high=1e3, help="proximity: horizontal distance"
    )
    height: float = field(
        default=0.5, unit="m", above=0.0, high=1e3, help="proximity: difference of heights"
    )
    pairs: bool = field(
        default=False,
        help="proximity: each robot counts for one victim, the nearest that none before it has",
    )
    half_angle: float = field(
        default=30.0, unit="degrees", above=0.0, high=60.0, help="view: off the camera's axis"
    )
    dwell: float = field(default=2.0, unit="s", low=0.0, high=1e3, help="view: without a gap")
    line_of_sight: bool = field(default=True, help="view: only if nothing is between")
    points: Points = field(factory=Points, shown="", help="without `total`, see below")
    sticky: bool = field(default=True, help="it stays found after robot or mark are gone")
    false_mark: float = field(default=0.0, low=0.0, high=1e6, help="points taken per wrong mark")


def _modes(table: Table, key: str) -> tuple[Mode, ...]:
    words = table.texts(key)
    known = ("autonomous", "teleoperated")
    for word in words:
        if word not in known:
            raise table.error(key, f"{word!r} is not known", suggest(word, known))
    if not words or len(set(words)) < len(words):
        raise table.wrong(key, list(words), "a list of modes", '["autonomous", "teleoperated"]')
    return tuple(mode for mode in known if mode in words)  # type: ignore[misc]


@dataclass(frozen=True, slots=True)
class ZoneRule:
    """What holds in the zones of one colour."""

    modes: tuple[Mode, ...] = field(
        default=("autonomous", "teleoperated"),
        parse=_modes,
        expects="a list of autonomous, teleoperated",
        help="how a robot may be driven there",
    )
    otherwise: Literal["no_points"] = field(
        key="else", default="no_points", help="a victim found in another mode brings none"
    )
    factor: float = field(default=1.0, low=0.0, high=100.0, help="worth of a victim found there")
    transition: bool = field(default=False, help="a band in which the mode may change")

    @property
    def open(self) -> bool:
        """Whether robots may be driven in any way."""
        return len(self.modes) == 2


@dataclass(frozen=True, slots=True)
class ZoneRules:
    """The rules of zones by colour; floor without a zone is as `orange` is by default."""

    yellow: ZoneRule = field(default=ZoneRule(("autonomous",)), help="its rule")
    orange: ZoneRule = field(default=ZoneRule(), help="its rule")
    red: ZoneRule = field(default=ZoneRule(), help="its rule")
    blue: ZoneRule = field(default=ZoneRule(transition=True), help="its rule")

    def of(self, colour: str | None) -> ZoneRule:
        """The rule of a colour; None is floor without a zone."""
        rule: ZoneRule = ZoneRule() if colour is None else getattr(self, colour)
        return rule


@dataclass(frozen=True, slots=True)
class AreaRule:
    """What area is worth."""

    points_full: float = field(
        default=0.0, low=-1e6, high=1e6, help="points for all of the reachable floor"
    )
    source: Literal["base", "team"] = field(
        default="base", help="what the base has been told, or all that robots have seen"
    )


@dataclass(frozen=True, slots=True)
class MapRule:
    """What the map is worth."""

    points_full: float = field(default=0.0, low=-1e6, high=1e6, help="points for a perfect map")
    metric: Literal["wall_error"] = field(default="wall_error", help="how it is judged")
    perfect: float = field(
        default=0.05, unit="m", low=0.0, high=100.0, help="error up to which a map is perfect"
    )
    worthless: float = field(
        default=0.5, unit="m", above=0.0, high=100.0, help="error from which it is worth nothing"
    )


@dataclass(frozen=True, slots=True)
class TimeRule:
    """What time is worth."""

    points_full: float = field(
        default=0.0, low=-1e6, high=1e6, help="points for all of the time limit"
    )
    rule: Literal["remaining"] = field(default="remaining", help="the share that remains")


@dataclass(frozen=True, slots=True)
class Penalties:
    """Points that are taken."""

    victim_contact: float = field(default=0.0, low=0.0, high=1e6, help="per contact with a victim")
    robot_loss: float = field(default=0.0, low=0.0, high=1e6, help="per robot lost")
    collision: float = field(default=0.0, low=0.0, high=1e6, help="per collision")
    bump_window: float = field(
        default=3.0, unit="s", low=0.0, high=1e4, help="in which touching the same counts once"
    )


@dataclass(frozen=True, slots=True)
class Operators:
    """How many operators, and what they cost."""

    count: int = field(default=1, low=1, high=1000, help="where the mission does not say it")
    rule: Literal["none", "divide_n2", "divide_1n2"] = field(
        default="none", help="divides the total by N^2, by (1 + N)^2, or not"
    )


@dataclass(frozen=True)
class Rules:
    """A scoring file."""

    name: str = field(help="of the rules")
    schema: str = field(default=SCHEMA, choices=(SCHEMA,), help="of the file")
    time_limit: float = field(
        default=1200.0, unit="s", above=0.0, high=1e6, help="where the mission does not say it"
    )
    victims: VictimRules = field(factory=VictimRules, shown="", help="what makes a victim found")
    zones: ZoneRules = field(factory=ZoneRules, shown="", help="rules of zones by colour")
    area: AreaRule = field(factory=AreaRule, shown="", help="what area is worth")
    map: MapRule = field(factory=MapRule, shown="", help="what the map is worth")
    time: TimeRule = field(factory=TimeRule, shown="", help="what time is worth")
    penalties: Penalties = field(factory=Penalties, shown="", help="points that are taken")
    operators: Operators = field(factory=Operators, shown="", help="how many, and what they cost")
    total: str | None = field(default=None, help="an expression; without it the sum of points")

    @cached_property
    def expression(self) -> Expression:
        """What the score is, before operators divide it."""
        return Expression(self._sum() if self.total is None else self.total, _RANGES)

    def _sum(self) -> str:
        points, less = self.victims.points, self.penalties
        worth = {
            "VC": points.found,
            "ID": points.id,
            "ST": points.status,
            "LO": points.location,
            "A": self.area.points_full,
            "M": self.map.points_full,
            "T": self.time.points_full,
            "FM": -self.victims.false_mark,
            "C": -less.victim_contact,
            "L": -less.robot_loss,
            "K": -less.collision,
            "B": 1.0,
        }
        return " + ".join(f"{value!r} * {name}" for name, value in worth.items() if value)

    def check(self, victims: int) -> None:
        """Refuse a mission for which the total has no value.

        Raises:
            ScoringError: the total divides by the number of victims, and there are none.
        """
        try:
            self.expression.check({**_RANGES, "V": (float(victims), float(victims))})
        except ExpressionError as error:
            raise ScoringError(
                f"{self.name}: total: {error.where}: {error.problem} with {victims} "
                f"victims in the world ({error.cure})"
            ) from None

    def score(self, values: Mapping[str, float]) -> float:
        """The points for a value of each of `VARIABLES`."""
        total = self.expression.value(values) / self._shared_by(values["N"])
        return round(total, _DECIMALS) + 0.0  # no negative zero

    def made_of(self, values: Mapping[str, float]) -> list[tuple[frozenset[str], float]]:
        """What the points add up: names of the variables of each part, and its points."""
        divisor = self._shared_by(values["N"])
        return [(names, one / divisor) for names, one in self.expression.summands(values)]

    def _shared_by(self, count: float) -> float:
        """By what so many operators divide a total."""
        match self.operators.rule:
            case "divide_n2":
                return count**2
            case "divide_1n2":
                return (1.0 + count) ** 2
        return 1.0


def read_rules(path: Path) -> Rules:
    """The rules in a scoring file.

    Raises:
        ScoringError: it cannot be read, or something in it cannot be; names the line.
    """
    if path.suffix.lower() in (".yaml", ".yml", ".json"):
        table = open_marked_up(path, ScoringError)
    else:
        table = open_toml(path, ScoringError, "zones.yellow")
    return _rules(table)


def find_rules(name: str, folder: Path = Path()) -> tuple[Path, Rules]:
    """A preset by its name, or a scoring file by its path.

    Args:
        name: of either.
        folder: from which a path leads.

    Returns:
        The file and what is in it.

    Raises:
        ScoringError: there is none, or something in it cannot be.
    """
    known = presets()
    path = known.get(name, folder / name)
    if name not in known and not Path(name).suffix:
        cure = f"{suggest(name, tuple(known))} or name a file such as scoring.toml"
        raise ScoringError(at(path, "is no preset", cure))
    return path, read_rules(path)


def presets() -> dict[str, Path]:
    """The scoring files that are shipped, by name."""
    return {path.stem: path for path in sorted(PRESETS.glob("*.toml"))}


def _rules(table: LinedTable) -> Rules:
    if not table.has("schema"):
        raise table.error("schema", "is missing", f'add schema = "{SCHEMA}"')
    rules: Rules = table.read(Rules)
    table.finish()
    if rules.map.perfect >= rules.map.worthless:
        cure = "write a perfect error below the worthless one"
        raise table.table("map").error("perfect", f"is not below {rules.map.worthless}", cure)
    if rules.total is not None:
        _check_total(table, rules)
    return rules


def _check_total(table: LinedTable, rules: Rules) -> None:
    """Refuse what `total` would leave out, and a total that has no value."""
    unused: dict[tuple[str, ...], Any] = {
        ("victims", "points"): rules.victims.points != Points(),
        ("victims", "false_mark"): rules.victims.false_mark,
        ("area", "points_full"): rules.area.points_full,
        ("map", "points_full"): rules.map.points_full,
        ("time", "points_full"): rules.time.points_full,
        ("penalties", "victim_contact"): rules.penalties.victim_contact,
        ("penalties", "robot_loss"): rules.penalties.robot_loss,
        ("penalties", "collision"): rules.penalties.collision,
    }
    for (outer, key), given in unused.items():
        if given:
            cure = "leave total out, or say it there"
            raise table.table(outer).error(key, "does not count beside total", cure)
    try:
        _ = rules.expression
    except ExpressionError as error:
        raise table.error("total", f"{error.where}: {error.problem}", error.cure) from None
