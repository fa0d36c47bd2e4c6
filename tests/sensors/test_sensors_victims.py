"""The victim sensor (robots 105 to 107, protocol 94, 107, 114, 115)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from life_fakes import Stage, person, wall
from sensor_fakes import UDK, UT2004, FakeRobot, numbers

from usarsim_server.sensors.report import conf_line, sen_lines
from usarsim_server.simulation.frames import Pose, flip_point, quaternion_from_rpy
from usarsim_server.worlds.description import FalseAlarm

WIRE_PARTS = {"Arm", "Hand", "Chest", "Pelvis", "Leg", "Foot"}

Found = list[tuple[str, list[float]]]


def found_by(sensor: Any) -> Found:
    """Part names and locations of the last report; empty for NoVictims."""
    segments = sensor.data(UT2004)
    if segments == (("Status", "NoVictims"),):
        return []
    names = [value for key, value in segments if key == "PartName"]
    places = [numbers(value) for key, value in segments if key == "Location"]
    assert [key for key, _ in segments] == ["PartName", "Location"] * len(names)
    return list(zip(names, places, strict=True))


def report(stage: Stage, sensor: Any, robot: FakeRobot | None = None) -> Found:
    """One complete report."""
    robot = robot or FakeRobot()
    answers = [stage.read(sensor, robot) for _ in range(4)]
    assert answers == [False, False, False, True]
    return found_by(sensor)


def truth(stage: Stage, part: str, time: float = 0.0) -> list[np.ndarray]:
    """Wire places of a part of the first victim, seen from the origin."""
    return [
        np.array(flip_point(entry.position))
        for entry in stage.surroundings.victims[0].parts(time)
        if entry.name == part
    ]


def test_somebody_in_the_middle_is_found() -> None:
    """Robots 105: at 3 m several parts are named, each within 3 sigma (0.15 m) of the truth."""
    stage = Stage(person("Ann", 3.0))
    found = report(stage, stage.make("VictSensor"))
    assert {"Chest", "Arm"} <= {name for name, _ in found}
    for name, place in found:
        errors = [np.abs(place - true).max() for true in truth(stage, name)]
        assert min(errors) < 3 * 0.15 * 1.2, name


def test_a_report_is_complete_at_every_fourth_interval() -> None:
    """Robots 105: one report in 0.8 s, and the interval of a quarter is 0.2 s."""
    stage = Stage(person("Ann", 3.0))
    sensor = stage.make("VictSensor")
    assert sensor.interval(UT2004) == sensor.interval(UDK) == 0.2
    assert [stage.read(sensor) for _ in range(12)] == [False, False, False, True] * 3


@pytest.mark.parametrize("dialect", [UT2004, UDK])
def test_nobody_is_there(dialect: Any) -> None:
    """Protocol 94 and 114: Name, then Status NoVictims, in both dialects with Time."""
    stage = Stage()
    sensor = stage.make("VictSensor", "VictSensor")
    report(stage, sensor)
    (line,) = sen_lines([sensor], 63.4, dialect)
    assert line == "SEN {Time 63.4000} {Type VictSensor} {Name VictSensor} {Status NoVictims}"


def test_the_name_can_be_left_out_where_nobody_is() -> None:
    """The quoted line of the original has no Name; a report of somebody always has."""
    stage = Stage(person("Ann", 3.0))
    sensor = stage.make("VictSensor", "VictSensor", name_without_victims=False)
    away = FakeRobot(pose=Pose((0.0, 0.0, 0.0), quaternion_from_rpy(0.0, 0.0, 2.0)))
    report(stage, sensor, away)
    (line,) = sen_lines([sensor], 63.4, UT2004)
    assert line == "SEN {Time 63.4000} {Type VictSensor} {Status NoVictims}"
    report(stage, sensor)
    (line,) = sen_lines([sensor], 63.4, UT2004)
    assert line.startswith("SEN {Time 63.4000} {Type VictSensor} {Name VictSensor} {PartName ")


@pytest.mark.parametrize("posture", ["standing", "sitting", "lying"])
@pytest.mark.parametrize("turn", [0.0, 1.5, 3.1])
def test_part_names_are_those_that_clients_know(posture: str, turn: float) -> None:
    """Protocol 115: Arm, Hand, Chest, Pelvis, Leg, Foot; never Head."""
    stage = Stage(person("Ann", 2.0, posture=posture, yaw=turn))
    robot = FakeRobot(pose=Pose((0.0, 0.0, 0.0), quaternion_from_rpy(0.0, 0.15, 0.0)))
    sensor = stage.make("VictSensor", vertical_fov=1.5)
    found = report(stage, sensor, robot)
    assert found
    assert {name for name, _ in found} <= WIRE_PARTS


def test_a_head_is_sent_to_those_who_ask_for_it() -> None:
    """Behind a wall of 1.55 m only a head is to be seen: NoVictims, or Head with `send_head`."""
    stage = Stage(person("Ann", 3.0), walls=[wall(1.5, high=0.55)])
    robot = FakeRobot(pose=Pose((0.0, 0.0, 0.6)))
    assert report(stage, stage.make("VictSensor"), robot) == []
    found = report(stage, stage.make("VictSensor", send_head=True), robot)
    assert [name for name, _ in found] == ["Head"]
    assert found[0][1][0] == pytest.approx(3.0, abs=0.5)


@pytest.mark.parametrize(("distance", "seen"), [(1.0, True), (3.8, True), (4.4, False)])
def test_the_range_ends_at_max_range(distance: float, seen: bool) -> None:
    """Robots 106: nobody is found beyond the sensor's distance of 4 m."""
    stage = Stage(person("Ann", distance))
    assert bool(report(stage, stage.make("VictSensor"))) is seen


@pytest.mark.parametrize(("degrees", "seen"), [(0, True), (18, True), (-18, True), (40, False)])
def test_the_view_ends_at_half_the_field(degrees: float, seen: bool) -> None:
    """Robots 106: nobody is found outside 20 degrees of the axis."""
    angle = math.radians(degrees)
    stage = Stage(person("Ann", 3 * math.cos(angle), 3 * math.sin(angle)))
    assert bool(report(stage, stage.make("VictSensor"))) is seen


def test_walls_hide_people() -> None:
    """Nobody is found behind a wall."""
    stage = Stage(person("Ann", 3.0), walls=[wall(1.0)])
    assert report(stage, stage.make("VictSensor")) == []


def test_the_quarters_add_up_to_the_fine_grid() -> None:
    """Robots reference 2.9: 121, 110, 100 and 110 rays, together a grid of 2 degrees."""
    stage = Stage()
    sensor = stage.make("VictSensor")
    fans = []
    for _ in range(4):
        (fan,) = sensor.rays(FakeRobot())
        fans.append(fan.directions)
        stage.read(sensor)
    assert [len(fan) for fan in fans] == [121, 110, 100, 110]
    x, y, z = np.concatenate(fans).T
    yaw, pitch = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    grid = {(int(a), int(b)) for a, b in zip(np.rint(yaw), np.rint(pitch), strict=True)}
    assert grid == {(a, b) for a in range(-20, 21, 2) for b in range(-20, 21, 2)}
    assert np.allclose(yaw, np.rint(yaw), atol=0.01)


def test_errors_are_gaussian_and_grow_with_the_distance() -> None:
    """Robots reference 2.9: each axis errs by distance times N(0, 0.05); no bias."""
    for distance in (1.5, 3.0):
        stage = Stage(person("Ann", distance))
        sensor = stage.make("VictSensor", seed=7)
        (chest,) = truth(stage, "Chest")
        errors = np.array(
            [
                place - chest
                for _ in range(400)
                for name, place in report(stage, sensor)
                if name == "Chest"
            ]
        )
        sigma = 0.05 * float(np.linalg.norm(chest))
        assert errors.shape == (400, 3)
        assert np.abs(errors.mean(axis=0)).max() < 4 * sigma / 20
        assert errors.std(axis=0) == pytest.approx([sigma] * 3, rel=0.12)


def test_without_noise_the_truth_is_told() -> None:
    """Left and right limbs come apart, in the fixed order of parts, with the centres as places."""
    stage = Stage(person("Ann", 3.0))
    sensor = stage.make("VictSensor", noise=0.0, vertical_fov=1.5)
    found = report(stage, sensor)
    assert [name for name, _ in found] == sorted(
        (name for name, _ in found), key=["Arm", "Hand", "Chest", "Pelvis", "Leg", "Foot"].index
    )
    arms = [place for name, place in found if name == "Arm"]
    assert len(arms) == 2
    for place, true in zip(arms, truth(stage, "Arm"), strict=True):
        assert place == pytest.approx(true, abs=0.0101)


def test_places_are_relative_to_the_turned_sensor_at_the_end_of_the_report() -> None:
    """A robot that turns while looking reports from where it is in the end; z points down."""
    stage = Stage(person("Ann", 3.0))
    sensor = stage.make("VictSensor", noise=0.0, location=(0.0, 0.0, -0.5))
    robot = FakeRobot()
    for yaw in (0.0, 0.02, 0.04):
        robot.place((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
        assert not stage.read(sensor, robot)
    robot.place((0.5, 0.0, 0.0), (0.0, 0.0, 0.1))
    assert stage.read(sensor, robot)
    chest = dict(found_by(sensor))["Chest"]
    (true,) = truth(stage, "Chest")
    x, y, z = true - np.array([0.5, 0.0, -0.5])
    turned = [x * math.cos(0.1) + y * math.sin(0.1), y * math.cos(0.1) - x * math.sin(0.1), z]
    assert chest == pytest.approx(turned, abs=0.0101)
    assert chest[2] > 0.2


def test_a_report_forgets_the_one_before() -> None:
    """Whoever has left the view is not reported again."""
    stage = Stage(person("Ann", 3.0))
    sensor, robot = stage.make("VictSensor"), FakeRobot()
    assert report(stage, sensor, robot)
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert report(stage, sensor, robot) == []


def test_several_victims_come_nearest_first() -> None:
    """Two people in view are both reported; the parts of one are together."""
    stage = Stage(person("Far", 3.5, 0.5), person("Near", 1.8, -0.3))
    found = report(stage, stage.make("VictSensor", noise=0.0))
    depths = [place[0] for _, place in found]
    assert depths[0] < 2.2
    assert depths[-1] > 3.2
    assert sorted(depths, key=lambda depth: depth > 2.7) == depths


def test_a_crowd_does_not_make_the_line_too_long() -> None:
    """Protocol 107: below 1024 bytes, whoever is in view."""
    crowd = [person(f"MaleVictim_{n}", 30.0 + n % 3, (n - 6) * 1.2) for n in range(12)]
    stage = Stage(*crowd)
    sensor = stage.make("VictSensor", "VictSensor", max_range=50.0, step=0.02)
    robot = FakeRobot()
    robot.place((-999.0, 0.0, 0.0))
    stage.read(sensor, robot)
    robot.place((0.0, 0.0, 0.0))
    for _ in range(3):
        stage.read(sensor, robot)
    (line,) = sen_lines([sensor], 123456.7, UT2004)
    assert line.count("PartName") == 16
    assert len(line) < 1024


def test_somebody_who_walks_is_where_he_is_now() -> None:
    """The place is that of the moment of the report."""
    stage = Stage(person("Bob", 2.0, motion={"kind": "walk", "to": [3.5, 0.0, -0.07]}))
    sensor, robot = stage.make("VictSensor", noise=0.0), FakeRobot()
    for moment in (1.0, 1.2, 1.4, 1.6):
        robot.time = moment
        done = stage.read(sensor, robot)
    assert done
    assert dict(found_by(sensor))["Chest"][0] == pytest.approx(2.0 + 0.5 * 1.6, abs=0.05)


def test_configuration_is_announced() -> None:
    """Protocol reference 4.8: MaxRange, HorizontalFOV, VerticalFOV, the captured values."""
    sensor = Stage().make("VictSensor", "VictSensor", max_range=6.0)
    for dialect in (UT2004, UDK):
        assert conf_line([sensor], "VictSensor", None, dialect) == (
            "CONF {Type VictSensor} {Name VictSensor} "
            "{MaxRange 6.0000} {HorizontalFOV 0.6981} {VerticalFOV 0.6981}"
        )


# ---- false alarms -------------------------------------------------------------------------


def alarm_at(distance: float, part: str = "Hand") -> FalseAlarm:
    """A box of 0.4 m around a point on the axis."""
    return FalseAlarm(part, (distance - 0.2, -0.2, -0.2), (distance + 0.2, 0.2, 0.2))


def rate(distance: float, reports: int = 600, **facts: Any) -> float:
    """Share of the reports that hold the false alarm."""
    stage = Stage(false_alarms=(alarm_at(distance),), **facts)
    sensor = stage.make("VictSensor", seed=3)
    return sum(bool(report(stage, sensor)) for _ in range(reports)) / reports


@pytest.mark.parametrize("distance", [0.7, 1.5, 2.5, 3.7])
def test_false_alarms_come_as_often_as_chance_has_it(distance: float) -> None:
    """Robots 107 and robots reference 2.9: |d N(0, s)| > s D / 3 in one of the four quarters."""
    once = math.erfc(4.0 / (3.0 * distance) / math.sqrt(2.0))
    expected = 1.0 - (1.0 - once) ** 4
    deviation = math.sqrt(expected * (1.0 - expected) / 600) + 1e-3
    assert rate(distance) == pytest.approx(expected, abs=4 * deviation)


def test_false_alarms_are_rarer_when_near() -> None:
    """Robots 107: more often at larger distance."""
    rates = [rate(distance, 200) for distance in (0.6, 1.2, 2.0, 3.6)]
    assert rates == sorted(rates)
    assert rates[0] < 0.2 < 0.9 < rates[-1]


def test_a_false_alarm_looks_like_a_part() -> None:
    """Its part is named, its place is the middle of the box with the usual error."""
    stage = Stage(false_alarms=(alarm_at(3.0, "Leg"),))
    sensor = stage.make("VictSensor", seed=2)
    places = [place for _ in range(200) for name, place in report(stage, sensor) if name == "Leg"]
    assert len(places) > 100
    assert np.mean(places, axis=0) == pytest.approx([3.0, 0.0, 0.0], abs=0.05)
    assert np.std(places, axis=0) == pytest.approx([0.15] * 3, rel=0.2)


def test_hidden_or_distant_false_alarms_deceive_nobody() -> None:
    """Behind a wall, out of range or out of view there is no false alarm."""
    assert rate(3.5, 50, walls=[wall(2.0)]) == 0.0
    assert rate(5.0, 50) == 0.0
    stage = Stage(false_alarms=(alarm_at(3.0),))
    sensor, robot = stage.make("VictSensor"), FakeRobot()
    robot.place((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert all(report(stage, sensor, robot) == [] for _ in range(20))


def test_equal_seeds_give_equal_reports() -> None:
    """Robots 113: the error comes from the sensor's own stream."""
    stage = Stage(person("Ann", 3.0), false_alarms=(alarm_at(2.5),))
    runs = []
    for seed in (5, 5, 6):
        sensor = stage.make("VictSensor", seed=seed)
        runs.append([report(stage, sensor) for _ in range(3)])
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]
