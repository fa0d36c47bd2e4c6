"""Lockstep over sockets: the world goes from tick to tick, and only when everybody has answered."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator

import pytest

from usarsim_server.testing import ScriptedClient, ServerProcess, eventually

TICK = "NFO {Status Tick}"


@pytest.fixture
def server() -> Iterator[ServerProcess]:
    """A server in lockstep with ticks of a fifth of a second."""
    with ServerProcess("--world", "empty", "--lockstep", "--tick", "0.2", "--seed", "4") as process:
        yield process


def until_tick(client: ScriptedClient) -> list[str]:
    """All lines up to the next tick, that one included."""
    lines = [client.read_line()]
    while not lines[-1].startswith(TICK):
        lines.append(client.read_line())
    return lines


def time_of(line: str) -> float:
    """The Time of a line."""
    found = re.search(r"\{Time ([\d.]+)\}", line)
    assert found is not None, line
    return float(found[1])


def start(server: ServerProcess, name: str, place: str) -> ScriptedClient:
    """A client with a robot, told of the tick at which it came."""
    client = server.client()
    client.send(f"INIT {{ClassName USARBot.P2AT}} {{Name {name}}} {{Location {place}}}")
    until_tick(client)
    return client


def test_the_world_waits_for_every_controller(server: ServerProcess) -> None:
    """With one of two answers time stands still; with both it goes to the next tick, no further."""
    with start(server, "A", "0,0,-0.3") as one, start(server, "B", "0,3,-0.3") as other:
        one.send("SYNC")
        assert one.read_for(0.3) == [], "the world does not go on without the other"
        other.send("SYNC")
        assert time_of(until_tick(one)[-1]) == pytest.approx(0.2)
        assert time_of(until_tick(other)[-1]) == pytest.approx(0.2)
        assert one.read_for(0.3) == []


def test_who_leaves_is_not_waited_for(server: ServerProcess) -> None:
    """The robots that stay go on."""
    with start(server, "A", "0,0,-0.3") as one:
        other = start(server, "B", "0,3,-0.3")
        one.send("SYNC")
        other.close()
        assert time_of(until_tick(one)[-1]) == pytest.approx(0.2)


def test_connections_without_a_robot_are_not_waited_for(server: ServerProcess) -> None:
    """Somebody who only asks for start poses does not stop the world; his SYNC means nothing."""
    with start(server, "A", "0,0,-0.3") as one, server.client() as idle:
        idle.send("SYNC")
        idle.send("GETSTARTPOSES")
        idle.wait_for("NFO {StartPoses")
        one.send("SYNC {Ticks 5}")
        assert time_of(until_tick(one)[-1]) == pytest.approx(1.0)


def drive_about(client: ScriptedClient, ticks: int, said: list[str]) -> None:
    """A controller that steers by what it hears, and keeps everything it heard."""
    for _ in range(ticks):
        heard = until_tick(client)
        said += heard
        turn = sum(map(len, heard)) % 7 - 3
        client.send(f"DRIVE {{Left {1 + 0.3 * turn}}} {{Right {1 - 0.3 * turn}}}")
        client.send("SYNC")


def play() -> list[list[str]]:
    """What three controllers heard that each steer by it, all at their own speed."""
    options = ("--world", "arena", "--lockstep", "--seed", "9")
    with ServerProcess(*options) as server:
        clients = []
        said: list[list[str]] = [[], [], []]
        for number in range(3):
            client = server.client()
            client.send(f"INIT {{ClassName USARBot.P3AT}} {{Start RobotStart{number + 1}}}")
            said[number] += until_tick(client)
            clients.append(client)
        for client in clients:
            client.send("SYNC")
        threads = [
            threading.Thread(target=drive_about, args=(client, 40, heard))
            for client, heard in zip(clients, said, strict=True)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for client in clients:
            client.close()
        return said


def test_runs_repeat_to_the_letter() -> None:
    """Controllers that answer what they heard get the same text again, noise and all."""
    first = play()
    assert sum(line.startswith("SEN") for line in first[0]) > 100
    assert play() == first


def synced(syncs: list[str], at_once: bool) -> list[str]:
    """The streams of forty ticks of 0.1 s whose answers come one by one or all at once."""
    options = ("--world", "arena", "--lockstep", "--seed", "2")
    with ServerProcess(*options) as server, start(server, "A", "0,0,-0.3") as client:
        heard: list[str] = []
        if at_once:
            client.send("\r\n".join(syncs))
        for sync in syncs:
            if not at_once:
                client.send(sync)
            heard += until_tick(client)
        assert time_of(heard[-1]) == pytest.approx(4.0)
        assert sum(line.startswith(TICK) for line in heard) == len(syncs), "one for each SYNC"
        return [line for line in heard if not line.startswith(TICK)]


def test_no_line_is_lost_however_far_ahead_a_client_has_synced() -> None:
    """One by one, five or twenty ticks at once, and all in advance: the same lines."""
    usual = synced(["SYNC"] * 40, at_once=False)
    assert sum(line.startswith("STA") for line in usual) == 19, "one every 0.2 s from 0.3 s on"
    for ticks in (5, 20):
        assert synced([f"SYNC {{Ticks {ticks}}}"] * (40 // ticks), at_once=False) == usual
    assert synced(["SYNC"] * 40, at_once=True) == usual
    assert synced(["SYNC {Ticks 20}"] * 2, at_once=True) == usual


def test_what_follows_a_sync_waits_for_its_tick(server: ServerProcess) -> None:
    """A question behind a SYNC is answered after the tick, one before it at once."""
    with start(server, "A", "0,0,-0.3") as client:
        client.send(
            "GETCONF {Type Robot}\r\nSYNC {Ticks 2}\r\nGETGEO {Type Robot}\r\nSYNC\r\n"
            "GETCONF {Type Robot}"
        )
        heard = [client.read_line()]
        while sum(line.startswith("CONF {Type GroundV") for line in heard) < 2:
            heard.append(client.read_line())
        told = [line[:20] for line in heard if line.startswith(("CONF {Type G", "GEO", TICK))]
        assert [line[:3] for line in told] == ["CON", "NFO", "GEO", "NFO", "CON"]


def test_a_silent_controller_is_given_up() -> None:
    """After the patience set for it the world goes on without it, until it answers again."""
    options = ("--world", "empty", "--lockstep", "--lockstep-patience", "0.5")
    with (
        ServerProcess(*options) as server,
        start(server, "A", "0,0,-0.3") as one,
        start(server, "B", "0,3,-0.3") as silent,
    ):
        one.send("SYNC {Ticks 10}")
        while time_of(until_tick(one)[-1]) < 0.95:  # on a busy machine it is given up, too
            one.send("SYNC")
        assert eventually(lambda: "sends no SYNC" in server.errors)
        silent.send("SYNC")
        until_tick(silent)


def test_a_pace_and_lockstep_exclude_each_other() -> None:
    """Both together is one clear error."""
    with pytest.raises(RuntimeError, match="lockstep goes at no pace of its own"):
        ServerProcess("--world", "empty", "--lockstep", "--speed", "2")


def test_without_lockstep_sync_means_nothing() -> None:
    """A server that is not in lockstep takes the command and says nothing of ticks."""
    with ServerProcess("--world", "empty") as server, server.client() as client:
        client.send("SYNC")
        client.send("INIT {ClassName USARBot.P2AT}")
        client.send("SYNC")
        client.wait_for("STA")
        assert not any(TICK in line for line in client.read_for(0.5))
