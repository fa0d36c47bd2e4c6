"""When streams are due: on time without drift, in step with others."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.sessions.schedule import BEAT, Schedule, first_report

INTERVALS = st.lists(st.sampled_from([0.0, 0.05, 0.1, 0.2, 0.25, 0.3, 1.0]), min_size=1, max_size=8)


def begun(intervals: list[float], start: float = 0.0) -> Schedule:
    """A schedule whose streams report first at a time (s)."""
    schedule = Schedule(intervals, lambda now: start)
    assert schedule.take_due(0.0) == []
    return schedule


def test_the_first_snapshot_starts_the_clock() -> None:
    """It is due at once, reports nothing, and tells when all streams begin."""
    schedule = Schedule([0.1, 0.2], lambda now: now + 0.25)
    assert schedule.due == 0.0
    assert schedule.take_due(100.0) == []
    assert schedule.due == pytest.approx(100.25)
    assert schedule.take_due(100.25) == [0, 1]


def test_streams_on_request_are_never_due() -> None:
    """An interval of zero means only when asked (check 121)."""
    assert math.isinf(begun([0.0, 0.0], 1.0).due)
    assert math.isinf(begun([]).due)


@given(INTERVALS, st.floats(0.0, 1e4), st.sampled_from([0.001, 0.004, 0.005, 0.02]))
def test_reports_come_on_time_and_do_not_drift(
    intervals: list[float], start: float, step: float
) -> None:
    """Looked at in every step, report n of a stream comes in the first step not before its time."""
    schedule = begun(intervals, start)
    counts = [0] * len(intervals)
    for number in range(400):
        now = start + number * step
        for index in schedule.take_due(now):
            ideal = start + counts[index] * intervals[index]
            assert -1e-5 <= now - ideal < step + 1e-5
            counts[index] += 1
        assert schedule.due > now
    for count, interval in zip(counts, intervals, strict=True):
        expected = math.floor(399 * step / interval + 1e-3) + 1 if interval else 0
        assert abs(count - expected) <= 1


def test_no_stream_reports_more_often_than_there_are_steps() -> None:
    """With steps longer than the interval there is one report a step, and none is owed later."""
    schedule = begun([0.01])
    for number in range(20):
        assert schedule.take_due(0.016 * number) == [0]
    assert schedule.due == pytest.approx(0.31)


def test_a_new_interval_counts_from_the_next_report() -> None:
    """A change of dialect moves no report that is already due; the others keep their beat."""
    schedule = begun([0.1, 0.2])
    schedule.take_due(0.0)
    schedule.set_intervals([0.1, 0.5])
    assert schedule.take_due(0.2) == [0, 1]
    assert schedule.take_due(0.65) == [0]
    assert schedule.take_due(0.7) == [0, 1]


@given(st.floats(0.0, 1e4), st.floats(0.0, 5.0), st.sampled_from([BEAT, 0.1]))
def test_the_first_report_is_on_a_beat_as_the_quiet_period_ends(
    asked: float, took: float, beat: float
) -> None:
    """Never more than a beat early or late; and not before the robot is there (checks 69, 70)."""
    quiet, now = 0.27, asked + took
    first = first_report(asked, now, quiet, beat)
    assert first / beat == pytest.approx(round(first / beat), abs=1e-5)
    assert first > now
    assert first > asked + 0.25 - 1e-5
    assert first <= max(now, asked + quiet - BEAT) + beat + 1e-5
