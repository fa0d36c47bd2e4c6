"""Supervising a server through its scene port: lines explained, taking over, the clock."""

from __future__ import annotations

import asyncio
import itertools
import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from usarsim_client.scene import LiveScene, connect_scene
from usarsim_server.assembly import Assembly
from usarsim_server.base.errors import SettingsError
from usarsim_server.options import load_settings
from usarsim_server.services.listener import Endpoint
from usarsim_server.sessions.tap import Row
from usarsim_server.testing import (
    PATIENCE,
    Rehearsal,
    ScriptedClient,
    eventually,
    running_server,
    time_of,
)

Server = tuple[Assembly, dict[str, Endpoint]]


@pytest.fixture
def server() -> Iterator[Server]:
    """A server that may be supervised."""
    with running_server(world="empty", scene_port=0, supervise="on") as (assembly, endpoints):
        yield assembly, dict(endpoints)


def play(main: Callable[[LiveScene], Any], server: Server, **hello: Any) -> Any:
    """Run a client of the scene port that sees lines and clock."""

    async def run() -> Any:
        async with asyncio.timeout(PATIENCE):
            channels = hello.pop("channels", ["lines", "clock"])
            port = server[1]["scene"].port
            async with await connect_scene("127.0.0.1", port, channels=channels, **hello) as scene:
                return await main(scene)

    return asyncio.run(run())


async def reply(scene: LiveScene, request: str, **fields: object) -> dict[str, Any]:
    """Ask and wait for the reply; other news are kept in `seen`."""
    number = await scene.request(request, **fields)
    while True:
        news = await scene.next()
        assert isinstance(news, dict)
        if news["type"] == "reply" and news["id"] == number:
            return news


async def row(scene: LiveScene, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The next row that is wanted."""
    while True:
        news = await scene.next()
        if isinstance(news, dict) and news["type"] == "lines":
            for one in news["rows"]:
                if wanted(one):
                    return dict(one)


def spawned(server: Server, name: str = "R", at: str = "0,0,-0.3") -> ScriptedClient:
    """A legacy client with a robot that reports."""
    client = ScriptedClient(server[1]["control"].port)
    client.send(f"INIT {{ClassName USARBot.P3AT}} {{Name {name}}} {{Location {at}}}")
    client.wait_for("SEN")
    return client


def moved(server: Server, seconds: float = 0.6) -> tuple[float, float]:
    """Way (m) and turn (rad) of the first robot in some simulated time."""
    simulation = server[0].simulation
    body = server[0].robots.vehicles[0].body
    before = body.look()
    assert before is not None
    assert eventually(lambda: simulation.now >= before.time + seconds)
    after = body.look()
    assert after is not None
    x, y, _ = before.pose.inverse().rotate((1.0, 0.0, 0.0))
    u, v, _ = after.pose.inverse().rotate((1.0, 0.0, 0.0))
    way = math.dist(before.pose.position, after.pose.position)
    return way, math.remainder(math.atan2(v, u) - math.atan2(y, x), math.tau)


def test_why_a_line_does_nothing(server: Server) -> None:
    """What a client sends is told with its reading, and with what is wrong about it."""
    client = ScriptedClient(server[1]["control"].port)

    async def main(scene: LiveScene) -> None:
        for line, hint in (
            ("DRIVE {Left 1} {Right 1}", "no robot yet"),
            ("INIT {ClassName USARBot.P3TA}", "did you mean `P3AT`?"),
            ("DRVE {Left 1}", "did you mean `DRIVE`?"),
            ("INIT {ClassName USARBot.P3AT} {Name R} {Loation 1,1,1}", "did you mean `location`?"),
            ("DRIVE {Left abc}", "Left: `abc` is not a number, read as 0"),
            ("DRIVE {Left 1000} {Right 0}", "clamped"),
            ("MISPKG {Name Arm9} {Link 1} {Value 1}", "there is no such actuator"),
            ("SET {Type Nobody} {Name X} {Opcode A} {Params 1}", "no addressee"),
        ):
            client.send(line)
            told = await row(scene, lambda one, line=line: one.get("in") == line)
            assert any(hint in fault for fault in told["faults"]), told
        assert told["robot"] == "R"
        out = await row(scene, lambda one: "out" in one)
        assert out["out"].startswith(("SEN", "STA", "CONF", "GEO"))
        client.send("GETCONF {Type Robot}")
        told = await row(scene, lambda one: one.get("in", "").startswith("GETCONF"))
        assert (told["faults"], told["effect"]) == ([], "answered by 1 line")

    play(main, server)
    assert eventually(lambda: all(one.tap is None for one in server[0].sessions))
    client.close()


def test_taken_over_and_handed_back(server: Server) -> None:
    """A controller drives in a circle; somebody takes the robot, drives it straight, hands it back:
    the circle goes on, and no report is lost meanwhile."""
    client = spawned(server)
    stop, sent = asyncio.Event(), itertools.count()

    async def main(scene: LiveScene) -> None:
        loop = asyncio.get_running_loop()

        async def controller() -> None:
            while not stop.is_set():
                client.send("DRIVE {Left 0.1} {Right 1.2}")
                next(sent)
                await asyncio.sleep(0.05)

        async def drive() -> None:
            while True:
                told = await reply(scene, "drive", robot="r", line="DRIVE {Left 2} {Right 2}")
                assert told["ok"], told
                await asyncio.sleep(0.1)

        async def moves(right: Callable[[float, float], bool]) -> None:
            """Wait until it moves like that: way (m) and turn (rad) of 0.6 simulated s."""
            while not right(*await loop.run_in_executor(None, moved, server)):
                pass

        task = asyncio.create_task(controller())
        await moves(lambda _, turned: abs(turned) > 0.05)
        taken = await reply(scene, "take", robot="R", by="Ada")
        assert taken["ok"], taken
        assert taken["by"].startswith("Ada")
        least = next(sent) + 30
        await moves(lambda way, _: way < 0.01)  # it stands still
        driving = asyncio.create_task(drive())
        await moves(lambda way, turned: way > 0.05 and abs(turned) < 0.03)
        driving.cancel()
        await asyncio.wait([driving])
        assert driving.cancelled(), driving
        await moves(lambda way, _: way < 0.01)  # it stops when its holder is silent
        while next(sent) < least:  # noqa: ASYNC110 (what counts is what was sent)
            await asyncio.sleep(0.05)
        again = await reply(scene, "take", robot="R", by="Bob")
        assert not again["ok"]
        assert "held by Ada" in again["why"]
        back = await reply(scene, "hand_back", robot="R")
        assert back["ok"], back
        assert back["suspended"] > 20
        await moves(lambda _, turned: abs(turned) > 0.05)  # the circle goes on
        stop.set()
        await task

    play(main, server, streams=False)
    told = [line for line in client.listen(0.5) if line.startswith("SEN") and "Odometry" in line]
    times = [moment for line in told if (moment := time_of(line)) is not None]
    assert len(times) > 20
    assert all(later - earlier < 0.25 for earlier, later in itertools.pairwise(times)), times
    client.close()


def test_a_holder_who_vanishes(server: Server) -> None:
    """CON-16: the robot stops, and its controller drives it again, in its own unit."""
    client = spawned(server)
    percent = "DRIVE {Left 50} {Right 50} {Normalized True}"

    async def main(scene: LiveScene) -> None:
        assert (await reply(scene, "take", robot="R", by="Ada"))["ok"]
        assert (await reply(scene, "drive", robot="R", line=percent))["ok"]

    play(main, server)
    assert eventually(lambda: all(one.tap is None for one in server[0].sessions))
    client.listen(1.0)
    way, _ = moved(server)
    assert way < 0.01
    client.send("DRIVE {Left 2} {Right 2}")
    client.listen(1.0)
    way, _ = moved(server)
    assert way > 0.05
    client.close()


def test_the_clock(server: Server) -> None:
    """Pause, step, speed, run, reset; an order of a pause takes effect at its end; a robot may come
    meanwhile."""
    client = spawned(server)
    simulation = server[0].simulation
    other = ScriptedClient(server[1]["control"].port)

    async def main(scene: LiveScene) -> None:
        paused = await reply(scene, "pace", action="pause")
        assert paused["paused"]
        before = simulation.now
        client.send("DRIVE {Left 2} {Right 2}")
        other.send("INIT {ClassName USARBot.P3AT} {Name S} {Location 5,5,-0.3}")
        robots = server[0].robots
        assert await asyncio.to_thread(eventually, lambda: robots.find("S") is not None)
        assert simulation.now == before
        stepped = await reply(scene, "pace", action="step", seconds=0.5)
        assert stepped["ok"], stepped
        assert await asyncio.to_thread(eventually, lambda: simulation.paused)
        assert simulation.now == pytest.approx(before + 0.5, abs=0.003)
        state = server[0].robots.vehicles[0].body.look()
        assert state is not None
        assert state.pose.position[0] > 0.03
        assert (await reply(scene, "pace", action="reset"))["reset"] == ["R", "S"]
        state = server[0].robots.vehicles[0].body.look()
        assert state is not None
        assert state.pose.position[0] == pytest.approx(0.0, abs=0.01)
        assert (await reply(scene, "pace", action="speed", factor=3))["ok"]
        assert (await reply(scene, "pace", action="run"))["paused"] is False
        while True:
            news = await scene.next()
            if isinstance(news, dict) and news["type"] == "clock" and news["real_time_factor"]:
                break
        assert news["speed"] == 3.0

    play(main, server)
    other.close()
    client.close()


HOSTILE: list[tuple[str, dict[str, object], str]] = [
    ("take", {}, "whom you mean"),
    ("take", {"robot": 7}, "robot"),
    ("take", {"robot": "Q"}, "no robot"),
    ("take", {"session": "x" * 100}, "session"),
    ("drive", {"robot": "R", "line": "DRIVE {Left 1}"}, "take it first"),
    ("hand_back", {"robot": "R"}, "take it first"),
    ("pace", {}, "action"),
    ("pace", {"action": "step"}, "seconds"),
    ("pace", {"action": "step", "seconds": -1}, "seconds"),
    ("pace", {"action": "step", "seconds": 1e300}, "seconds"),
    ("pace", {"action": "speed", "factor": True}, "factor"),
    ("pace", {"action": "speed", "factor": 0}, "factor"),
    ("pace", {"action": ["pause"]}, "action"),
    ("call", {}, "victim"),
    ("call", {"victim": "Nobody"}, "nobody is called Nobody"),
]


def test_nonsense_is_refused(server: Server) -> None:
    """Each request that makes no sense is answered by why, and nothing happens."""
    client = spawned(server)

    async def main(scene: LiveScene) -> None:
        for request, fields, why in HOSTILE:
            told = await reply(scene, request, **fields)
            assert not told["ok"]
            assert why in told["why"], told
        assert (await reply(scene, "take", robot="R"))["ok"]
        for line in ("INIT {ClassName P3AT}", "", "x" * 5000, "CONTROL {Type KillAll}", 7, None):
            assert not (await reply(scene, "drive", robot="R", line=line))["ok"], line
        told = await reply(scene, "drive", robot="R", line="DRIVE {Left \u2603} {Right nan}")
        assert told["ok"]
        assert not server[0].simulation.paused

    play(main, server)
    client.close()


def test_off_unless_asked_for() -> None:
    """Without the switch there are lines, but nobody can change anything."""
    with running_server(world="empty", scene_port=0) as (assembly, endpoints):

        async def main(scene: LiveScene) -> None:
            assert scene.welcome["requests"] == ["rate"]
            assert "no request" in (await reply(scene, "take", robot="R"))["why"]

        play(main, (assembly, dict(endpoints)))
    with pytest.raises(SettingsError, match=re.escape("--scene-port")):
        load_settings({"supervise": "on"})


def drama(listen: bool) -> tuple[list[str], list[Row]]:
    """All lines that a clumsy client gets, and all rows that somebody hears."""
    rows: list[Row] = []
    with Rehearsal(world="empty") as stage:
        if listen:
            stage.assembly.supervision.listen(rows.append, True)
        client = stage.connect()
        for line in (
            "DRIVE {Left 1}",
            "INIT {ClassName USARBot.P3TA}",
            "INIT {ClassName USARBot.P3AT} {Name R} {Location 0,0,-0.3}",
            "DRIVE {Left 1} {Right abc} {Nonsense 2}",
            "SET {Type Camera} {Name Camera} {Opcode FOV} {Params x}",
            "GETCONF {Type Sonar}",
            "MULTIDRIVE {Nothing 1}",
            "CONTROL {Type KillAll}",
        ):
            client.send(line)
            stage.run(0.5)
        return client.lines, rows


def test_listening_changes_no_line() -> None:
    """Every line is the same, to the last digit; every line that the client got was heard of."""
    alone, nobody = drama(False)
    heard, rows = drama(True)
    assert nobody == []
    assert heard == alone
    told = [row.text for row in rows if not row.incoming]
    assert len(told) == len(alone)
    assert all(
        row == line[: len(row)] or row.endswith("...")
        for row, line in zip(told, alone, strict=True)
    )


def test_a_pause_changes_no_line() -> None:
    """A world that is stopped and stepped in between tells what one tells that runs through."""

    def told(stops: bool) -> list[str]:
        with Rehearsal(world="empty") as stage:
            client = stage.connect()
            client.send("INIT {ClassName USARBot.P3AT} {Name R} {Location 0,0,-0.3}")
            client.send("DRIVE {Left 1} {Right 0.5}")
            for _ in range(4):
                if stops:
                    stage.assembly.simulation.pause()
                    assert stage.assembly.simulation.paused
                    stage.assembly.simulation.go_on()
                stage.run(0.5)
            return client.lines

    assert told(True) == told(False)


def test_a_pause_holds_robots_and_keeps_clients(server: Server) -> None:
    """A driving robot stands still as long as the pause lasts; its client stays connected and is
    answered, and of what it orders meanwhile the newest counts when time goes on."""
    client = spawned(server)
    client.send("DRIVE {Left 2} {Right 2}")
    client.listen(0.5)
    simulation, robots = server[0].simulation, server[0].robots

    def place() -> tuple[float, float]:
        state = robots.vehicles[0].body.look()
        assert state is not None
        return state.time, state.pose.position[0]

    async def main(scene: LiveScene) -> None:
        assert (await reply(scene, "pace", action="pause"))["paused"]
        before = place()
        assert before[1] > 0.01
        client.send("DRIVE {Left 2} {Right 2}")
        client.send("DRIVE {Left -2} {Right -2}")
        client.send("GETCONF {Type Robot}")
        assert await asyncio.to_thread(client.wait_for, "CONF")
        ticks = 0
        while ticks < 2:  # each is a second of wall time
            news = await scene.next()
            ticks += isinstance(news, dict) and news["type"] == "clock"
        assert place() == before
        assert (await reply(scene, "pace", action="step", seconds=1.0))["ok"]
        assert await asyncio.to_thread(eventually, lambda: simulation.paused)
        after = place()
        assert after[0] == pytest.approx(before[0] + 1.0, abs=0.003)
        assert after[1] < before[1] - 0.03, "the newest order does not count"
        assert (await reply(scene, "pace", action="run"))["ok"]

    play(main, server)
    assert client.listen(0.3)
    client.close()


def _way(assembly: Assembly, client: ScriptedClient, line: str) -> float:
    """How far (m) the first robot has gone a second after a line, in lockstep of 0.2 s."""
    began = assembly.robots.vehicles[0].body.look()
    client.send(line)
    client.send("SYNC {Ticks 5}")
    client.wait_for("NFO {Status Tick}")
    ended = assembly.robots.vehicles[0].body.look()
    assert began is not None
    assert ended is not None
    return math.dist(began.pose.position[:2], ended.pose.position[:2])


def test_sync_of_a_suspended_client_counts() -> None:
    """In lockstep the world waits for a controller that is held back, and goes on when it answers;
    its robot stands."""
    with running_server(
        world="empty", lockstep=True, tick=0.2, speed=math.inf, scene_port=0, supervise="on"
    ) as (assembly, endpoints):
        client = ScriptedClient(endpoints["control"].port)
        client.send("INIT {ClassName USARBot.P3AT} {Name R} {Location 0,0,-0.3}")
        client.wait_for("NFO {Status Tick}")
        session = assembly.supervision.find("R", None)
        assembly.supervision.take(session, "Ada")
        begun = assembly.simulation.now
        for number in range(1, 6):
            client.send("DRIVE {Left 2} {Right 2}")
            client.send("SYNC")
            assert time_of(client.wait_for("NFO {Status Tick}")) == pytest.approx(
                begun + 0.2 * number, abs=0.011
            )
        assert assembly.simulation.now == pytest.approx(begun + 1.0, abs=0.01)
        state = assembly.robots.vehicles[0].body.look()
        assert state is not None
        assert math.hypot(*state.pose.position[:2]) < 0.01
        assert assembly.supervision.hand_back(session, "Ada") == 5
        assert _way(assembly, client, "DRIVE {Left 2} {Right 2}") > 0.05
        # What it says of its unit meanwhile holds afterwards, what its holder says does not.
        assembly.supervision.take(session, "Ada")
        client.send("DRIVE {Normalized True}")
        _way(assembly, client, "SET {Type None}")
        assembly.supervision.drive(session, "Ada", "DRIVE {Left 1} {Right 1} {Normalized False}")
        assembly.supervision.hand_back(session, "Ada")
        assert 0.0 < _way(assembly, client, "DRIVE {Left 2} {Right 2}") < 0.01
        client.close()
