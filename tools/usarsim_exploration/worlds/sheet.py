"""The facts beside the geometry: what goes into `world.toml`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from usarsim_exploration.worlds.mjcf import Scene, Vector, number

START_HEIGHT = 0.25
"""Height of a start pose above the floor below it, m: a robot is let down from there."""

PELVIS_HEIGHT = {"standing": 0.93, "sitting": 0.12, "lying": 0.12}
"""Height of a victim's reference point above what it stands, sits or lies on, m."""


@dataclass(frozen=True, slots=True)
class Start:
    """A start pose: tag, floor point (m) and heading (degrees anticlockwise from +x)."""

    tag: str
    floor: Vector
    yaw: float = 0.0


@dataclass(frozen=True, slots=True)
class Person:
    """A victim, placed by the point of the floor (or whatever else) below the pelvis."""

    name: str
    support: Vector
    yaw: float
    posture: str
    status: str
    properties: Mapping[str, object]
    roll: float = 0.0


@dataclass(slots=True)
class GeneratedWorld:
    """A scene together with the facts about it."""

    name: str
    title: str
    description: str
    scene: Scene
    lower: Vector
    upper: Vector
    time_limit: int = 20
    starts: list[Start] = field(default_factory=list)
    people: list[Person] = field(default_factory=list)
    zones: list[tuple[str, str, tuple[float, float], tuple[float, float]]] = field(
        default_factory=list
    )
    nodes: list[tuple[str, Vector, tuple[str, ...]]] = field(default_factory=list)
    tags: list[Mapping[str, object]] = field(default_factory=list)
    sounds: list[Mapping[str, object]] = field(default_factory=list)
    false_alarms: list[Mapping[str, object]] = field(default_factory=list)
    smoke: list[Mapping[str, object]] = field(default_factory=list)
    surfaces: list[Mapping[str, object]] = field(default_factory=list)
    machines: list[tuple[str, Mapping[str, object]]] = field(default_factory=list)
    """Name of the table (door, belt, lift, obstacle) and what stands in it."""

    def start_grid(
        self, xs: Iterable[float], ys: Iterable[float], yaw: float = 0.0, prefix: str = "RobotStart"
    ) -> None:
        """Add numbered starts on level ground, row by row."""
        for x in xs:
            for y in ys:
                self.starts.append(Start(f"{prefix}{len(self.starts) + 1}", (x, y, 0.0), yaw))

    def victim(
        self,
        support: Vector,
        yaw: float,
        posture: str,
        status: str,
        *,
        figure: str,
        roll: float = 0.0,
        **properties: object,
    ) -> None:
        """Add a victim named as the original's actors were: figure and running number."""
        name = f"{figure.capitalize()}Victim_{len(self.people)}"
        facts = {"figure": figure, **properties}
        self.people.append(Person(name, support, yaw, posture, status, facts, roll))

    def tag(self, position: Vector, memory: str = "", *, single_shot: bool = False) -> None:
        """Add an RFID tag; numbers begin with 101, beyond those of victims."""
        facts: dict[str, object] = {"id": 101 + len(self.tags), "position": position}
        if memory:
            facts["memory"] = memory
        if single_shot:
            facts["single_shot"] = True
        self.tags.append(facts)

    def sound(self, position: Vector, loudness: float, duration: float, period: float) -> None:
        """Add a source of sound: dB at 1 m, s, s from one beginning to the next."""
        self.sounds.append(
            {"position": position, "loudness": loudness, "duration": duration, "period": period}
        )

    def false_alarm(self, part: str, lower: Vector, upper: Vector) -> None:
        """Add a box that victim sensors mistake for a part of a person."""
        self.false_alarms.append({"part": part, "lower": lower, "upper": upper})

    def toml(self) -> str:
        """The finished text of `world.toml`."""
        parts = [
            "# Made by a generator of worlds; change the generator, not this file.",
            "# Metres and degrees; x forward, y left, z up; yaw anticlockwise from +x.",
            _pairs(
                {
                    "title": self.title,
                    "description": self.description,
                    "level": self.name,
                    "time_limit": self.time_limit,
                    "north_degrees": 0,
                }
            ),
            "[bounds]\n" + _pairs({"lower": self.lower, "upper": self.upper}),
        ]
        parts += [_table("start", _start_facts(start)) for start in self.starts]
        parts += [_table("victim", _person_facts(person)) for person in self.people]
        parts += [
            _table("zone", {"name": name, "kind": kind, "x": x, "y": y})
            for name, kind, x, y in self.zones
        ]
        parts += [
            _table("path_node", {"tag": tag, "position": position, "neighbours": neighbours})
            for tag, position, neighbours in self.nodes
        ]
        parts += [_table("rfid", tag) for tag in self.tags]
        parts += [_table("sound", sound) for sound in self.sounds]
        parts += [_table("false_alarm", alarm) for alarm in self.false_alarms]
        parts += [_table("smoke", facts) for facts in self.smoke]
        parts += [_table("surface", facts) for facts in self.surfaces]
        parts += [_table(kind, facts) for kind, facts in self.machines]
        return "\n".join(parts[:2]) + "\n\n" + "\n\n".join(parts[2:]) + "\n"


def _start_facts(start: Start) -> dict[str, object]:
    x, y, z = start.floor
    return {"tag": start.tag, "position": (x, y, z + START_HEIGHT), "yaw_degrees": start.yaw}


def _person_facts(person: Person) -> dict[str, object]:
    x, y, z = person.support
    facts: dict[str, object] = {
        "name": person.name,
        "position": (x, y, z + PELVIS_HEIGHT[person.posture]),
        "posture": person.posture,
        "status": person.status,
        "properties": person.properties,
    }
    if person.roll:
        facts["rotation_degrees"] = (person.roll, 0.0, person.yaw)
    else:
        facts["yaw_degrees"] = person.yaw
    return facts


def _table(name: str, facts: Mapping[str, object]) -> str:
    return f"[[{name}]]\n{_pairs(facts)}"


def _pairs(facts: Mapping[str, object]) -> str:
    return "\n".join(f"{key} = {_value(value)}" for key, value in facts.items())


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        text = number(value)
        return text if "." in text else f"{text}.0"
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key} = {_value(item)}" for key, item in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, Iterable):
        return f"[{', '.join(_value(item) for item in value)}]"
    raise TypeError(f"cannot write {value!r} into TOML")
