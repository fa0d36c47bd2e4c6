"""The CO2 sensor (robots checklist 109)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from life_fakes import Stage, person, wall
from sensor_fakes import UDK, UT2004, FakeRobot

from usarsim_server.sensors.report import sen_lines


def density(stage: Stage, x: float = 0.0, **rest: Any) -> float:
    """What a sensor at the height of the head says."""
    sensor, robot = stage.make("CO2Sensor", **rest), FakeRobot()
    robot.place((x, 0.0, -0.55))
    assert stage.read(sensor, robot)
    value: float = sensor.density
    return value


def test_density_rises_on_the_way_to_a_victim() -> None:
    """Checklist 109: monotonically, on the wire, too, and zero far away."""
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


def test_the_form_of_the_line() -> None:
    """Protocol reference 4.6 and checklist 96: Gas, Density with four digits, no Time in ut2004."""
    stage = Stage()
    sensor = stage.make("CO2Sensor", "CO2", ambient=0.04)
    stage.read(sensor)
    data = "{Type CO2Sensor} {Name CO2} {Gas CO2} {Density 0.0400}"
    assert sen_lines([sensor], 5.0, UT2004) == [f"SEN {data}"]
    assert sen_lines([sensor], 5.0, UDK) == [f"SEN {{Time 5.0000}} {data}"]
