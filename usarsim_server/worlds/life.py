"""What shows that somebody lives: properties of victims, and the tables of sounds, tags, alarms.

A victim's table `properties` is free, but the keys that the server knows have to make sense:
`sound`, `co2`, `rfid` and `motion`. Keys and defaults are described in docs/worlds.md.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from usarsim_server.base.errors import WorldError
from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.simulation.frames import Vector
from usarsim_server.worlds.description import (
    MAX_LOUDNESS,
    MAX_TAG_ID,
    FalseAlarm,
    Noise,
    SoundSource,
    Victim,
)

VOICE = Noise(loudness=70.0, duration=1.5, period=6.0)
"""A call for help: the level of a raised voice, now and then."""

BREATH = 0.04
"""CO2 that a breathing person adds 1 m away, percent by volume; the example of protocol reference
4.6 as a starting value."""


@dataclass(frozen=True, slots=True)
class Wave:
    """The right forearm swings to both sides: half angle (rad) and period (s)."""

    angle: float = field(
        default=math.radians(35.0),
        key="angle_degrees",
        low=1.0,
        high=80.0,
        convert=math.radians,
        shown="35",
        help="half angle",
    )
    period: float = field(default=1.6, unit="s", low=0.5, high=60.0, help="of the swing")


@dataclass(frozen=True, slots=True)
class Walk:
    """To and fro between the victim's position and another one."""

    to: Vector = field(
        unit="m",
        help="the other end, a pelvis like `position`; the victim faces where it goes, whatever "
        "its yaw",
    )
    speed: float = field(default=0.5, unit="m/s", low=0.05, high=3.0, help="of the walk")
    pause: float = field(
        default=2.0, unit="s", low=0.1, high=3600.0, help="at each end, spent turning round"
    )


@dataclass(frozen=True, slots=True)
class Traits:
    """The known properties of one victim."""

    voice: Noise | None = None  # what it calls, None if it is silent
    co2: float = 0.0  # percent by volume that its breath adds 1 m away; 0 if it does not breathe
    tag: int | bool = False  # number of its RFID tag; True: any free number; False: it carries none
    motion: Wave | Walk | None = None  # how it moves, None if it keeps still


def traits_of(victim: Victim, place: str = "") -> Traits:
    """Read the known properties of a victim; `place` is what errors call it, file included.

    Raises:
        WorldError: if a known key has a value that cannot be used.
    """
    table = Table(victim.properties, place or f"victim {victim.name}", WorldError, "properties")
    return Traits(
        voice=_voice(table, victim.name),
        co2=_breath(table, victim.status),
        tag=_tag(table),
        motion=_motion(table, victim),
    )


def read_sound(table: Table) -> SoundSource:
    """Read one `[[sound]]` table."""
    return table.read(SoundSource, noise=_noise(table))


def read_false_alarm(table: Table) -> FalseAlarm:
    """Read one `[[false_alarm]]` table."""
    alarm = table.read(FalseAlarm)
    check_corners(table, alarm.lower, alarm.upper)
    return alarm


def check_corners(table: Table, lower: Vector, upper: Vector) -> None:
    """Refuse a box whose `upper` corner is not above `lower`.

    Raises:
        WorldError: saying so.
    """
    if any(low >= high for low, high in zip(lower, upper, strict=True)):
        raise table.error("upper", f"{upper} is not above lower {lower}", "swap the corners")


def _noise(table: Table, default: Noise | None = None) -> Noise:
    noise = table.read(Noise, default)
    if 0.0 < noise.period < noise.duration:
        problem = f"{noise.period} is shorter than the duration {noise.duration}"
        raise table.error("period", problem, "write a longer one")
    return noise


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
    return replace(default, loudness=table.number("sound", low=0.0, high=MAX_LOUDNESS, unit="dB"))


def _breath(table: Table, status: str) -> float:
    """Whoever lives breathes."""
    default = 0.0 if status.lower() == "dead" else BREATH
    return table.number("co2", default, low=0.0, high=100.0)


def _tag(table: Table) -> int | bool:
    value = table.raw("rfid")
    if value is None or isinstance(value, bool):
        return bool(value)
    return table.count("rfid", low=0, high=MAX_TAG_ID)


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
    motion = _walk(inner, victim) if kind == "walk" else inner.read(Wave)
    inner.finish()
    return motion


def _walk(table: Table, victim: Victim) -> Walk:
    if victim.posture != "standing":
        raise table.error(
            "kind", f"who is {victim.posture} cannot walk", 'write posture = "standing"'
        )
    walk = table.read(Walk)
    if math.dist(walk.to, victim.pose.position) < 0.1:
        raise table.error("to", f"{walk.to} is where the victim stands", "name another place")
    return walk
