"""The battery."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.sessions.robots import NO_BATTERY, Battery, Power


def test_value_falls_by_one_a_second_from_1200() -> None:
    """STA shows 1200 at first and one less each second, whatever the robot does (5.4 #111)."""
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
    """At zero the battery is empty, and it stays so (5.4 #111)."""
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
    """The value of a robot without a battery is 99999 (5.4 #112), and none prints more."""
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
