"""Lockstep as one client sees it: which ticks it is told of, and how far the world may go."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.sessions.schedule import Ticks


def test_without_lockstep_nothing_waits() -> None:
    """No period, no ticks, and answers are not wanted."""
    ticks = Ticks(None)
    ticks.begin(1.0)
    assert (ticks.horizon, ticks.due) == (math.inf, math.inf)
    assert not ticks.passes(5.0)
    assert not ticks.answer(1, 5.0)


def test_the_first_tick_is_where_the_world_stands_or_the_next_one() -> None:
    """Who comes at a tick is waited for at once, who comes between two at the second."""
    ticks = Ticks(0.1)
    ticks.begin(0.3)
    assert ticks.horizon == pytest.approx(0.3)
    assert ticks.due == ticks.horizon
    ticks.begin(0.31)
    assert ticks.horizon == pytest.approx(0.4)


def test_every_tick_is_told_once_and_needs_an_answer() -> None:
    """After a tick nothing is due until the client has answered; then the next one is."""
    ticks = Ticks(0.5)
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
    ticks = Ticks(0.1)
    ticks.begin(0.0)
    ticks.answer(3, 0.0)
    ticks.answer(1, 0.0)
    assert ticks.horizon == pytest.approx(0.4)


def test_who_is_late_need_not_answer_what_he_missed() -> None:
    """If the world went on while a robot came, its client is told of the last tick only."""
    ticks = Ticks(0.1)
    ticks.begin(0.0)
    assert ticks.passes(1.04)
    assert ticks.horizon == pytest.approx(1.0)


def test_who_was_let_go_is_waited_for_after_the_next_answer() -> None:
    """A client that fell silent may come back."""
    ticks = Ticks(0.1)
    ticks.begin(0.0)
    assert ticks.let_go()
    assert math.isinf(ticks.horizon)
    assert not ticks.let_go()
    assert ticks.answer(1, 2.02)
    assert ticks.horizon == pytest.approx(2.2)


@given(st.floats(0.01, 60.0), st.lists(st.integers(1, 50), max_size=50))
def test_ticks_do_not_drift(period: float, answers: list[int]) -> None:
    """However many ticks have passed, each is a multiple of the period to rounding."""
    ticks = Ticks(period)
    ticks.begin(0.0)
    for number in answers:
        ticks.answer(number, ticks.horizon)
    assert ticks.horizon == sum(answers) * period
