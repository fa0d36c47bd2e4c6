"""What a scenario file `usar-mission/1` says, as plain values; `reader.py` reads it.

All in MuJoCo's frame, as world files are: x forward, y left, z up; metres, seconds and degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as plain
from pathlib import Path
from typing import Any, Literal

from usarsim_mission.errors import MissionError
from usarsim_mission.scenario.policies import PRESENT_POLICIES, read_policy
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table, Vector, suggest
from usarsim_server.worlds.description import POSTURES
from usarsim_server.worlds.polygons import Corner, read_corners, read_polygon

SCHEMA = "usar-mission/1"

REVEALS = ("clock", "score", "found")
PURPOSES = ("victims", "server", "radio", "video")
"""What seeds are drawn for."""
NOWHERE = Table({}, "mission", MissionError)


def _route(table: Table, key: str) -> tuple[Corner, ...]:
    return read_corners(table, key, least=2)


@dataclass(frozen=True, slots=True)
class RobotEntry:
    """A robot of the mission."""

    name: str = field(parse=Table.word, expects="a name", help="as INIT gives it; no two alike")
    kind: str = field(
        key="class", default="P3AT", help="class of the robot; `usarsim robots` lists them"
    )
    start: str | None = field(default=None, help="tag of a start pose of the world")
    position: Vector | None = field(
        default=None, unit="m", help="instead of `start`: where it begins, 0.25 m above the floor"
    )
    yaw_degrees: float = field(default=0.0, help="beside `position`: where it looks")
    unattended: str = field(
        default="stop",
        parse=read_policy,
        expects=f"one of {', '.join(PRESENT_POLICIES)}, or a policy of a package",
        help="what it does while nobody drives it",
    )
    route: tuple[Corner, ...] = field(
        default=(), parse=_route, expects="a list of [x, y]", help="way of a patrol, m"
    )


@dataclass(frozen=True, slots=True)
class VictimEntry:
    """Somebody to be found; without a position, in one of the places that a seed chooses."""

    name: str = field(
        parse=Table.word, expects="a name", help="clients know `MaleVictim_0`, `FemaleVictim_1`"
    )
    position: Vector | None = field(
        default=None,
        unit="m",
        help="of the pelvis: 0.93 m above the ground for `standing`, 0.12 m for `sitting` and "
        "`lying`; absent: one of the places",
    )
    yaw_degrees: float = field(default=0.0, help="where the person faces, or the feet point")
    posture: Literal["standing", "sitting", "lying"] = field(
        default="lying", help="of the figure; that of the place, if the place has one"
    )
    status: Literal["Alive", "Injured", "Unconscious", "Dead"] = field(
        default="Alive", help="what a mark has to say of it"
    )
    calls: object = field(
        default=False,
        parse=Table.raw,
        expects="true, a loudness in dB, or a table",
        help="whether it calls, as `sound` of a world's victim",
    )
    moves: object = field(
        default=False,
        parse=Table.raw,
        expects='"wave", or a table',
        help="how it moves, as `motion` of a world's victim",
    )
    hot: bool = field(default=True, help="warmer than what is around, for thermal sensors")
    properties: Mapping[str, object] = field(
        factory=dict, help="further ones, as of a world's victim"
    )
    scale: float = field(default=1.0, low=0.1, high=10.0, help="size, 1 is an adult of 1.70 m")


@dataclass(frozen=True, slots=True)
class PlaceEntry:
    """Where a victim may be."""

    position: Vector = field(unit="m", help="as of a victim")
    yaw_degrees: float = field(default=0.0, help="as of a victim")
    posture: str | None = field(
        default=None, choices=POSTURES, help="of whoever is there; absent: the victim's own"
    )


@dataclass(frozen=True, slots=True)
class ZoneEntry:
    """A part of the floor with a rule, or a blue band."""

    name: str = field(help="no two alike")
    colour: Literal["yellow", "orange", "red", "blue"] = field(
        help="what the scoring file has a rule for; blue: a band in which the mode may change"
    )
    polygon: tuple[Corner, ...] = field(
        default=(), parse=read_polygon, expects="a list of [x, y]", help="corners, m"
    )
    x: tuple[float, float] | None = field(
        default=None, parse=Table.interval, expects="[from, to]", help="of a rectangle instead, m"
    )
    y: tuple[float, float] | None = field(
        default=None, parse=Table.interval, expects="[from, to]", help="of a rectangle instead, m"
    )

    @property
    def corners(self) -> tuple[Corner, ...]:
        """Of the area."""
        if self.polygon or self.x is None or self.y is None:
            return self.polygon
        (west, east), (south, north) = self.x, self.y
        return (west, south), (east, south), (east, north), (west, north)


@dataclass(frozen=True, slots=True)
class Video:
    """What the link between pages and robots is like, as `usarsim console --impair` has it."""

    delay_ms: float = field(default=0.0, low=0.0, high=10_000.0, help="of every message")
    jitter_ms: float = field(
        default=0.0, low=0.0, high=10_000.0, help="more or less, at most the delay"
    )
    loss_percent: float = field(default=0.0, low=0.0, high=100.0, help="of frames that are lost")
    bandwidth_kbit: float = field(default=0.0, low=0.0, high=1e6, help="per second; 0: no limit")

    @property
    def plain(self) -> bool:
        """Whether nothing is impaired."""
        return self == Video()


@dataclass(frozen=True, slots=True)
class Event:
    """Something that is made to happen, at a time or after something else happened."""

    name: str = field(help="no two alike; the log tells it")
    do: Literal[
        "robot_fails",
        "robot_recovers",
        "victim_calls",
        "link_drops",
        "link_returns",
        "message",
    ] = field(help="what happens")
    at: float | None = field(default=None, unit="s", low=0.0, help="of the trial")
    when: (
        Literal["found", "credited", "enters", "leaves", "collision", "lost", "first_input"] | None
    ) = field(default=None, help="instead of `at`: what happens first")
    of: str | None = field(
        default=None, help="beside `when`: the victim, zone or robot that it happens to; any"
    )
    count: int = field(default=1, low=1, high=10_000, help="beside `when`: the how manieth time")
    after: float = field(default=0.0, unit="s", low=0.0, help="beside `when`: so much later")
    robot: str | None = field(default=None, help="that fails, recovers, or whose link drops")
    victim: str | None = field(default=None, help="that calls")
    text: str = field(default="", help="of a message to the operators, also beside a call")
    lasts: float | None = field(
        default=None, unit="s", above=0.0, help="a failure, a drop or a call ends by itself"
    )


@dataclass(frozen=True, slots=True)
class Seeds:
    """Of all that is drawn; what is absent follows from `seed`."""

    victims: int | None = field(default=None, low=0, high=2**31, help="of their places")
    server: int | None = field(default=None, low=0, high=2**31, help="of the noise of sensors")
    radio: int | None = field(default=None, low=0, high=2**31, help="of fading and loss")
    video: int | None = field(default=None, low=0, high=2**31, help="of the impairment")


def _reveal(table: Table, key: str) -> tuple[str, ...]:
    words = table.texts(key)
    for word in words:
        if word not in REVEALS:
            raise table.error(key, f"{word!r} is not known", suggest(word, REVEALS))
    return words


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scenario file."""

    title: str = field(help="one line for lists")
    world: str = field(help="name of a world, path of a world folder, or of a map to import")
    description: str = field(
        default="",
        parse=lambda table, key: table.text(key, "", lines=True),
        expects="text in quotes",
        help="a paragraph",
    )
    time_limit: float = field(default=1200.0, unit="s", above=0.0, high=1e6, help="of the trial")
    scoring: str = field(
        default="usar-mj-1", help="name of a preset, or path of a scoring file (`usar-score/1`)"
    )
    operators: int = field(default=1, low=1, high=1000, help="how many drive")
    ends_when_all_credited: bool = field(
        default=False, help="the trial ends with the last victim that is credited"
    )
    reveal: tuple[str, ...] = field(
        default=("clock",),
        parse=_reveal,
        expects=f"a list of {', '.join(REVEALS)}",
        help="what operators are shown",
    )
    seed: int = field(default=0, low=0, high=2**31, help="all others follow from it")
    seeds: Seeds = field(default=Seeds(), shown="", help="see below")
    keep_victims: bool = field(default=False, help="those of the world stay, beside those here")
    keep_zones: bool = field(default=False, help="those of the world stay, beside those here")
    band: float = field(
        default=1.0,
        unit="m",
        low=0.0,
        high=100.0,
        help="how far a blue band reaches to either side of a border between different rules; "
        "0, or a blue zone here: none is derived",
    )
    strips: bool = field(default=True, help="zones are painted on walls and floor")
    robots: tuple[RobotEntry, ...] = field(key="robot", default=(), help="see below")
    victims: tuple[VictimEntry, ...] = field(key="victim", default=(), help="see below")
    places: tuple[PlaceEntry, ...] = field(key="place", default=(), help="see below")
    zones: tuple[ZoneEntry, ...] = field(key="zone", default=(), help="see below")
    events: tuple[Event, ...] = field(key="event", default=(), help="see below")
    radio: Mapping[str, object] = field(
        factory=dict, help="as `[wireless]` of a server's settings file"
    )
    video: Video = field(default=Video(), shown="", help="see below")
    path: Path = Path()
    """The file."""
    table: Table = plain(default=NOWHERE, compare=False, repr=False)
    """What it was read from, for errors that name the line."""
    content: Mapping[str, Any] | None = None
    """All that it says, as TOML has it."""

    @property
    def name(self) -> str:
        """By which it is found."""
        return self.path.stem


def beside(scenario: Scenario, name: str) -> Path:
    """A path that a scenario names, seen from its folder."""
    return scenario.path.parent / Path(name).expanduser()
