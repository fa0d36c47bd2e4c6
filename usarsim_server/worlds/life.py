"""What shows that somebody lives: properties of victims, and the tables of sounds, tags, alarms.

A victim's table `properties` is free, but the keys that the server knows have to make sense:
`sound`, `co2`, `rfid` and `motion`. Keys and defaults are described in docs/worlds.md.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.simulation.frames import Vector
from usarsim_server.worlds.description import FalseAlarm, Noise, RfidTag, SoundSource, Victim
from usarsim_server.worlds.tables import Table

PARTS = ("Head", "Arm", "Hand", "Chest", "Pelvis", "Leg", "Foot")
"""The body parts that a victim sensor can name (robots reference 2.9)."""

MAX_TAG_ID = 2**31 - 1
"""Clients read tag numbers into 32-bit integers."""

VOICE = Noise(loudness=70.0, duration=1.5, period=6.0)
"""A call for help: the level of a raised voice, now and then."""

BREATH = 0.04
"""CO2 that a breathing person adds 1 m away, percent by volume; the example of protocol reference
4.6 as a starting value."""

MAX_LOUDNESS = 194.0
"""dB: the loudest undistorted sound in air."""


@dataclass(frozen=True, slots=True)
class Wave:
    """The right forearm swings to both sides: half angle (rad) and period (s)."""

    angle: float = math.radians(35.0)
    period: float = 1.6


@dataclass(frozen=True, slots=True)
class Walk:
    """To and fro between the victim's position and another one.

    Attributes:
        to: the other end, m; the pelvis, as for the victim's own position.
        speed: m/s.
        pause: s at each end, spent turning round.
    """

    to: Vector
    speed: float = 0.5
    pause: float = 2.0


@dataclass(frozen=True, slots=True)
class Traits:
    """The known properties of one victim.

    Attributes:
        voice: what it calls, None if it is silent.
        co2: percent by volume that its breath adds 1 m away; 0 if it does not breathe.
        tag: number of its RFID tag; True: any free number; False: it carries none.
        motion: how it moves, None if it keeps still.
    """

    voice: Noise | None = None
    co2: float = 0.0
    tag: int | bool = False
    motion: Wave | Walk | None = None


def traits_of(victim: Victim, path: Path | None = None, place: str = "") -> Traits:
    """Read the known properties of a victim.

    Args:
        victim: whoever it is.
        path: world file, for error messages.
        place: what the file calls the victim, for example `[[victim]] 3`.

    Raises:
        WorldError: if a known key has a value that cannot be used.
    """
    where = f"{place}: properties" if place else f"victim {victim.name}: properties"
    table = Table(path or Path("world.toml"), victim.properties, where)
    return Traits(
        voice=_voice(table, victim.name),
        co2=_breath(table, victim.status),
        tag=_tag(table),
        motion=_motion(table, victim),
    )


def read_sound(table: Table) -> SoundSource:
    """Read one `[[sound]]` table."""
    source = SoundSource(
        position=table.vector("position"),
        noise=_noise(table, Noise(loudness=VOICE.loudness, duration=1.0)),
    )
    table.finish()
    return source


def read_tag(table: Table) -> RfidTag:
    """Read one `[[rfid]]` table."""
    tag = RfidTag(
        id=table.integer("id", default=None, low=0, high=MAX_TAG_ID),
        position=table.vector("position"),
        memory=_memory(table),
        single_shot=table.flag("single_shot", default=False),
    )
    table.finish()
    return tag


def read_false_alarm(table: Table) -> FalseAlarm:
    """Read one `[[false_alarm]]` table."""
    part = table.choice("part", PARTS)
    lower, upper = table.vector("lower"), table.vector("upper")
    if any(low >= high for low, high in zip(lower, upper, strict=True)):
        raise table.error("upper", f"{upper} is not above lower {lower}", "swap the corners")
    table.finish()
    return FalseAlarm(part, lower, upper)


def _memory(table: Table) -> str:
    text = table.text("memory", default="")
    if not text.isascii() or not (text.isprintable() or not text) or set(text) & set("{}"):
        raise table.error(
            "memory", f"{text!r} cannot travel on the wire", "use plain text without braces"
        )
    return text


def _noise(table: Table, default: Noise) -> Noise:
    duration = table.number("duration", default=default.duration, low=0.01, high=3600.0)
    period = table.number("period", default=default.period, low=0.0, high=86400.0)
    if 0.0 < period < duration:
        raise table.error(
            "period", f"{period} is shorter than the duration {duration}", "write a longer one"
        )
    return Noise(
        loudness=table.number("loudness", default=default.loudness, low=0.0, high=MAX_LOUDNESS),
        duration=duration,
        period=period,
        delay=table.number("delay", default=default.delay, low=0.0, high=86400.0),
    )


def _voice(table: Table, name: str) -> Noise | None:
    """True, a loudness, or a table; people do not call in unison unless they are told to."""
    value = table.raw("sound")
    if value is None or value is False:
        return None
    digest = hashlib.sha256(name.encode()).digest()
    delay = VOICE.period * int.from_bytes(digest[-4:], "big") / 2**32
    default = Noise(VOICE.loudness, VOICE.duration, VOICE.period, round(delay, 2))
    if value is True:
        return default
    if isinstance(value, Mapping):
        inner = table.table("sound")
        voice = _noise(inner, default)
        inner.finish()
        return voice
    loudness = table.number("sound", default=VOICE.loudness, low=0.0, high=MAX_LOUDNESS)
    return Noise(loudness, default.duration, default.period, default.delay)


def _breath(table: Table, status: str) -> float:
    """Whoever lives breathes."""
    default = 0.0 if status.lower() == "dead" else BREATH
    return table.number("co2", default=default, low=0.0, high=100.0)


def _tag(table: Table) -> int | bool:
    value = table.raw("rfid")
    if value is None or isinstance(value, bool):
        return bool(value)
    return table.integer("rfid", default=None, low=0, high=MAX_TAG_ID)


def _motion(table: Table, victim: Victim) -> Wave | Walk | None:
    value = table.raw("motion")
    if value is None or value is False:
        return None
    if not isinstance(value, Mapping):
        if value == "wave" or value is True:
            return Wave()
        raise table.error(
            "motion",
            f"{value!r} is not known",
            'write "wave", or a table such as { kind = "walk", to = [1.0, 2.0, 0.93] }',
        )
    inner = table.table("motion")
    kind = inner.choice("kind", ("wave", "walk"))
    motion = _walk(inner, victim) if kind == "walk" else _wave(inner)
    inner.finish()
    return motion


def _wave(table: Table) -> Wave:
    usual = Wave()
    angle = table.number("angle_degrees", default=math.degrees(usual.angle), low=1.0, high=80.0)
    return Wave(math.radians(angle), table.number("period", default=usual.period, low=0.5, high=60))


def _walk(table: Table, victim: Victim) -> Walk:
    if victim.posture != "standing":
        raise table.error(
            "kind", f"who is {victim.posture} cannot walk", 'write posture = "standing"'
        )
    to = table.vector("to")
    if math.dist(to, victim.pose.position) < 0.1:
        raise table.error("to", f"{to} is where the victim stands", "name another place")
    usual = Walk(to)
    return Walk(
        to=to,
        speed=table.number("speed", default=usual.speed, low=0.05, high=3.0),
        pause=table.number("pause", default=usual.pause, low=0.1, high=3600.0),
    )
