"""HRI-08: the gateway knows how far a page's clock is from its own."""

from __future__ import annotations

import random

import pytest

from usarsim_operator.page_clock import PageClock

AHEAD = 1234.5


def _rounds(clock: PageClock, rounds: int, *, out: float = 0.0, back: float = 0.0) -> list[bool]:
    """Pings every second on ways that take 1 ms and up to 200 ms more; what `round` returned."""
    dice, told = random.Random(3), []
    for n in range(rounds):
        said = 1.0 * n
        there = 0.001 + out + 0.2 * dice.random() ** 3
        here = 0.001 + back + 0.2 * dice.random() ** 3
        clock.ping(said, said + AHEAD + there)
        told.append(clock.round(said, there + here))
    return told


def test_offset_is_that_of_the_quickest_rounds() -> None:
    """HRI-08: within 5 ms although the median way takes 25 ms, and told when it becomes better."""
    clock = PageClock()
    told = _rounds(clock, 100)
    assert clock.offset == pytest.approx(AHEAD, abs=0.005)
    assert 0.002 <= clock.rtt < 0.02
    assert told[0]
    assert 1 < sum(told) < 40


def test_offset_follows_a_clock_that_drifts() -> None:
    clock = PageClock()
    for n in range(200):
        clock.ping(n, AHEAD + 1.001 * n)
        clock.round(n, 0.0)
    assert clock.offset == pytest.approx(AHEAD + 0.001 * 200, abs=0.033)


def test_rounds_of_no_ping_are_passed_over() -> None:
    """A page that claims answers nobody gave, or one twice, changes nothing, and costs nothing."""
    clock = PageClock()
    clock.ping(1.0, AHEAD + 1.0)
    assert clock.round(1.0, 0.0)
    assert not clock.round(1.0, 50.0)
    assert not clock.round(7.0, 50.0)
    assert clock.offset == AHEAD
    for n in range(1000):
        clock.ping(n, 0.0)
    assert len(clock._answered) < 20
