"""Limits of the gateway by what is on the wire of each robot, in ms of a clock turned by hand."""

from __future__ import annotations

import contextlib
import itertools
import random
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from virtual_station import VirtualPage, VirtualStation

from usarsim_operator.motion import by_class
from usarsim_operator.roles import Role

STOP = by_class("P3AT").stop
ROBOTS = ("R1", "R2", "R3", "R4")


@contextlib.asynccontextmanager
async def _station(
    *names: str, latch: Path | None = None, roles: tuple[Role, ...] = ()
) -> AsyncIterator[tuple[VirtualStation, list[VirtualPage]]]:
    """A station with four robots, and pages by their names."""
    station = VirtualStation(latch)
    for robot in ROBOTS:
        station.spawned(robot)
    kinds = roles or (Role.OPERATOR,) * len(names)
    pages = [VirtualPage(station, name, role) for name, role in zip(names, kinds, strict=True)]
    try:
        yield station, pages
    finally:
        await station.end(*pages)


def _pings(*pages: VirtualPage) -> None:
    for page in pages:
        if not page.page.overrun:
            page.say("ping", clock=0.0)


async def test_emergency_stop_halts_all_within_200_ms(tmp_path: Path) -> None:
    """O-18, CON-15: beside a flood and a page that takes nothing; latched over a restart."""
    latch = tmp_path / "latch.json"
    names = ("Ada", "Flood", "Stalled", "Bob")
    async with _station(*names, latch=latch) as (station, pages):
        ada, flood, stalled, bob = pages
        stalled.stalled.clear()
        turns = itertools.cycle(ROBOTS)
        for robot in ROBOTS:
            assert (await ada.ask("take", robot=robot))["ok"]

        def driving() -> None:
            ada.say("drive", robot=next(turns), left=0.5, right=0.5)
            for _ in range(20):  # 1,000 texts of 1,000 bytes a second
                if not flood.page.limits.exhausted:
                    flood.say("mark", robot="R1", note="x" * 900)
            _pings(bob, stalled)

        await station.run(0.25, driving)
        assert all(station.robots[robot].power > 0.0 for robot in ROBOTS)
        pressed, before = station.clock, len(station.wire)
        bob.say("estop")
        await station.run(0.2, driving)
        for robot in ROBOTS:
            told = [(time, data) for time, name, data in station.wire[before:] if name == robot]
            assert told[0][0] - pressed <= 0.1
            assert {data for _, data in told} == {STOP}
        refused = await ada.ask("drive", robot="R1", left=1.0, right=1.0)
        assert "emergency stop by Bob" in refused["why"]
        assert flood.page.limits.refused > 0
    async with _station("Ada", latch=latch) as (station, (ada,)):
        await ada.ask("take", robot="R1")
        assert not (await ada.ask("drive", robot="R1", left=1.0, right=1.0))["ok"]
        assert (await ada.ask("estop_reset"))["ok"]
        assert (await ada.ask("drive", robot="R1", left=1.0, right=1.0))["ok"]
        await station.run(0.02)
        assert station.told("R1")[-1][1] != STOP


@pytest.mark.parametrize("kind", ["drive", "steer", "fly"])
async def test_power_beyond_the_limit_is_the_limit_and_said(kind: str) -> None:
    """Each text that drives: full power on the wire, the answer says so, and without an id one does
    until the page is within the limit again."""
    names = {
        "drive": ("left", "right"),
        "steer": ("speed", "steer"),
        "fly": ("linear", "altitude", "lateral", "rotational"),
    }[kind]
    async with _station("Ada") as (station, (ada,)):
        station.robots["R1"].motion = by_class("AirRobot" if kind == "fly" else "P3AT")
        await ada.ask("take", robot="R1")
        rest = dict.fromkeys(names, 0.0)

        def drive(power: float) -> dict[str, float]:
            return {**rest, names[0]: power}

        assert (await ada.ask(kind, robot="R1", **drive(1.0)))["why"] == ""
        full = station.told("R1")[-1][1]
        ada.say(kind, robot="R1", **rest)
        await station.settle()
        answer = await ada.ask(kind, robot="R1", **drive(7.5))
        assert (answer["ok"], station.told("R1")[-1][1]) == (True, full)
        assert answer["why"] == f"{names[0]} 7.5 is beyond the limit: 1 is taken"

        def untold() -> list[str]:
            return [one["why"] for one in ada.texts if one["type"] == "answer" and not one["id"]]

        for power in (-2.0, -2.0, -2.0, 0.5, 1e300):
            ada.say(kind, robot="R1", **drive(power))
            await station.run(0.1)
        assert [one.partition(" is ")[0] for one in untold()] == [
            f"{names[0]} -2",
            f"{names[0]} 1e+300",
        ]
        assert station.told("R1")[-1][1] == full


@pytest.mark.parametrize("how", ["silent", "gone", "mute"])
async def test_watchdog_within_500_ms(how: str) -> None:
    """O-19: commands cease, page closed or lost; and a page that falls silent altogether."""
    async with _station("Ada", "Bob") as (station, (ada, bob)):
        await ada.ask("take", robot="R1")
        ada.say("drive", robot="R1", left=0.5, right=0.5)
        await station.run(0.04, lambda: _pings(ada, bob))
        assert station.told("R1")[-1][1] != STOP
        last = station.clock - 0.04
        if how == "gone":
            station.leave(ada.page)
        pinging = (bob,) if how == "mute" else (ada, bob)
        await station.run(0.46 if how != "gone" else 0.02, lambda: _pings(*pinging))
        time, data = station.told("R1")[-1]
        assert data == STOP
        assert time - last <= 0.5
        if how == "mute":
            await station.run(3.0, lambda: _pings(bob))
            assert ada.page.id not in station.pages
            assert "R1" not in station.arbiter.holders


async def test_hundred_races_of_two_operators() -> None:
    """CON-13: one winner each, the loser learns of whom; consent, force, each with both ids."""
    names, roles = ("Ada", "Bob", "Ina"), (Role.OPERATOR, Role.OPERATOR, Role.INSTRUCTOR)
    async with _station(*names, roles=roles) as (station, (ada, bob, ina)):
        dice = random.Random(13)
        for _ in range(100):
            station.clock += 1.0  # of their allowance
            first, second = dice.sample((ada, bob), 2)
            first.say("take", robot="R1", id=1)
            second.say("take", robot="R1", id=2)
            await station.settle()
            assert station.arbiter.holders["R1"].page == first.page.id
            asked = [one for one in first.texts if one["type"] == "asked"][-1]
            assert asked["page"] == second.page.id
            refused = await second.ask("drive", robot="R1", left=1.0, right=1.0)
            assert refused["why"] == f"{first.page.name} holds R1"
            began = station.clock
            first.say("reply", robot="R1", to=second.page.id, grant=True)
            await station.settle()
            assert station.clock - began < 0.5
            assert station.arbiter.holders["R1"].page == second.page.id
            what, facts = station.notes[-1]
            assert (what, facts["page"], facts["holder"]) == (
                "was granted",
                second.page.id,
                first.page.id,
            )
            assert (await ina.ask("take", robot="R1", force=True))["ok"]
            what, facts = station.notes[-1]
            assert (what, facts["page"], facts["holder"]) == (
                "took by force",
                ina.page.id,
                second.page.id,
            )
            assert (await ina.ask("hand_back", robot="R1"))["ok"]
            for page in (ada, bob, ina):
                page.texts.clear()


async def test_no_drive_without_the_lock() -> None:
    """CON-14: of 1,000 DRIVEs of a page without the lock none is on the wire."""
    async with _station("Ada", "Bob") as (station, (ada, bob)):
        await ada.ask("take", robot="R1")
        await station.settle()
        before, sent = len(station.wire), 0

        def press() -> None:
            nonlocal sent
            _pings(ada, bob)
            bob.say("drive", robot="R1", left=1.0, right=1.0, id=sent)
            sent += 1

        await station.run(20.0, press)
        assert sent == 1000
        assert len(station.wire) == before
        refusals = [one for one in bob.texts if one["type"] == "answer"]
        assert len(refusals) == 1000
        assert {one["why"] for one in refusals} == {"Ada holds R1"}


def _report(station: VirtualStation, robot: str, x: float = 0.0, roll: float = 0.0) -> None:
    time = station.clock - 100.0
    station.hear(
        robot,
        f"SEN {{Time {time:.4f}}} {{Type GroundTruth}} {{Name G}} {{Location {x:.3f},0,0}} "
        f"{{Orientation {roll:.3f},0,0}}",
    )


def _status(station: VirtualStation, robot: str, battery: int) -> None:
    time = station.clock - 100.0
    station.hear(robot, f"STA {{Type GroundVehicle}} {{Time {time:.4f}}} {{Battery {battery}}}")


@pytest.mark.parametrize("kind", ["battery", "tipped", "stuck", "link", "stale", "collision"])
async def test_alarm_within_500_ms_once_and_acknowledged(kind: str) -> None:
    """CON-17: raised at most 500 ms after its cause, once, gone from sight when acknowledged."""
    async with _station("Ada") as (station, (ada,)):
        await ada.ask("take", robot="R1")
        beats = 0
        happens = False

        def world() -> None:
            nonlocal beats
            beats += 1
            _pings(ada)
            ada.say("drive", robot="R1", left=0.5, right=0.5)
            if beats % 5:
                return
            moved = 0.0 if happens and kind == "stuck" else station.clock / 10.0
            for robot in ROBOTS:
                if happens and robot == "R1" and kind == "link":
                    continue
                chosen = robot == "R1" and happens
                _report(station, robot, moved, 0.9 if chosen and kind == "tipped" else 0.0)
                _status(station, robot, 100 if chosen and kind == "battery" else 1000)
                touched = chosen and kind == "collision"
                station.hear(robot, f"SEN {{Type Touch}} {{Name Front1}} {{Touch {touched}}}")
                if not (chosen and kind == "stale"):
                    station.hear(robot, "SEN {Type Sonar} {Name F1} {Range 2.0}")

        await station.run(3.0, world)
        assert ada.alarms == []
        happens = True
        due = {"stuck": 3.0, "link": 1.0, "stale": 1.0}.get(kind, 0.0)
        await station.run(max(due - 0.1, 0.0), world)
        assert ada.alarms == []
        await station.run(0.1 + 0.5 if due else 0.5, world)
        assert ada.alarms == [("R1", kind)]
        await station.run(5.0, world)
        raised = [facts for what, facts in station.notes if what.startswith("alarm")]
        assert len(raised) == 1
        assert (await ada.ask("acknowledge", alarm=raised[0]["alarm"]))["ok"]
        await station.run(1.0, world)
        assert ada.alarms == []
        assert len([1 for what, _ in station.notes if what.startswith("alarm")]) == 1


async def test_ages_are_never_negative_and_stand_with_the_world() -> None:
    """CON-17, CON-19: what comes while the world is paused, or late, is no older and no younger for
    it; a robot of a slowed world is not lost."""
    async with _station("Ada") as (station, (ada,)):
        clock = {"type": "clock", "paused": False, "speed": 1.0}
        station.scene = SimpleNamespace(clock=clock, features={}, present=None)  # type: ignore[assignment]

        def ages(key: str) -> list[float]:
            rows = [one for one in ada.texts if one["type"] == "state"][-1]["robots"]
            return [row[key] if key != "link" else row[key]["age"] for row in rows]

        def reports() -> None:
            _pings(ada)
            for robot in ROBOTS:
                _report(station, robot)

        await station.run(1.0, reports)
        clock["paused"] = True
        station._told(clock)
        station.clock += 9.0  # the gateway does nothing for a while
        reports()
        await station.run(3.0, lambda: _pings(ada))
        assert ada.alarms == []
        assert ages("pose_age") == pytest.approx([0.0] * len(ROBOTS), abs=0.03)
        assert min(ages("link")) >= 0.0
        clock.update(paused=False, speed=0.25)
        station._told(clock)
        await station.run(3.0, lambda: _pings(ada))  # 0.75 s of the world
        assert ada.alarms == []
        assert ages("link") == pytest.approx([0.75] * len(ROBOTS), abs=0.15)
        await station.run(3.0, lambda: _pings(ada))
        assert {kind for _, kind in ada.alarms} == {"link"}
        station.scene = None


async def test_calm_run_has_no_alarm() -> None:
    """CON-17: ten calm minutes of reports at their usual rates, with pauses of the driver."""
    async with _station("Ada") as (station, (ada,)):
        await ada.ask("take", robot="R1")
        x, beats, dice = 0.0, 0, random.Random(17)

        def world() -> None:
            nonlocal x, beats
            beats += 1
            driving = beats % 300 < 200
            if beats % 5 == 0:
                _pings(ada)
                if driving:
                    ada.say("drive", robot="R1", left=0.3, right=0.3)
                    x += 0.03
                for robot in ROBOTS:
                    if dice.random() < 0.9:
                        _report(station, robot, x if robot == "R1" else 0.0)
                        _status(station, robot, 1200 - beats // 50)
            if beats % 50 == 0:
                ada.texts.clear()

        station.clock = 100.0
        await station.run(600.0, world)
        assert beats == 30_000
        assert not [what for what, _ in station.notes if what.startswith("alarm")]


async def test_fifty_pages_leave_nothing() -> None:
    """CON-23: after 50 pages came and went, nothing of them is kept."""
    async with _station("Ada") as (station, (ada,)):
        await ada.ask("take", robot="R1")
        for number in range(50):
            page = VirtualPage(station, f"P{number}", Role.OPERATOR)
            assert (await page.ask("take", robot="R2"))["ok"]
            page.say("take", robot="R1", id=9)
            page.say("drive", robot="R2", left=0.5, right=0.5)
            await station.run(0.06, lambda page=page: _pings(ada, page))
            station.leave(page.page)
            page.task.cancel()
            await station.run(0.06, lambda: _pings(ada))
        assert list(station.pages) == [ada.page.id]
        assert list(station.arbiter.holders) == ["R1"]
        assert not station.asked
        assert station.told("R2")[-1][1] == STOP
        assert station.watchdog.silent(1e9) == [ada.page.id]
