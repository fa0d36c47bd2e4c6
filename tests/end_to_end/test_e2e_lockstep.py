"""Lockstep over sockets: the world goes from tick to tick, and only when everybody has answered.

Every stream is complete in simulated time, however little the server keeps up.

Equal seed, world and command times give equal bytes, for classes of every kind, across processes.
"""

from __future__ import annotations

import re
import threading
from collections import Counter
from collections.abc import Iterator, Sequence

import pytest
from lanes import slow_but

from usarsim_server.base.files import data_directory
from usarsim_server.base.launch import LaunchError
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
            threading.Thread(target=drive_about, args=(client, 20, heard))
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
    assert sum(line.startswith("SEN") for line in first[0]) > 50
    assert play() == first


def synced(syncs: list[str], at_once: bool) -> list[str]:
    """The streams of forty ticks of 0.1 s whose answers come one by one or all at once."""
    options = ("--world", "empty", "--lockstep", "--seed", "2")
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


@pytest.mark.slow
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
    with pytest.raises(LaunchError, match="lockstep goes at no pace of its own"):
        ServerProcess("--world", "empty", "--lockstep", "--speed", "2")


def test_without_lockstep_sync_means_nothing() -> None:
    """A server that is not in lockstep takes the command and says nothing of ticks."""
    with ServerProcess("--world", "empty") as server, server.client() as client:
        client.send("SYNC")
        client.send("INIT {ClassName USARBot.P2AT}")
        client.send("SYNC")
        client.wait_for("STA")
        assert not any(TICK in line for line in client.read_for(0.5))


SECONDS = 2.0
"""Simulated s that are listened to, from the first STA on."""
CLASSES = ("P3AT", "P3AT", "P3AT", "P2AT", "P2AT", "Nao", "Kenaf", "Hummer")
PERIODS = {"Nao": 0.01, "P2AT": 0.2, "Hummer": 0.2}
"""Simulated s between two STA, where it is not the usual 0.1."""
STEP = 0.005
"""s: no step of the physics is longer; a report is due at the first one not before its time."""

_TIME = re.compile(r"\{Time ([\d.]+)\}")
_STREAM = re.compile(r"(?:SEN|MISSTA|ASTA|EFF) (?:\{Type \w+\} ?)?(?:\{Name [^ }]+)?")


def listen(client: ScriptedClient, heard: list[str]) -> None:
    """Keep the lines of the span."""
    end: float | None = None
    while True:
        line = client.read_line()
        if line.startswith("STA"):
            found = _TIME.search(line)
            assert found is not None
            end = float(found[1]) + SECONDS if end is None else end
            if float(found[1]) > end - PERIODS["Nao"] / 2:
                return
        if end is not None:
            heard.append(line)


def team_hears(*options: str) -> list[list[str]]:
    """What each robot of a team tells in a span, on a server with these options."""
    heard: list[list[str]] = [[] for _ in CLASSES]
    with ServerProcess("--world", "empty", *options) as server:
        clients = [server.client() for _ in CLASSES]
        for number, (client, name) in enumerate(zip(clients, CLASSES, strict=True)):
            client.send(f"INIT {{ClassName USARBot.{name}}} {{Start RobotStart{1 + number % 5}}}")
            client.send("SYNC {Ticks 100}")  # means something in lockstep only
        threads = [
            threading.Thread(target=listen, args=(client, lines), daemon=True)
            for client, lines in zip(clients, heard, strict=True)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for client in clients:
            client.close()
    return heard


def streams(lines: list[str]) -> Counter[str]:
    """How many lines of each stream there are, STA aside."""
    bare = (_TIME.sub("", line).replace("  ", " ") for line in lines)
    return Counter(found[0] for line in bare if (found := _STREAM.match(line)))


@pytest.fixture(scope="module")
def complete() -> list[Counter[str]]:
    """The streams of the team where nobody is in a hurry."""
    return [streams(lines) for lines in team_hears("--lockstep")]


@pytest.mark.parametrize("speed", slow_but("max".__eq__, ["1", "50", "max"]))
def test_no_report_is_lost(speed: str, complete: list[Counter[str]]) -> None:
    """STA of eight robots comes in its exact period and every sensor as often as it should.

    No machine gets to fifty times real time: there the reports cannot keep up, and the world has
    to wait for them.
    """
    for name, lines, usual in zip(CLASSES, team_hears("--speed", speed), complete, strict=True):
        period = PERIODS.get(name, 0.1)
        told = [_TIME.search(line) for line in lines if line.startswith("STA")]
        times = [float(found[1]) for found in told if found is not None]
        assert len(times) == round(SECONDS / period), name
        for number, moment in enumerate(times):
            assert abs(moment - times[0] - number * period) < STEP, (name, number)
        assert streams(lines) == usual, name
        assert usual, name


REPEATED = sorted(path.stem for path in data_directory("robots").glob("*.toml"))[1::3]
"""Classes of all kinds; `test_golden_lines` holds every class to what another process said."""
TOGETHER = 12
"""Classes in one world."""
REPEATS_SECONDS = 1.0
"""Simulated s that are compared after the last order."""
TICKS = 2
"""Ticks of 0.1 s between two orders."""

ORDERS = (
    "DRIVE {Left 0.8} {Right 1.1}",
    "DRIVE {Speed 0.6} {FrontSteer 0.2} {RearSteer 0.0}",
    "DRIVE {AltitudeVelocity 0.4} {LinearVelocity 0.3} {LateralVelocity 0.0} "
    "{RotationalVelocity 0.2} {Normalized False}",
    "DRIVE {Propeller 0.5} {Rudder 0.1} {SternPlane 0.1}",
    "DRIVE {WheelNumber 1} {WheelSpeed 1.0} {WheelSteer 0.1}",
    "DRIVE {Name HeadYaw} {Steertype 1} {Angle 0.3}",
    "MULTIDRIVE {FRFlipper 0.4} {FLFlipper 0.4}",
    "SET {Type Joint} {Name HeadPitch} {Opcode Angle} {Params 0.2}",
    "MISPKG {Name CameraPanTilt} {Link 1} {Value 0.4} {Order 0}",
    "ACT {Name Arm} {Link 1} {Value 0.3}",
    "GETCONF {Type Robot}",
    "GETGEO {Type Robot}",
)
"""For every kind of machine, and questions in between; each obeys what it understands."""


def script() -> str:
    """All that a controller says after INIT, sent at once."""
    lines = [f"SYNC {{Ticks {TICKS}}}"]
    for order in ORDERS:
        lines += [order] if order.startswith("GET") else [order, "SYNC"]
    return "\r\n".join([*lines, f"SYNC {{Ticks {round(10 * REPEATS_SECONDS)}}}"]) + "\r\n"


def repeats_listen(client: ScriptedClient, heard: list[str]) -> None:
    """Keep every line up to the last tick of the script."""
    ticks = script().count("SYNC")
    while ticks:
        heard.append(client.read_line())
        ticks -= heard[-1].startswith("NFO {Status Tick}")


def repeats_play(classes: Sequence[str], *options: str) -> list[list[str]]:
    """What the controllers of some robots hear in one process."""
    heard: list[list[str]] = [[] for _ in classes]
    most = str(len(classes))
    arguments = ("--world", "empty", "--lockstep", "--seed", "11", "--max-robots", most, *options)
    with ServerProcess(*arguments) as server:
        clients = []
        for number, name in enumerate(classes):
            client = server.client()
            # Close enough to be in each other's way, and in each other's scans.
            place = f"{1.8 * (number % 6):.1f},{1.8 * (number // 6):.1f},-0.5"
            client.send(f"INIT {{ClassName USARBot.{name}}} {{Location {place}}}")
            while not client.read_line().startswith("NFO {Status Tick}"):
                pass
            clients.append(client)
        threads = [
            threading.Thread(target=repeats_listen, args=(client, lines), daemon=True)
            for client, lines in zip(clients, heard, strict=True)
        ]
        for thread in threads:
            thread.start()
        for client in clients:
            client.socket.sendall(script().encode())
        for thread in threads:
            thread.join()
        for client in clients:
            client.close()
    return heard


def assert_equal(first: list[list[str]], again: list[list[str]], classes: Sequence[str]) -> None:
    """No line differs, and there was something to compare."""
    for name, one, other in zip(classes, first, again, strict=True):
        differing = [pair for pair in zip(one, other, strict=False) if pair[0] != pair[1]]
        assert not differing, (name, differing[0])
        assert len(one) == len(other), name
        assert sum(line.startswith("STA") for line in one) >= 10 * REPEATS_SECONDS / 5, name


@pytest.mark.slow
@pytest.mark.parametrize(
    "classes",
    slow_but(
        lambda classes: "Matilda" in classes,
        [REPEATED[start : start + TOGETHER] for start in range(0, len(REPEATED), TOGETHER)],
    ),
    ids=lambda classes: f"{classes[0]}-{classes[-1]}",
)
def test_every_kind_repeats(classes: list[str]) -> None:
    """Two processes tell the same to the letter, with robots in each other's way."""
    assert_equal(repeats_play(classes), repeats_play(classes), classes)


@pytest.mark.slow
@pytest.mark.parametrize("count", slow_but((1).__eq__, [1, 16]))
def test_teams_repeat(count: int) -> None:
    """One robot alone, and sixteen of four kinds, among them one that reports every 0.01 s."""
    classes = (("Nao", "P3AT", "P2AT", "Kenaf") * count)[:count]
    assert_equal(repeats_play(classes), repeats_play(classes), classes)


def alone(name: str, world: str) -> list[str]:
    """What a robot in the fastest world tells whose controller says all it has to say at once."""
    heard: list[str] = []
    init = f"INIT {{ClassName USARBot.{name}}} {{Start RobotStart1}}"
    options = ("--world", world, "--speed", "max", "--seed", "3")
    with ServerProcess(*options) as server, server.client() as client:
        client.socket.sendall("\r\n".join((init, *ORDERS, "")).encode())
        while not heard or not re.search(r"\{Time 2\.", heard[-1]):
            heard.append(client.read_line())
    return heard


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "world"),
    slow_but(
        lambda one: one[0] == "Nao", [("Nao", "empty"), ("P3AT", "arena"), ("Talon", "empty")]
    ),
)
def test_the_fastest_world_repeats(name: str, world: str) -> None:
    """Without lockstep, too, if the controller leaves nothing to chance."""
    assert alone(name, world) == alone(name, world)
