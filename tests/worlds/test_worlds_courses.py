"""Courses: trapezoidal profiles from any state of motion to rest at a target."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.worlds.machinery.courses import Course

places = st.floats(-20.0, 20.0)
limits = st.floats(0.05, 5.0)


@given(places, places, limits, limits)
def test_a_course_from_rest_arrives_within_its_limits(
    start: float, target: float, speed: float, acceleration: float
) -> None:
    """It begins where it is, ends at the target at rest, and is never faster than it may be."""
    course = Course(3.0, start, 0.0, target, speed, acceleration)
    assert course.at(3.0) == (start, 0.0)
    place, velocity = course.at(course.end + 1e-6)
    assert place == pytest.approx(target, abs=1e-6)
    assert velocity == pytest.approx(0.0, abs=1e-6)
    for share in range(11):
        now, moving = course.at(3.0 + (course.end - 3.0) * share / 10.0)
        assert abs(moving) <= speed + 1e-9
        assert min(start, target) - 1e-9 <= now <= max(start, target) + 1e-9


@given(places, places, places, limits, limits, st.floats(0.0, 1.0))
def test_redirecting_makes_no_jump(
    start: float, first: float, second: float, speed: float, acceleration: float, share: float
) -> None:
    """Place and velocity go on as they were at the moment of the change of mind."""
    course = Course(0.0, start, 0.0, first, speed, acceleration)
    moment = course.end * share
    other = course.redirected(moment, second)
    assert other.at(moment) == course.at(moment)
    assert other.at(other.end + 1e-6)[0] == pytest.approx(second, abs=1e-6)
    before = course.at(moment)
    after = other.at(moment + 1e-4)
    assert abs(after[1] - before[1]) <= acceleration * 1e-4 + 1e-9
    assert abs(after[0] - before[0]) <= (speed + acceleration * 1e-4) * 1e-4 + 1e-9


@given(places, places, limits, limits, st.floats(0.0, 1.0))
def test_stopping_takes_the_braking_distance(
    start: float, target: float, speed: float, acceleration: float, share: float
) -> None:
    """Told to stop, it comes to rest v^2 / 2a further on, after v / a."""
    course = Course(0.0, start, 0.0, target, speed, acceleration)
    moment = course.end * share
    place, velocity = course.at(moment)
    stopped = course.redirected(moment, None)
    assert stopped.end - moment == pytest.approx(abs(velocity) / acceleration, abs=1e-6)
    way = abs(stopped.at(stopped.end + 1.0)[0] - place)
    assert way == pytest.approx(velocity**2 / (2.0 * acceleration), abs=1e-6)


def test_the_textbook_example() -> None:
    """10 m at 2 m/s with 1 m/s^2: 2 s up, 3 s even, 2 s down."""
    course = Course(0.0, 0.0, 0.0, 10.0, 2.0, 1.0)
    assert course.end == pytest.approx(7.0)
    assert course.at(2.0) == pytest.approx((2.0, 2.0))
    assert course.at(5.0) == pytest.approx((8.0, 2.0))
    assert course.at(6.0) == pytest.approx((9.5, 1.0))


def test_too_fast_to_stop_in_time() -> None:
    """At 2 m/s, 1 m before the target and with 1 m/s^2, it overshoots by 1 m and returns."""
    course = Course(0.0, 0.0, 2.0, 1.0, 2.0, 1.0)
    assert course.at(2.0) == pytest.approx((2.0, 0.0))
    assert course.at(course.end) == pytest.approx((1.0, 0.0), abs=1e-9)
