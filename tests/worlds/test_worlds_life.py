"""Properties of victims; tables of sounds, tags and false alarms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from world_files import HEAD, START, VICTIM, nameless, write_world

from usarsim_server.base.errors import WorldError
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import FalseAlarm, Noise, RfidTag, SoundSource, Victim
from usarsim_server.worlds.life import BREATH, VOICE, Traits, Walk, Wave, traits_of
from usarsim_server.worlds.loader import load_world

STANDING = VICTIM.replace('"lying"', '"standing"')
WALK = '{ kind = "walk", to = [4.0, 2.0, 0.93]'


def victim(posture: str = "standing", status: str = "Alive", **properties: Any) -> Victim:
    """A victim with these properties."""
    return Victim("V", Pose((1.0, 2.0, 0.93)), posture, status, properties)


def error_of(directory: Path, sheet: str) -> str:
    """What the loader says about a sheet."""
    with pytest.raises(WorldError) as caught:
        load_world(write_world(directory, HEAD + START + sheet))
    text = nameless(caught.value)
    assert "\n" not in text
    return text


# ---- victims ------------------------------------------------------------------------------


def test_nothing_said_means_a_silent_breathing_victim_that_keeps_still() -> None:
    """Whoever lives breathes; everything else has to be asked for."""
    assert traits_of(victim()) == Traits(None, BREATH, False, None)
    assert traits_of(victim(status="Dead")).co2 == 0.0
    assert traits_of(victim(status="Dead", co2=0.01)).co2 == 0.01
    assert traits_of(victim(co2=0)).co2 == 0.0


@pytest.mark.parametrize(
    ("sound", "voice"),
    [
        (False, None),
        (55, (55.0, VOICE.duration, VOICE.period)),
        (True, (VOICE.loudness, VOICE.duration, VOICE.period)),
        ({}, (VOICE.loudness, VOICE.duration, VOICE.period)),
        ({"loudness": 62.5, "duration": 3, "period": 4}, (62.5, 3.0, 4.0)),
        ({"period": 0.0}, (VOICE.loudness, VOICE.duration, 0.0)),
    ],
)
def test_voices(sound: Any, voice: Any) -> None:
    """True, a loudness, or a table; False is as good as nothing."""
    found = traits_of(victim(sound=sound)).voice
    if voice is None:
        assert found is None
    else:
        assert found is not None
        assert (found.loudness, found.duration, found.period) == voice


def test_victims_do_not_call_in_unison() -> None:
    """The first call depends on the name, unless the file says when."""
    delays = set()
    for number in range(20):
        caller = Victim(f"MaleVictim_{number}", Pose(), "lying", "Alive", {"sound": True})
        voice = traits_of(caller).voice
        assert voice is not None
        assert 0.0 <= voice.delay <= voice.period
        assert voice == traits_of(caller).voice
        delays.add(voice.delay)
    assert len(delays) > 15
    told = traits_of(victim(sound={"delay": 1.25})).voice
    assert told is not None
    assert told.delay == 1.25


@pytest.mark.parametrize(
    ("rfid", "tag"), [(True, True), (False, False), (0, 0), (118, 118), (2**31 - 1, 2**31 - 1)]
)
def test_tags_of_victims(rfid: Any, tag: int | bool) -> None:
    """True asks for any free number; 0 and 1 are numbers, not flags."""
    found = traits_of(victim(rfid=rfid)).tag
    assert found == tag
    assert isinstance(found, bool) is isinstance(rfid, bool)


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        (False, None),
        (True, Wave()),
        ("wave", Wave()),
        ({"kind": "wave"}, Wave()),
        ({"kind": "wave", "angle_degrees": 60, "period": 3}, Wave(math.radians(60), 3.0)),
        ({"kind": "walk", "to": [4, 2, 0.93]}, Walk((4.0, 2.0, 0.93))),
        (
            {"kind": "walk", "to": [4, 2, 0.93], "speed": 1, "pause": 0.5},
            Walk((4.0, 2.0, 0.93), 1.0, 0.5),
        ),
    ],
)
def test_motions(motion: Any, expected: Any) -> None:
    """Waving or walking, with defaults for everything but the other end of the walk."""
    found = traits_of(victim(motion=motion)).motion
    assert found == expected


MISTAKES = [
    ('sound = "loud"', "sound", "'loud' is not a number"),
    ("sound = -3", "sound", "out of range"),
    ("sound = 500", "sound", "out of range"),
    ("sound = { loudnes = 5 }", "sound: loudnes", "did you mean loudness?"),
    ("sound = { duration = 5, period = 4 }", "sound: period", "shorter than the duration"),
    ("sound = { duration = 0 }", "sound: duration", "out of range"),
    ("co2 = true", "co2", "is not a number"),
    ("co2 = 101", "co2", "out of range"),
    ("rfid = 1.5", "rfid", "is not a whole number"),
    ("rfid = -1", "rfid", "out of range"),
    ("rfid = 2147483648", "rfid", "out of range"),
    ('rfid = "x"', "rfid", "is not a whole number"),
    ('motion = "dance"', "motion", "'dance' is not known"),
    ("motion = 3", "motion", "3 is not known"),
    ('motion = { kind = "dance" }', "motion: kind", "write one of wave, walk"),
    ("motion = { period = 2 }", "motion: kind", "is missing"),
    ('motion = { kind = "wave", to = [1, 2, 3] }', "motion: to", "unknown key"),
    ('motion = { kind = "wave", period = 0.1 }', "motion: period", "out of range"),
    ('motion = { kind = "walk" }', "motion: to", "is missing"),
    (f"motion = {WALK}, speed = 9 }}", "motion: speed", "out of range"),
    (f"motion = {WALK}, angle = 9 }}", "motion: angle", "unknown key"),
    ('motion = { kind = "walk", to = [1, 2, 0.12] }', "motion: to", "where the victim stands"),
]


@pytest.mark.parametrize(("line", "where", "problem"), MISTAKES)
def test_wrong_properties_are_refused_with_their_place(
    tmp_path: Path, line: str, where: str, problem: str
) -> None:
    """The error names the victim, the key inside its properties, the problem and a cure."""
    text = error_of(tmp_path, STANDING + f"properties = {{ {line} }}\n")
    assert f"world.toml: [[victim]] 1: properties: {where}: " in text
    assert problem in text
    assert text.endswith(")")


def test_only_those_who_stand_can_walk(tmp_path: Path) -> None:
    """A lying victim that walks is a mistake."""
    text = error_of(tmp_path, VICTIM + f"properties = {{ motion = {WALK} }} }}\n")
    assert "who is lying cannot walk" in text


def test_unknown_properties_are_nobodys_business(tmp_path: Path) -> None:
    """Users may add keys of their own."""
    sheet = HEAD + START + VICTIM + 'properties = { mood = "bad", temperature = 31.5 }\n'
    (found,) = load_world(write_world(tmp_path, sheet)).victims
    assert dict(found.properties) == {"mood": "bad", "temperature": 31.5}


# ---- tables -------------------------------------------------------------------------------


def test_the_tables_are_read(tmp_path: Path) -> None:
    """Every key of [[sound]], [[rfid]] and [[false_alarm]], and the defaults of the others."""
    sheet = """
[[sound]]
position = [1.0, 2.0, 3.0]

[[sound]]
position = [1.0, 2.0, 3.0]
loudness = 90
duration = 0.5
period = 2
delay = 10

[[rfid]]
id = 118
position = [1.0, 2.0, 0.1]

[[rfid]]
id = 0
position = [1.0, 2.0, 0.1]
memory = "two words"
single_shot = true

[[false_alarm]]
part = "Hand"
lower = [0.0, 0.0, 0.0]
upper = [0.5, 0.5, 1.0]
"""
    world = load_world(write_world(tmp_path, HEAD + START + sheet))
    assert world.sounds == (
        SoundSource((1.0, 2.0, 3.0), Noise(70.0, 1.0)),
        SoundSource((1.0, 2.0, 3.0), Noise(90.0, 0.5, 2.0, 10.0)),
    )
    assert world.tags == (
        RfidTag(118, (1.0, 2.0, 0.1)),
        RfidTag(0, (1.0, 2.0, 0.1), "two words", True),
    )
    assert world.false_alarms == (FalseAlarm("Hand", (0.0, 0.0, 0.0), (0.5, 0.5, 1.0)),)


TABLES = [
    ("[[sound]]\nloudness = 5", "[[sound]] 1: position", "is missing"),
    ("[[sound]]\nposition = [1, 2, 3]\nvolume = 5", "[[sound]] 1: volume", "unknown key"),
    ("[[rfid]]\nposition = [1, 2, 3]", "[[rfid]] 1: id", "is missing"),
    ("[[rfid]]\nid = true\nposition = [1, 2, 3]", "[[rfid]] 1: id", "not a whole number"),
    ("[[rfid]]\nid = 1\nposition = [1, 2, 3]\nsingle_shot = 1", "single_shot", "true or false"),
    ('[[rfid]]\nid = 1\nposition = [1, 2, 3]\nmemory = "{x}"', "memory", "cannot travel"),
    ('[[rfid]]\nid = 1\nposition = [1, 2, 3]\nmemory = "a\\nb"', "memory", "cannot travel"),
    (
        "[[rfid]]\nid = 1\nposition = [1, 2, 3]\n[[rfid]]\nid = 1\nposition = [1, 2, 3]",
        "[[rfid]] 2: id",
        "already the id",
    ),
    ('[[false_alarm]]\npart = "Tail"\nlower = [0, 0, 0]\nupper = [1, 1, 1]', "part", "not known"),
    ('[[false_alarm]]\npart = "Leg"\nlower = [0, 0, 0]\nupper = [1, 0, 1]', "upper", "not above"),
    ('[[false_alarm]]\npart = "Leg"\nlower = [0, 0, 0]', "upper", "is missing"),
]


@pytest.mark.parametrize(("sheet", "where", "problem"), TABLES)
def test_wrong_tables_are_refused_with_their_place(
    tmp_path: Path, sheet: str, where: str, problem: str
) -> None:
    """The error names the table, the key, the problem and a cure."""
    text = error_of(tmp_path, sheet + "\n")
    assert where in text
    assert problem in text


def test_numbers_of_tags_are_unique_across_victims(tmp_path: Path) -> None:
    """A victim cannot bear the number of a tag or of another victim."""
    tag = "[[rfid]]\nid = 7\nposition = [1, 2, 3]\n"
    text = error_of(tmp_path, tag + VICTIM + "properties = { rfid = 7 }\n")
    assert "[[victim]] 1: properties: rfid: 7 is already the id of an [[rfid]]" in text
    other = VICTIM.replace('"V"', '"W"')
    sheet = VICTIM + "properties = { rfid = 8 }\n" + other + "properties = { rfid = 8 }\n"
    text = error_of(tmp_path / "two", sheet)
    assert "[[victim]] 2: properties: rfid: 8 is already the id of victim V" in text
