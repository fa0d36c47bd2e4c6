"""A port's share of the processor: who waits, for how long, and what all get together."""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable

import pytest

from usarsim_server.services.budget import (
    BURST,
    LEAST,
    ON_PACE,
    TURN_COST,
    WINDOW,
    Account,
    Pace,
    WorkBudget,
)

SHARE = 0.05


class Clock:
    """Time that passes when a test says so; work takes as long as the test charges."""

    def __init__(self) -> None:
        self.now = 0.0
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._number = 0

    def __call__(self) -> float:
        return self.now

    def call_later(self, seconds: float, act: Callable[[], None]) -> None:
        """Remember what is to be done."""
        self._number += 1
        heapq.heappush(self._timers, (self.now + seconds, self._number, act))

    async def run_until(self, moment: float) -> None:
        """Let time pass, and everybody do what is due."""
        while self._timers and self._timers[0][0] <= moment:
            self.now, _, act = heapq.heappop(self._timers)
            act()
            for _ in range(5):
                await asyncio.sleep(0)
        self.now = moment

    def budget(self, share: float = SHARE) -> WorkBudget:
        """A budget in this time."""
        return WorkBudget(share, clock=self, work_clock=self, call_later=self.call_later)


async def insist(budget: WorkBudget, cost: float, turns: list[float], clock: Clock) -> None:
    """Work without pause."""
    account = budget.newcomer()
    while True:
        await budget.turn(account)
        budget.charge(account, cost)
        turns.append(clock.now)


def test_thirty_who_insist_get_the_share_and_no_more() -> None:
    """In ten seconds all together use what is theirs, what was saved up, and one turn."""

    async def play() -> float:
        clock = Clock()
        budget, turns = clock.budget(), list[float]()
        greedy = [asyncio.create_task(insist(budget, 0.001, turns, clock)) for _ in range(30)]
        await asyncio.sleep(0)
        await clock.run_until(10.0)
        for one in greedy:
            one.cancel()
        return len(turns) * (0.001 + TURN_COST)

    used = asyncio.run(play())
    assert 0.9 * 10 * SHARE < used <= 10 * SHARE + BURST + 0.002


def test_who_asks_little_waits_for_one_turn_of_the_others_and_not_for_all() -> None:
    """Ten requests a second beside thirty clients that insist: each is served within the time that
    pays for two turns, where a queue would take that of thirty."""

    async def play() -> list[float]:
        clock = Clock()
        budget, turns = clock.budget(), list[float]()
        greedy = [asyncio.create_task(insist(budget, 0.001, turns, clock)) for _ in range(30)]
        modest, waits = budget.newcomer(), list[float]()

        async def ask() -> None:
            asked = clock.now
            await budget.turn(modest)
            budget.charge(modest, 0.0001)
            waits.append(clock.now - asked)

        for number in range(100):
            await clock.run_until(2.0 + 0.1 * number)
            greedy.append(asyncio.create_task(ask()))
            await asyncio.sleep(0)
        await clock.run_until(13.0)
        for one in greedy:
            one.cancel()
        return waits

    waits = asyncio.run(play())
    assert len(waits) == 100
    assert max(waits) <= 2.5 * (0.001 + TURN_COST) / SHARE


def test_nobody_waits_while_there_is_time() -> None:
    """What was saved up is there at once, and silence saves no more than that."""

    async def play() -> int:
        clock = Clock()
        budget, turns = clock.budget(), list[float]()
        await clock.run_until(1000.0)
        eager = asyncio.create_task(insist(budget, 0.001 - TURN_COST, turns, clock))
        await asyncio.sleep(0)
        eager.cancel()
        return len(turns)

    assert asyncio.run(play()) == pytest.approx(BURST / 0.001, abs=1.5)


def test_who_has_gone_keeps_nobody_waiting() -> None:
    """A client that leaves the queue takes no turn."""

    async def play() -> int:
        clock = Clock()
        budget = clock.budget()
        budget.charge(budget.newcomer(), 1.0)
        waiting = [asyncio.create_task(budget.turn(Account())) for _ in range(3)]
        await asyncio.sleep(0)
        assert budget.waiting == 3
        for one in waiting[:2]:
            one.cancel()
        await asyncio.sleep(0)
        assert budget.waiting == 1
        await clock.run_until(100.0)
        return sum(one.done() and not one.cancelled() for one in waiting)

    assert asyncio.run(play()) == 1


def test_work_is_charged_by_its_processor_time() -> None:
    """What happens inside, as the clock of the thread says."""

    async def play() -> float:
        clock = Clock()
        budget = clock.budget()
        account = budget.newcomer()
        before = account.used
        with budget.work(account):
            clock.now += 0.25
        return account.used - before

    assert asyncio.run(play()) == pytest.approx(0.25)


def test_a_world_that_falls_behind_comes_first() -> None:
    """On pace the whole share, at any speed; 0.05 below it half; far behind the least; and back."""
    clock, simulated = Clock(), 0.0

    def play(factor: float) -> float:
        nonlocal simulated
        clock.now += WINDOW
        simulated += 2.0 * factor * WINDOW
        return pace()

    pace = Pace(lambda: simulated, 2.0, clock)
    assert pace() == 1.0
    assert play(1.0) == play(ON_PACE + 0.001) == 1.0
    assert play(ON_PACE - 0.05) == pytest.approx(0.5)
    assert play(0.5) == play(0.0) == LEAST
    assert play(1.0) == 1.0


def test_a_port_waits_while_the_world_is_behind() -> None:
    """What thirty who insist get is the part of the share that the pace allows."""

    async def play() -> float:
        clock = Clock()
        budget = WorkBudget(
            SHARE, clock=clock, work_clock=clock, call_later=clock.call_later, pace=lambda: LEAST
        )
        turns = list[float]()
        greedy = [asyncio.create_task(insist(budget, 0.001, turns, clock)) for _ in range(30)]
        await asyncio.sleep(0)
        await clock.run_until(10.0)
        for one in greedy:
            one.cancel()
        return len(turns) * (0.001 + TURN_COST)

    assert asyncio.run(play()) <= 10 * SHARE * LEAST + BURST + 0.002


def test_a_newcomer_does_not_wait_for_a_crowd() -> None:
    """Who comes while thirty insist has his first answer after one turn of theirs or two."""

    async def play() -> float:
        clock = Clock()
        budget, turns, begun = clock.budget(), list[float](), 5.0
        greedy = [asyncio.create_task(insist(budget, 0.001, turns, clock)) for _ in range(30)]
        await asyncio.sleep(0)
        await clock.run_until(begun)
        greedy.append(asyncio.create_task(insist(budget, 0.0001, came := list[float](), clock)))
        await asyncio.sleep(0)
        await clock.run_until(10.0)
        for one in greedy:
            one.cancel()
        return came[0] - begun

    assert asyncio.run(play()) <= 2.5 * (0.001 + TURN_COST) / SHARE
