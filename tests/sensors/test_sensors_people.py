"""Detectors of moving people, and lines of sight (robots 110)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from life_fakes import Stage, person, wall
from sensor_fakes import UDK, UT2004, FakeRobot, values

from usarsim_server.sensors.people import in_sight, relative, sight_lines, within_cone
from usarsim_server.sensors.report import sen_lines
from usarsim_server.simulation.frames import IDENTITY, Pose, pose_from_wire
from usarsim_server.simulation.rays.query import RayHits

WALK: dict[str, Any] = {"kind": "walk", "to": [2.0, 1.0, -0.07], "speed": 0.5, "pause": 4.0}


def probability(stage: Stage, time: float = 3.0, **rest: Any) -> float:
    """What a sensor in the origin says at a time."""
    sensor = stage.make("HumanMotion", **rest)
    assert stage.read(sensor, FakeRobot(time=time))
    value: float = sensor.probability
    return value


@pytest.mark.parametrize("motion", ["wave", WALK])
def test_only_moving_people_are_noticed(motion: Any) -> None:
    """Robots 110: a still victim gives 0, the same one waving or walking does not."""
    assert probability(Stage(person("Ann", 2.0))) == 0.0
    assert probability(Stage(person("Ann", 2.0, motion=motion)), time=1.0) > 0.2


def test_somebody_who_pauses_is_not_noticed() -> None:
    """While he walks, yes; once he has turned round and stands, no."""
    stage = Stage(person("Bob", 2.0, motion={**WALK, "pause": 1000.0}))
    assert probability(stage, 1.0) > 0.2
    assert probability(stage, 30.0) < 0.01


def test_a_waving_arm_is_noticed_all_the_time() -> None:
    """Also at its turning points, where it stands still for a moment."""
    stage = Stage(person("Ann", 2.0, motion="wave"))
    sensor = stage.make("HumanMotion")
    seen = []
    for step in range(80):
        stage.read(sensor, FakeRobot(time=0.1 * step))
        seen.append(sensor.probability)
    assert min(seen) > 0.2


def test_the_probability_falls_with_the_distance() -> None:
    """From near 1 at the sensor to 0 at the maximum range."""
    fast = {**WALK, "speed": 2.0, "pause": 0.1}
    found = []
    for distance in (0.8, 2.0, 4.0, 6.0):
        walk = {**fast, "to": [distance, 0.5, -0.07]}
        stage = Stage(person("Bob", distance, -0.5, motion=walk))
        found.append(probability(stage, 3.0))
    assert found == sorted(found, reverse=True)
    assert found[0] == pytest.approx(1.0 - 0.8 / 5.0, abs=0.07)
    assert found[-1] == 0.0


def test_slow_movement_is_less_likely_somebody() -> None:
    """Below the full speed the probability falls in proportion."""
    found = [
        probability(Stage(person("Bob", 2.0, motion={**WALK, "speed": speed})), 1.0)
        for speed in (0.06, 0.12, 0.3, 0.6)
    ]
    assert found[1] == pytest.approx(2 * found[0], rel=0.05)
    assert found[3] == pytest.approx(found[2], rel=0.1)


def test_walls_and_the_field_of_view_hide_movement() -> None:
    """Nothing through a wall, behind the sensor or beyond its cone."""
    waving = person("Ann", 2.0, motion="wave")
    assert probability(Stage(waving, walls=[wall(1.0)])) == 0.0
    assert probability(Stage(person("Ann", -2.0, motion="wave"))) == 0.0
    assert probability(Stage(waving), fov=0.05) == 0.0
    assert probability(Stage(person("Ann", -2.0, motion="wave")), fov=math.tau) > 0.2


def test_the_likeliest_counts() -> None:
    """Two people are as likely as the nearer one alone."""
    near, far = person("Ann", 1.5, motion="wave"), person("Bob", 3.5, 0.5, motion="wave")
    assert probability(Stage(near, far)) == probability(Stage(near)) > probability(Stage(far))


def test_the_form_of_the_line() -> None:
    """Protocol reference 4.6 and robots 96: Prob with four digits, no Time in ut2004."""
    stage = Stage()
    sensor = stage.make("HumanMotion", "HumanMotion")
    stage.read(sensor)
    data = "{Type HumanMotion} {Name HumanMotion} {Prob 0.0000}"
    assert sen_lines([sensor], 5.0, UT2004) == [f"SEN {data}"]
    assert sen_lines([sensor], 5.0, UDK) == [f"SEN {{Time 5.0000}} {data}"]
    assert list(values(sensor)) == ["Prob"]


@pytest.mark.parametrize(
    ("point", "inside"),
    [
        ((2.0, 0.0, 0.0), True),
        ((2.0, 1.9, 0.0), True),
        ((2.0, 2.1, 0.0), False),
        ((2.0, 0.0, -1.9), True),
        ((-1.0, 0.0, 0.0), False),
        ((3.1, 0.0, 0.0), False),
        ((0.0, 0.0, 0.0), True),
    ],
)
def test_the_cone_is_round(point: tuple[float, float, float], inside: bool) -> None:
    """Half a field of view of 90 degrees to every side, up to 3 m."""
    assert within_cone(IDENTITY, point, math.pi / 2, 3.0) is inside


POINT = st.tuples(*[st.floats(-50, 50)] * 3)
HERE = Pose((1.0, 2.0, 3.0))


@given(POINT, st.tuples(*[st.floats(-3, 3)] * 3), POINT)
def test_relative_places_lead_back_to_the_point(place, turn, point) -> None:
    """The sensor's pose applied to the relative place is the point again."""
    sensor = pose_from_wire(place, turn)
    x, y, z = relative(sensor, point)
    assert (sensor @ Pose((x, -y, -z))).position == pytest.approx(point, abs=1e-9)


@given(st.lists(POINT, min_size=1, max_size=8))
def test_every_point_has_its_ray(points) -> None:
    """Unit vectors toward the points, long enough for the farthest."""
    (fan,) = sight_lines(HERE, points)
    lengths = [math.dist(point, HERE.position) for point in points]
    assert np.linalg.norm(fan.directions, axis=1) == pytest.approx(np.ones(len(points)))
    ends = fan.origin + fan.directions * np.array(lengths)[:, None]
    far = np.array(lengths) > 1e-6
    assert ends[far] == pytest.approx(np.array(points)[far], abs=1e-6)
    assert fan.max_range >= max(lengths) - 1e-9


def test_no_points_need_no_rays() -> None:
    """Nothing to look at, nothing to ask."""
    assert sight_lines(HERE, []) == ()
    assert in_sight(HERE, [], []) == []


def test_what_ends_at_the_point_does_not_hide_it() -> None:
    """A hit up to 0.2 m before the point is the thing itself; anything nearer hides it."""
    points = [(5.0, 2.0, 3.0)] * 4
    hits = [RayHits(np.array([np.inf, 3.85, 3.75, 0.5]))]
    assert in_sight(HERE, points, hits) == [True, True, False, False]


def test_nobody_hides_himself() -> None:
    """A part of the same victim in the way does not count, another victim's does."""
    points = [(5.0, 2.0, 3.0)] * 4
    names = ("victim:A:FootLeft", "victim:B:Chest", "wall", None)
    hits = [RayHits(np.full(4, 1.0), None, names)]
    assert in_sight(HERE, points, hits, ["A", "A", "A", None]) == [True, False, False, False]
    assert in_sight(HERE, points, hits) == [False] * 4
