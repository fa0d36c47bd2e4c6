"""Lines of sight."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.sensors.people import in_sight, relative, sight_lines
from usarsim_server.simulation.frames import Pose, pose_from_wire
from usarsim_server.simulation.rays.query import RayHits

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
