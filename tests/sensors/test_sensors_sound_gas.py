"""Ears, Sound of UT2004 and Acoustic of UDK, and the CO2 sensor (robots reference 2.9, robots
109; protocol reference 4.6).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from life_fakes import Stage, person, wall
from sensor_fakes import UDK, UT2004, FakeRobot, numbers, values

from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.report import sen_lines
from usarsim_server.sensors.sound_gas import level
from usarsim_server.worlds.description import Noise, SoundSource
from usarsim_server.worlds.surroundings import Sound


def source(x: float, y: float = 0.0, z: float = 0.0, **noise: Any) -> SoundSource:
    """A source of 80 dB that sounds for 2 s every 10 s, unless said otherwise."""
    pattern = {"loudness": 80.0, "duration": 2.0, "period": 10.0, **noise}
    return SoundSource((x, y, z), Noise(**pattern))


def heard(stage: Stage, time: float, **rest: Any) -> tuple[float, float]:
    """Loudness and duration that a sensor in the origin reads at a time."""
    sensor = stage.make("Sound", **rest)
    assert stage.read(sensor, FakeRobot(time=time))
    return sensor.loudness, sensor.duration


# ---- Sound --------------------------------------------------------------------------------


@pytest.mark.parametrize(("time", "loud"), [(0.0, True), (1.9, True), (2.1, False), (11.0, True)])
def test_a_source_is_heard_while_it_sounds(time: float, loud: bool) -> None:
    """2 s of every 10 s; silence is zeros."""
    stage = Stage(sounds=(source(10.0),))
    assert heard(stage, time) == ((pytest.approx(60.0), 2.0) if loud else (0.0, 0.0))


def test_the_level_falls_by_twenty_decibels_per_decade() -> None:
    """The intensity falls with the square of the distance; within 1 m the source's level holds."""
    for distance, expected in ((0.3, 80.0), (1.0, 80.0), (2.0, 73.979), (10.0, 60.0), (100.0, 40)):
        assert heard(Stage(sounds=(source(distance),)), 1.0)[0] == pytest.approx(expected, abs=1e-3)


def test_hidden_sources_are_muffled() -> None:
    """Behind a wall a source sounds as from twice the distance, 6 dB less."""
    free = heard(Stage(sounds=(source(10.0),)), 1.0)[0]
    hidden = heard(Stage(sounds=(source(10.0),), walls=[wall(5.0)]), 1.0)[0]
    assert free - hidden == pytest.approx(20 * math.log10(2), abs=1e-6)


def test_a_victims_own_body_does_not_muffle_it() -> None:
    """Whoever lies with the feet toward the robot is in plain sight."""
    stage = Stage(person("Ann", 4.0, posture="lying", yaw=math.pi, sound={"delay": 0.0}))
    victim = stage.surroundings.victims[0]
    robot = FakeRobot(time=0.5)
    robot.place((0.0, 0.0, 0.85))
    sensor = stage.make("Sound")
    assert stage.read(sensor, robot)
    distance = math.dist(victim.head(0.5), robot.pose.position)
    assert sensor.loudness == pytest.approx(70.0 - 20 * math.log10(distance), abs=1e-6)


def test_the_loudest_counts() -> None:
    """Of two sounds the louder one is reported, with its own duration."""
    stage = Stage(sounds=(source(10.0), source(2.0, loudness=90.0, duration=1.5)))
    assert heard(stage, 1.0) == (pytest.approx(83.979, abs=1e-3), 1.5)
    assert heard(stage, 1.7) == (pytest.approx(60.0), 2.0)


def test_faint_sounds_are_not_heard() -> None:
    """Below the threshold there is silence; 0 dB is the faintest."""
    stage = Stage(sounds=(source(10.0),))
    assert heard(stage, 1.0, threshold=59.0)[0] == pytest.approx(60.0)
    assert heard(stage, 1.0, threshold=61.0) == (0.0, 0.0)
    assert heard(Stage(sounds=(source(20_000.0),)), 1.0) == (0.0, 0.0)


def test_the_form_of_the_line() -> None:
    """Protocol reference 4.6 and robots 96: two digits each, no Time in ut2004."""
    stage = Stage(sounds=(source(10.0, duration=1.2),))
    sensor = stage.make("Sound", "Sound")
    stage.read(sensor)
    data = "{Type Sound} {Name Sound} {Loudness 60.00} {Duration 1.20}"
    assert sen_lines([sensor], 5.0, UT2004) == [f"SEN {data}"]
    assert sen_lines([sensor], 5.0, UDK) == [f"SEN {{Time 5.0000}} {data}"]


# ---- Acoustic -----------------------------------------------------------------------------


def listen(stage: Stage, sensor: Any, *times: float) -> list[dict[str, str]]:
    """Data of the readings at these times."""
    found = []
    for time in times:
        assert stage.read(sensor, FakeRobot(time=time))
        found.append(values(sensor, UDK))
    return found


def test_a_sound_is_reported_once_when_it_begins() -> None:
    """None before and after; the first reading only begins to listen."""
    stage = Stage(sounds=(source(3.43, delay=2.5),))
    sensor = stage.make("Acoustic")
    readings = listen(stage, sensor, 0.0, 1.0, 2.0, 3.0, 4.0)
    assert [list(reading) for reading in readings] == [
        ["None"],
        ["None"],
        ["None"],
        ["Direction", "Volume", "Duration", "Delay"],
        ["None"],
    ]


def test_volume_duration_and_delay() -> None:
    """-20 log10(d / 1 m); the delay is what is left of the way at 343 m/s."""
    stage = Stage(sounds=(source(343.0, delay=0.75, duration=1.5),))
    sensor = stage.make("Acoustic")
    _, reading = listen(stage, sensor, 0.0, 1.0)
    assert reading["Volume"] == f"{80 - 20 * math.log10(343):.5f}"[:-1]
    assert reading["Duration"] == "1.5000"
    assert reading["Delay"] == "0.7500"
    near = Stage(sounds=(source(34.3, delay=0.5),))
    sensor = near.make("Acoustic")
    assert listen(near, sensor, 0.0, 1.0)[1]["Delay"] == "0.0000"


def test_directions_are_unit_vectors_with_z_up() -> None:
    """Forward, right, up in the sensor's frame: the template of protocol 4.6 is to the front
    left."""
    stage = Stage(sounds=(source(5.0, 5.0, delay=0.5), source(0.0, -3.0, 4.0, delay=0.6)))
    sensor = stage.make("Acoustic")
    listen(stage, sensor, 0.0, 1.0)
    directions = [v for key, v in sensor.data(UDK) if key == "Direction"]
    assert directions == ["0.70,-0.70,0.00", "0.00,0.60,0.80"]
    turned, robot = stage.make("Acoustic"), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2))
    stage.read(turned, robot)
    robot.time = 1.0
    stage.read(turned, robot)
    directions = [v for key, v in turned.data(UDK) if key == "Direction"]
    assert numbers(directions[1]) == pytest.approx([0.6, 0.0, 0.8], abs=0.011)


def test_far_and_faint_sounds_are_far() -> None:
    """Beyond the threshold or below 0 dB there is only {Far}."""
    stage = Stage(sounds=(source(50.0, delay=0.5),))
    assert listen(stage, stage.make("Acoustic", max_range=49.0), 0.0, 1.0)[1] == {"Far": ""}
    faint = Stage(sounds=(source(50.0, delay=0.5, loudness=30.0),))
    assert listen(faint, faint.make("Acoustic"), 0.0, 1.0)[1] == {"Far": ""}


def test_hidden_sources_count_double_unless_taken_literally() -> None:
    """The original muffled what was in plain sight; `literal` brings that back."""
    free = Stage(sounds=(source(10.0, delay=0.5),))
    hidden = Stage(sounds=(source(10.0, delay=0.5),), walls=[wall(5.0)])
    for stage, literal, expected in (
        (free, False, 60.0),
        (free, True, 53.979),
        (hidden, False, 53.979),
        (hidden, True, 60.0),
    ):
        reading = listen(stage, stage.make("Acoustic", literal=literal), 0.0, 1.0)[1]
        assert float(reading["Volume"]) == pytest.approx(expected, abs=1e-3)


def test_many_sounds_make_no_line_too_long() -> None:
    """Protocol 107: the ten loudest, in the order in which they began."""
    sources = tuple(source(3.0 + (n * 7) % 20, delay=0.1 + n / 100) for n in range(20))
    stage = Stage(sounds=sources)
    sensor = stage.make("Acoustic", "ExampleAcousticArray_0")
    listen(stage, sensor, 0.0, 1.0)
    volumes = [float(v) for key, v in sensor.data(UDK) if key == "Volume"]
    levels = [80 - 20 * math.log10(3.0 + (n * 7) % 20) for n in range(20)]
    limit = sorted(levels)[10]
    expected = [value for value in levels if value >= limit]
    assert volumes == pytest.approx(expected, abs=1e-3)
    (line,) = sen_lines([sensor], 123456.0, UDK)
    assert len(line) < 1024


def test_forms_of_the_acoustic_line() -> None:
    """Protocol reference 4.6, both dialects with Time; once a second, or on SCAN."""
    stage = Stage(sounds=(source(1.0, -1.0, delay=0.5, loudness=54.0103, duration=1.5),))
    sensor = stage.make("Acoustic", "Ear")
    listen(stage, sensor, 0.0)
    for dialect in (UT2004, UDK):
        assert sen_lines([sensor], 63.4021, dialect) == [
            "SEN {Time 63.4021} {Type Acoustic} {Name Ear} {None}"
        ]
    listen(stage, sensor, 1.0)
    assert sen_lines([sensor], 64.4021, UDK) == [
        "SEN {Time 64.4021} {Type Acoustic} {Name Ear} {Direction 0.70,0.70,0.00} "
        "{Volume 51.0000} {Duration 1.5000} {Delay 0.0000}"
    ]
    assert sensor.interval(UT2004) == sensor.interval(UDK) == 1.0
    assert sensor.set("SCAN", "", FakeRobot()) is SetResult.SCAN
    assert sensor.set("RESET", "", FakeRobot()) is SetResult.UNKNOWN


def test_the_level_formula() -> None:
    """Muffled sounds seem twice as far, but never louder than their source."""
    sound = Sound((0.0, 0.0, 0.0), Noise(60.0, 1.0), 0.0)
    assert level(sound, 0.1, False) == 60.0
    assert level(sound, 10.0, False) == pytest.approx(40.0)
    assert level(sound, 5.0, True) == pytest.approx(40.0)


def density(stage: Stage, x: float = 0.0, **rest: Any) -> float:
    """What a sensor at the height of the head says."""
    sensor, robot = stage.make("CO2Sensor", **rest), FakeRobot()
    robot.place((x, 0.0, -0.55))
    assert stage.read(sensor, robot)
    value: float = sensor.density
    return value


def test_density_rises_on_the_way_to_a_victim() -> None:
    """Robots 109: monotonically, on the wire, too, and zero far away."""
    stage = Stage(person("Ann", 0.0, co2=0.05))
    found = [density(stage, -x) for x in (30.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.3)]
    assert found == sorted(found)
    assert len(set(found)) == len(found)
    sensor, robot = stage.make("CO2Sensor"), FakeRobot()
    told = []
    for distance in (40.0, 10.0, 8.0, 6.0, 4.0, 2.75, 2.0):
        robot.place((-distance, 0.0, 0.0))
        stage.read(sensor, robot)
        told.append(dict(sensor.data(UT2004))["Density"])
    assert told[0] == "0.0000"
    assert sorted(set(map(float, told))) == list(map(float, told))


def test_density_falls_with_the_square_of_the_distance() -> None:
    """The world file's number holds 1 m from the head."""
    stage = Stage(person("Ann", 0.0, co2=0.08))
    (head,) = [p.position for p in stage.surroundings.victims[0].parts(0.0) if p.name == "Head"]
    sensor, robot = stage.make("CO2Sensor"), FakeRobot()
    for distance in (0.5, 1.0, 3.0):
        robot.place((head[0] - distance, -head[1], -head[2]))
        stage.read(sensor, robot)
        assert sensor.density == pytest.approx(0.08 / distance**2, rel=1e-9)


def test_it_stays_finite_at_the_mouth() -> None:
    """Nearer than 0.2 m nothing changes any more."""
    stage = Stage(person("Ann", 0.0, co2=100.0))
    assert density(stage) == 100.0
    weak = Stage(person("Ann", 0.0, co2=0.04))
    assert density(weak) == pytest.approx(1.0, rel=0.3)


def test_breaths_add_up() -> None:
    """Two victims at the same place count twice; the dead do not breathe; walls do not matter."""
    one = density(Stage(person("Ann", 1.0)))
    both = density(Stage(person("Ann", 1.0), person("Anna", 1.0)))
    assert both == pytest.approx(2 * one, rel=0.05)
    assert one > 0.02
    assert density(Stage(person("Ann", 1.0, status="Dead"))) == 0.0
    assert density(Stage(person("Ann", 1.0, status="DEAD"))) == 0.0
    assert density(Stage(person("Ann", 1.0, co2=0))) == 0.0
    assert density(Stage(person("Ann", 1.0), walls=[wall(0.5)])) == one


def test_noise_and_ambient_air() -> None:
    """Both are off by default; noise never gives less than nothing."""
    stage = Stage()
    assert density(stage) == 0.0
    assert density(stage, ambient=0.04) == 0.04
    sensor = stage.make("CO2Sensor", ambient=0.4, noise=0.1, seed=4)
    found = []
    for _ in range(400):
        stage.read(sensor)
        found.append(sensor.density)
    assert np.mean(found) == pytest.approx(0.4, abs=0.02)
    assert np.std(found) == pytest.approx(0.1, rel=0.12)
    loud = stage.make("CO2Sensor", noise=1.0)
    for _ in range(20):
        stage.read(loud)
        assert loud.density >= 0.0


def test_the_form_of_the_line_gas() -> None:
    """Protocol reference 4.6 and robots 96: Gas, Density with four digits, no Time in ut2004."""
    stage = Stage()
    sensor = stage.make("CO2Sensor", "CO2", ambient=0.04)
    stage.read(sensor)
    data = "{Type CO2Sensor} {Name CO2} {Gas CO2} {Density 0.0400}"
    assert sen_lines([sensor], 5.0, UT2004) == [f"SEN {data}"]
    assert sen_lines([sensor], 5.0, UDK) == [f"SEN {{Time 5.0000}} {data}"]
