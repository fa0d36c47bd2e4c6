"""The console at a server in lockstep: what counts at which tick decides everything."""

from __future__ import annotations

import asyncio
import json
import math
import random
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from usarsim_client import ProtocolError
from usarsim_operator.pages import Page
from usarsim_operator.pulse import Pulse
from usarsim_operator.recording import Recording
from usarsim_operator.replay import Said, Session, differences, main, replay, session_of
from usarsim_operator.requests import Desk
from usarsim_operator.roles import Role
from usarsim_operator.station import Settings, Station
from usarsim_server.testing import PATIENCE, ServerProcess

ROBOTS = [("R1", "P3AT_real"), ("R2", "P2AT")]
MINUTE = 600  # ticks of 0.1 s


@pytest.fixture
def server() -> Iterator[ServerProcess]:
    """A fresh server in lockstep."""
    with fresh() as one:
        yield one


def fresh() -> ServerProcess:
    """Always the same world."""
    return ServerProcess("--world=empty", "--seed=5", "--lockstep", "--scene-port=0")


def settings(server: ServerProcess, **more: Any) -> Settings:
    """Of a gateway there."""
    scene = "127.0.0.1", server.ports["scene"]
    return Settings("127.0.0.1", server.ports["control"], 1, scene, **more)


async def until(condition: Callable[[], bool]) -> None:
    """Let the loop run until something is so."""
    while True:
        if condition():
            return
        await asyncio.sleep(0.001)


class Hand:
    """A page that says things when it likes, by the wall clock.

    Attributes:
        texts: what it was told.
    """

    def __init__(self, station: Station, name: str, role: Role = Role.OPERATOR) -> None:
        self.texts: list[dict[str, Any]] = []
        self._station, self._desk = station, Desk(station)
        self.page = Page(station.new_id(), name, role, self, station.now)
        station.join(self.page)
        self._tasks = [asyncio.create_task(self.page.send_all())]
        self._tasks.append(asyncio.create_task(self._ping()))

    async def _ping(self) -> None:
        """As pages do, so that they do not count as lost."""
        while True:
            self.say("ping")
            await asyncio.sleep(0.5)

    async def send_str(self, data: str, compress: int | None = None) -> None:
        self.texts.append(json.loads(data))

    async def send_bytes(self, data: bytes, compress: int | None = None) -> None:
        """Nothing to look at."""

    def say(self, type: str, **fields: Any) -> None:
        self._desk.hear(self.page, json.dumps({"type": type, **fields}))

    def go(self) -> None:
        self._station.leave(self.page)
        for task in self._tasks:
            task.cancel()


async def live(station: Station, ticks: int, script: Any, record: Path | None = None) -> Session:
    """A session in which people act at moments that the machine decides."""
    session = Session(station=station)
    station.observers.add(session)
    await station.open()
    if record is not None:
        station.record(record)
    try:
        for name, class_name in ROBOTS:
            await station.spawn(class_name, name)
        pulse = Pulse(station)
        await until(lambda: station.lockstep is not None)  # found out by the first tick
        assert station.lockstep is not None
        acting = asyncio.create_task(script(station))
        async with asyncio.timeout(PATIENCE):
            while station.lockstep.tick < ticks:
                await station.lockstep.round(pulse)
        acting.cancel()
        session.states[round(station.lockstep.time, 6)] = await station.lockstep.state()
        session.ticks = station.lockstep.tick
    finally:
        await station.close()
    return session


async def people(station: Station) -> None:
    """Two pages: drive, rotate, travel, marks, an emergency stop, silence, and one that is lost."""
    dice = random.Random()

    async def wait(tick: int) -> None:
        await until(lambda: station.lockstep is not None and station.lockstep.tick >= tick)
        await asyncio.sleep(dice.random() * 0.003)

    one, two = Hand(station, "Ada"), Hand(station, "Bob")
    await wait(10)
    one.say("take", robot="R1", id=1)
    two.say("take", robot="R2", id=1)
    while (station.lockstep.tick if station.lockstep else 0) < 120:
        one.say("drive", robot="R1", left=dice.random(), right=dice.random())
        two.say("drive", robot="R2", left=0.5, right=dice.choice((-0.5, 0.5)))
        await asyncio.sleep(dice.random() * 0.02)
    one.say("drive", robot="R1", left=0.8, right=0.8)  # and silence: the watchdog stops it
    two.say("rotate", robot="R2", degrees=90.0)
    await wait(200)
    one.say("mark", place=[1.0, 2.0, 0.0], robot="R1", status="unknown", note="a", id=2)
    one.say("travel", robot="R1", metres=1.0)
    one.say("nonsense")
    await wait(330)
    two.say("estop", id=3)
    await wait(350)
    two.say("estop_reset", id=4)
    one.say("drive", robot="R1", left=-0.4, right=0.4)
    await wait(400)
    one.say("take", robot="R2", id=5)
    two.say("drive", robot="R2", left=0.4, right=0.4)
    two.go()
    await wait(450)
    one.say("take", robot="R2", id=6)
    while True:
        one.say("drive", robot="R2", left=dice.random(), right=dice.random())
        await asyncio.sleep(dice.random() * 0.02)


def again(session: Session) -> Session:
    """Replayed at a fresh server."""
    with fresh() as server:
        return asyncio.run(replay(settings(server), session))


@pytest.mark.slow
def test_a_minute_is_the_same_whenever_it_is_replayed(server: ServerProcess) -> None:
    """HRI-09, O-55: robots are told the same bytes at the same ticks, and the world (digest of all
    coordinates and velocities) ends the same to the last bit; one input at another tick: not."""
    station = None

    async def session() -> Session:
        nonlocal station
        station = Station(settings(server, pace=math.inf))
        return await live(station, MINUTE, people)

    then = asyncio.run(session())
    assert then.robots == ROBOTS
    assert {json.loads(one.text)["type"] for one in then.said if one.text} >= {
        *("take", "drive", "rotate", "travel", "mark", "estop", "estop_reset")
    }
    assert len({one.tick for one in then.said}) > 50
    assert [one.on for one in then.said if one.text is None] == [True, True, False]
    now = again(then)
    assert differences(then, now) == []
    assert now.said == then.said
    assert now.sent == then.sent
    assert now.states[60.0] == then.states[60.0]
    late = next(n for n, one in enumerate(then.said) if one.text and '"travel"' in one.text)
    then.said[late] = replace(then.said[late], tick=then.said[late].tick + 1)
    then.ticks = 230
    moved = again(then)
    assert len(differences(then, moved)) >= 1
    assert then.states.keys() & moved.states.keys() >= {20.0, 22.0, 23.0}
    assert then.states[20.0] == moved.states[20.0]
    assert then.states[23.0] != moved.states[23.0]


def test_people_get_their_pace_and_programs_theirs(server: ServerProcess) -> None:
    """At a pace of 2 a simulated second takes half a second, not less; a `drive` that stops coming
    is followed by a stop after 0.45 simulated s; a ping is answered between ticks."""

    async def main() -> None:
        station = Station(settings(server, pace=2.0))
        said: list[int] = []

        async def script(station: Station) -> None:
            hand = Hand(station, "Ada")
            lockstep = station.lockstep
            assert lockstep is not None
            hand.say("ping", clock=1.0)
            hand.say("take", robot="R1")
            hand.say("drive", robot="R1", left=1.0, right=1.0)
            said.append(lockstep.tick)
            await asyncio.sleep(0.001)
            assert any(one["type"] == "pong" for one in hand.texts)

        loop = asyncio.get_running_loop()
        begun = loop.time()
        session = await live(station, 20, script)
        assert loop.time() - begun > 0.9
        told = [(tick, text) for tick, robot, text in session.sent if robot == "R1"]
        moves = [tick for tick, text in told if "Left 100" in text]
        stops = [tick for tick, text in told if moves and tick > moves[-1]]
        assert stops[0] - moves[-1] == 5

    asyncio.run(main())


def test_a_robot_that_a_page_brings_is_there_at_the_same_tick(
    server: ServerProcess, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Time stands still until it is there and known; the program replays a recording of it."""
    file = tmp_path / "session.rec"

    async def script(station: Station) -> None:
        hand = Hand(station, "Ada")
        await until(lambda: station.lockstep is not None and station.lockstep.tick >= 5)
        hand.say("spawn", **{"class": "P3AT", "name": "Late", "id": 1})
        await until(lambda: any(one.get("id") == 1 for one in hand.texts))
        hand.say("take", robot="Late")
        hand.say("drive", robot="Late", left=0.5, right=0.5)

    async def run() -> Session:
        return await live(Station(settings(server, pace=math.inf)), 80, script, file)

    then = asyncio.run(run())
    assert any(robot == "Late" for _, robot, _ in then.sent)
    recorded = session_of(Recording(file))
    assert recorded.said == then.said
    assert recorded.sent == then.sent
    with fresh() as other:
        ports = other.ports
        options = [f"--connect=127.0.0.1:{ports['control']}", f"--scene-port={ports['scene']}"]
        assert main([str(file), *options]) == 0
    assert "the same" in capsys.readouterr().out
    assert main([__file__]) == 2


@pytest.mark.parametrize(("pace", "states"), [(1.0, 24), (math.inf, 6)])
def test_states_come_rarely_while_time_rushes(
    pace: float, states: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every second tick of 1/16 s for people, two a second where time goes as fast as it can."""
    told = list[float]()
    monkeypatch.setattr(Pulse, "_state", lambda pulse, now: told.append(now))

    async def main() -> None:
        station = Station(Settings("127.0.0.1", 1, 1, lockstep=True, pace=pace))
        hand = Hand(station, "one")
        station.pages[hand.page.id] = hand.page  # the next tick would bring it
        pulse, lockstep = Pulse(station), station.lockstep
        assert lockstep is not None
        for tick in range(48):
            lockstep.time = tick / 16
            pulse.beat()
        hand.go()

    asyncio.run(main())
    assert len(told) == states


def test_a_server_that_goes_by_itself_has_no_pacemaker() -> None:
    """Nothing changes there."""
    with ServerProcess("--world=empty") as server:

        async def main() -> None:
            station = Station(Settings("127.0.0.1", server.ports["control"], 1))
            await station.open()
            try:
                driven = await station.spawn("P3AT", "R1")
                async with asyncio.timeout(PATIENCE):
                    await until(lambda: driven.learned)
                assert station.lockstep is None
            finally:
                await station.close()

        asyncio.run(main())


def test_differences_are_named() -> None:
    """The first of each kind; what one log does not know is no difference."""
    then = Session(sent=[(1, "R1", "a"), (2, "R1", "b")], states={1.0: "x", 2.0: "y"}, ticks=5)
    now = Session(sent=[(1, "R1", "a"), (3, "R1", "b")], states={2.0: "z", 3.0: "q"}, ticks=5)
    assert differences(then, then) == []
    told, world = differences(then, now)
    assert "(2, 'R1', 'b')" in told
    assert "2 s" in world
    assert Said(1, 2) == Said(1, 2)
    assert issubclass(ProtocolError, Exception)
