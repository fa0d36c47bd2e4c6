"""When streams are due, on time without drift and in step with others; which ticks of lockstep a
client is told of, and how far the world may go; how long a battery lasts.
"""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.sessions.robots import NO_BATTERY, Battery, Power
from usarsim_server.sessions.schedule import REPORT_GRID, LockstepTicks, Schedule, first_report

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
    """An interval of zero means only when asked (protocol 121)."""
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


@given(st.floats(0.0, 1e4), st.floats(0.0, 5.0), st.sampled_from([REPORT_GRID, 0.1]))
def test_the_first_report_is_on_a_beat_as_the_quiet_period_ends(
    asked: float, took: float, beat: float
) -> None:
    """Never more than a beat early or late; and not before the robot is there (protocol 69, 70)."""
    quiet, now = 0.27, asked + took
    first = first_report(asked, now, quiet, beat)
    assert first / beat == pytest.approx(round(first / beat), abs=1e-5)
    assert first > now
    assert first > asked + 0.25 - 1e-5
    assert first <= max(now, asked + quiet - REPORT_GRID) + beat + 1e-5


def test_without_lockstep_nothing_waits() -> None:
    """No period, no ticks, and answers are not wanted."""
    ticks = LockstepTicks(None)
    ticks.begin(1.0)
    assert (ticks.horizon, ticks.due) == (math.inf, math.inf)
    assert not ticks.passes(5.0)
    assert not ticks.answer(1, 5.0)


def test_the_first_tick_is_where_the_world_stands_or_the_next_one() -> None:
    """Who comes at a tick is waited for at once, who comes between two at the second."""
    ticks = LockstepTicks(0.1)
    ticks.begin(0.3)
    assert ticks.horizon == pytest.approx(0.3)
    assert ticks.due == ticks.horizon
    ticks.begin(0.31)
    assert ticks.horizon == pytest.approx(0.4)


def test_every_tick_is_told_once_and_needs_an_answer() -> None:
    """After a tick nothing is due until the client has answered; then the next one is."""
    ticks = LockstepTicks(0.5)
    ticks.begin(0.0)
    assert ticks.passes(0.0)
    assert not ticks.passes(0.0)
    assert (ticks.horizon, ticks.due) == (0.0, math.inf)
    assert ticks.answer(1, 0.0)
    assert (ticks.horizon, ticks.due) == (0.5, 0.5)
    assert not ticks.passes(0.4)
    assert ticks.passes(0.5)


def test_several_ticks_at_once() -> None:
    """An answer for more ticks, and answers in advance, move the horizon on by as many."""
    ticks = LockstepTicks(0.1)
    ticks.begin(0.0)
    ticks.answer(3, 0.0)
    ticks.answer(1, 0.0)
    assert ticks.horizon == pytest.approx(0.4)


def test_who_is_late_need_not_answer_what_he_missed() -> None:
    """If the world went on while a robot came, its client is told of the last tick only."""
    ticks = LockstepTicks(0.1)
    ticks.begin(0.0)
    assert ticks.passes(1.04)
    assert ticks.horizon == pytest.approx(1.0)


def test_who_was_let_go_is_waited_for_after_the_next_answer() -> None:
    """A client that fell silent may come back."""
    ticks = LockstepTicks(0.1)
    ticks.begin(0.0)
    assert ticks.let_go()
    assert math.isinf(ticks.horizon)
    assert not ticks.let_go()
    assert ticks.answer(1, 2.02)
    assert ticks.horizon == pytest.approx(2.2)


@given(st.floats(0.01, 60.0), st.lists(st.integers(1, 50), max_size=50))
def test_ticks_do_not_drift(period: float, answers: list[int]) -> None:
    """However many ticks have passed, each is a multiple of the period to rounding."""
    ticks = LockstepTicks(period)
    ticks.begin(0.0)
    for number in answers:
        ticks.answer(number, ticks.horizon)
    assert ticks.horizon == sum(answers) * period


def test_value_falls_by_one_a_second_from_1200() -> None:
    """STA shows 1200 at first and one less each second, whatever the robot does (robots 111)."""
    battery = Battery(1200.0)
    assert [battery.remaining_seconds(second) for second in range(1202)] == [
        *range(1200, -1, -1),
        0,
    ]


def test_value_is_truncated_between_whole_seconds() -> None:
    """Within a second the value is cut off, as the original's integer was."""
    battery = Battery(1200.0)
    assert battery.remaining_seconds(0.004) == 1199
    assert battery.remaining_seconds(0.996) == 1199
    assert battery.remaining_seconds(1.004) == 1198


def test_sums_of_time_steps_do_not_lose_a_second() -> None:
    """250 steps of 4 ms are one second although their sum is not, in binary."""
    elapsed = sum([0.004] * 250)
    assert elapsed != 1.0
    assert Battery(1200.0).remaining_seconds(elapsed) == 1199


def test_empty_at_the_end_of_life_and_not_before() -> None:
    """At zero the battery is empty, and it stays so (robots 111)."""
    battery = Battery(60.0)
    assert not battery.empty(0.0)
    assert not battery.empty(59.99)
    assert battery.remaining_seconds(59.99) == 0
    assert battery.empty(60.0)
    assert battery.empty(1e9)


def test_life_from_init() -> None:
    """INIT's Battery sets the life in seconds (protocol reference 3.2)."""
    battery = Battery(life=3600.0)
    assert battery.remaining_seconds(0.0) == 3600
    assert battery.remaining_seconds(3600.0) == 0


@pytest.mark.parametrize("life", [0.0, -5.0, math.nan, -math.inf, math.inf])
def test_silly_life_is_an_empty_battery(life: float) -> None:
    """A life that is no positive number is an empty battery, not an error."""
    battery = Battery(life)
    assert battery.remaining_seconds(0.0) == 0
    assert battery.empty(0.0)


def test_robots_without_battery_print_99999() -> None:
    """The value of a robot without a battery is 99999 (robots 112), and none prints more."""
    assert NO_BATTERY == 99999
    assert Battery(1e9).remaining_seconds(0.0) == 99999


def test_clock_before_spawning_counts_as_spawning() -> None:
    """A snapshot from just before the spawn shows a full battery."""
    assert Battery(1200.0).remaining_seconds(-0.004) == 1200


@given(st.floats(1.0, 1e5), st.floats(0.0, 2e5), st.floats(0.0, 2e5))
def test_value_never_rises_and_empty_agrees_with_it(life: float, one: float, other: float) -> None:
    """The value falls with time, is never negative, and is zero once the battery is empty."""
    battery = Battery(life)
    early, late = sorted((one, other))
    assert battery.remaining_seconds(early) >= battery.remaining_seconds(late) >= 0
    if battery.empty(late):
        assert battery.remaining_seconds(late) == 0


def test_power_shows_the_battery_from_the_first_snapshot_on() -> None:
    """Side channels 64: empty from the last whole second on, as STA prints it; robots without a
    battery, or whose pilot has not begun, never."""
    power = Power()
    assert power.seconds(1e9) == NO_BATTERY
    power.battery = Battery(3.0)
    assert power.seconds(1e9) == NO_BATTERY
    power.spawned = 1.0
    assert [power.seconds(time) for time in (1.0, 2.5, 3.5, 9.0)] == [3, 1, 0, 0]
    assert [power.empty(time) for time in (1.0, 3.9, 4.0, 9.0)] == [False, False, True, True]
