"""One server with all of its ports open, and clients that mean it no good, all at the same time.

A witness drives and reads beside them; what it gets tells whether they harmed anybody. Wall-clock
rates belong to this machine and are not asserted: simulated time is, by the order of reports.

A team at work beside clients that never read, send garbage, dawdle, and come and go.

What the team gets is judged in simulated time, so that a slow machine is no excuse and no reproach.
"""

from __future__ import annotations

import contextlib
import random
import re
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from itertools import pairwise

import psutil
import pytest
from hostile.attackers import Attackers
from sharing import shipped_robots

from usarsim_server.testing import ScriptedClient, ServerProcess

MEGABYTE = 1 << 20
PATIENCE = 90.0
QUESTIONS = {
    "control": b"GETSTARTPOSES\r\n",
    "images": b"OK",
    "groundtruth": b"GETPOS\r\n",
    "truth": b"\r\n",
    "wireless": b"GETSS {Robot x}\r\n",
    "comserver": b"GETSS a b;",
}
"""What each port has to answer at once."""
ABSURD = (
    *("0,0,-1", "1e308,1e308,1e308", "nan,nan,nan", "inf,-inf,0", "0,0,-100000", "0,0,0", "1,2"),
    *("-1e9,5,3", "x", "", "0,0,5", "99999999999999999999,1,1", "1,1,1,1,1,1"),
)


@pytest.fixture(scope="module")
def server() -> Iterator[ServerProcess]:
    """A server with every port open."""
    side = [f"--{name}-port=0" for name in ("image", "groundtruth", "truth", "comserver")]
    with ServerProcess("--world", "empty", "--wireless-port=0", *side) as process:
        assert set(process.ports) == set(QUESTIONS)
        yield process


@pytest.fixture
def witness(server: ServerProcess) -> Iterator[ScriptedClient]:
    """Somebody with a robot who only wants to work; what was said about defects is looked at."""
    client = server.client()
    client.send("INIT {ClassName P3AT} {Name Witness} {Location 40,40,-0.3}")
    client.wait_for("STA")
    yield client
    assert server.process.poll() is None
    assert "Traceback" not in server.errors
    client.close()


def dial(port: int) -> socket.socket:
    """A connection with a time limit."""
    return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)


def all_is_well(server: ServerProcess, witness: ScriptedClient) -> None:
    """The witness is told everything at its rate of simulated time, and every port answers."""
    witness.fence()  # nobody read what it was told meanwhile
    times: list[float] = []
    while len(times) < 5:
        line = witness.wait_for("STA", PATIENCE)
        times.append(float(line.partition("{Time ")[2].partition("}")[0]))
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert gaps == pytest.approx([0.1] * 4, abs=0.02)
    for name, question in QUESTIONS.items():
        until(lambda: answers(server.ports[name], question), name)  # noqa: B023 called at once


def answers(port: int, question: bytes) -> bool:
    """Whether a new connection is accepted and gets something back for a question."""
    try:
        with dial(port) as client:
            client.sendall(question)
            return bool(client.recv(1))
    except OSError:
        return False


def until(condition: Callable[[], bool], what: str) -> None:
    """Wait for something to come true."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, f"not in time: {what}"
        time.sleep(0.05)


def at_once(server: ServerProcess, attack: Callable[[str, int], None]) -> None:
    """Run an attack on every port at the same time; to be disconnected is what they deserve."""

    def run(name: str, port: int) -> None:
        with contextlib.suppress(OSError):
            attack(name, port)

    threads = [threading.Thread(target=run, args=pair) for pair in server.ports.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
        assert not thread.is_alive()


def test_garbage_everywhere(server: ServerProcess, witness: ScriptedClient) -> None:
    """Random bytes, endless lines and requests of other ports, as fast as they go through."""

    def attack(name: str, port: int) -> None:
        chance = random.Random(name)
        others = b"".join(QUESTIONS.values())
        pieces = [chance.randbytes(8192), b"{" * 65536, b"U" + chance.randbytes(40), others * 20]
        with dial(port) as client:
            client.settimeout(0.5)
            for _ in range(60):
                client.sendall(chance.choice(pieces))

    process = psutil.Process(server.process.pid)
    all_is_well(server, witness)
    before = process.memory_info().rss
    for _ in range(2):
        at_once(server, attack)
    all_is_well(server, witness)
    assert process.memory_info().rss - before < 96 * MEGABYTE


def test_nobody_reads_anywhere(server: ServerProcess, witness: ScriptedClient) -> None:
    """Clients that ask without end and never read cost their budget, and nobody else a line."""
    stuck = []

    def attack(name: str, port: int) -> None:
        for _ in range(2):
            client = dial(port)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.settimeout(0.3)
            stuck.append(client)
            with contextlib.suppress(OSError):
                for _ in range(40):
                    client.sendall(QUESTIONS[name] * 2000)

    process = psutil.Process(server.process.pid)
    before = process.memory_info().rss
    at_once(server, attack)
    all_is_well(server, witness)
    assert process.memory_info().rss - before < 96 * MEGABYTE
    for client in stuck:
        client.close()


def test_two_hundred_connections(server: ServerProcess, witness: ScriptedClient) -> None:
    """Idle, half-closed, reset: what is over the limit is refused, and all of it is let go of."""
    process = psutil.Process(server.process.pid)
    all_is_well(server, witness)
    threads, files = process.num_threads(), process.num_fds()
    crowd = []
    for number in range(200):
        client = dial(list(server.ports.values())[number % len(server.ports)])
        crowd.append(client)
        with contextlib.suppress(OSError):
            client.sendall(b"GETP")
            if number % 3 == 0:
                client.shutdown(socket.SHUT_WR)
    assert witness.wait_for("STA", PATIENCE)
    for number, client in enumerate(crowd):
        if number % 2:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.close()
    all_is_well(server, witness)
    until(lambda: process.num_fds() <= files + 2, "descriptors are given back")
    until(lambda: process.num_threads() <= threads + 2, "threads end")


def test_absurd_robots_of_every_class(server: ServerProcess, witness: ScriptedClient) -> None:
    """INIT of every class at impossible places, told nonsense and gone again, while somebody
    watches: pictures go on, and the witness does not notice."""
    stop = threading.Event()
    pictures = 0

    def watch() -> None:
        nonlocal pictures
        with dial(server.ports["images"]) as client, client.makefile("rb") as stream:
            while not stop.is_set():
                client.sendall(b"U" + struct.pack(">4I", 0, 0, 320, 240))
                kind, length = struct.unpack(">BI", stream.read(5))
                assert kind == 3
                assert len(stream.read(length)) == length
                pictures += 1

    watcher = threading.Thread(target=watch)
    watcher.start()
    chance = random.Random(3)
    names = [robot.name for robot in shipped_robots().descriptions()]
    nonsense = "{Left 1e308} {Right nan} {Speed inf} {FrontSteer -1e9} {AltitudeVelocity 1e300}"
    for number, name in enumerate(names):
        # Compiling each of them takes long; most are refused before that, as they should be.
        place = ABSURD[number % 12] if number % 8 else f"{number},-60,-1"
        with contextlib.suppress(OSError), server.client() as client:
            client.send(f"INIT {{ClassName {name}}} {{Location {place}}} {{Rotation {place}}}")
            client.send(f"DRIVE {nonsense} {{Normalized true}}")
            client.send("SET {Type Joint} {Name AllJoints} {Opcode Angle} {Params 1e308}")
            client.send("SET {Type Camera} {Opcode FOV} {Params nan}")
            if chance.random() < 0.3:
                client.read_for(0.05)
    all_is_well(server, witness)
    seen = pictures
    until(lambda: pictures > seen, "pictures go on")
    stop.set()
    watcher.join(PATIENCE)
    assert not watcher.is_alive()


def test_failures_do_not_fill_the_log(server: ServerProcess, witness: ScriptedClient) -> None:
    """A client that fails thousands of times is written about a hundred times, and is served."""
    said = len(server.errors.splitlines())
    with server.client() as client:
        for _ in range(3):
            client.send_bytes(b"INIT {ClassName NoSuchRobot} {Name x}\r\n" * 1000)
        client.send("GETSTARTPOSES")
        client.wait_for("NFO {StartPoses", PATIENCE)
    all_is_well(server, witness)
    assert len(server.errors.splitlines()) - said < 150


ROBOTS = 5
SPAN = 4.0
"""Simulated s over which lines are counted."""
STA_PERIOD = 0.1
"""Simulated s between two STA lines (protocol reference 1.8)."""
WHOLE = re.compile(r"(STA|SEN|NFO|CONF|GEO|RES) ?\{.*\}")
TIME = re.compile(r"STA .*?\{Time ([0-9.]+)\}")


class Member:
    """One robot and the thread of its controller, which reads all and drives now and then."""

    def __init__(self, client: ScriptedClient, number: int) -> None:
        self.client = client
        self.times: list[float] = []
        self.cut: list[str] = []
        self.lost: Exception | None = None
        self._stop = threading.Event()
        place = f"{10 * number},10,-0.3"
        client.send(f"INIT {{ClassName P3AT}} {{Name R{number}}} {{Location {place}}}")
        client.wait_for("STA", PATIENCE)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def rate(self, since: float) -> float | None:
        """STA lines of a span of simulated time as a part of those due; None if it is not over."""
        times = [time for time in self.times if since <= time]
        if not times or times[-1] < since + SPAN:
            return None
        return sum(time < since + SPAN for time in times) * STA_PERIOD / SPAN

    def end(self) -> None:
        """Hang up."""
        self._stop.set()
        self._thread.join(PATIENCE)
        self.client.close()

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                line = self.client.read_line(PATIENCE)
                if not WHOLE.fullmatch(line):
                    self.cut.append(line)
                if found := TIME.match(line):
                    self.times.append(float(found[1]))
                    self.client.send("DRIVE {Left 1.0} {Right 0.5}")
        except (OSError, TimeoutError) as error:
            self.lost = error


def team_until(condition: Callable[[], bool], deadline: float, what: str) -> None:
    """Wait for something to come true."""
    while not condition():
        assert time.monotonic() < deadline, f"not in time: {what}"
        time.sleep(0.05)


def rates_of(team: list[Member], deadline: float) -> list[float]:
    """The rate of each of a team from now on."""
    team_until(lambda: all(one.times for one in team), deadline, "first lines")
    since = max(one.times[-1] for one in team)
    rates: list[float] = []
    while len(rates) < len(team):
        assert [one.lost for one in team] == [None] * len(team)
        assert time.monotonic() < deadline, "time stands still"
        time.sleep(0.05)
        rates = [rate for one in team if (rate := one.rate(since)) is not None]
    return rates


@pytest.fixture
def team_server() -> Iterator[ServerProcess]:
    """A server with room for the team and for the robot that nobody reads."""
    with ServerProcess("--world", "empty", "--max-robots", str(ROBOTS + 1)) as process:
        yield process


def test_a_team_works_on_beside_four_hostile_clients(team_server: ServerProcess) -> None:
    """Everybody's STA comes as often as it should, whole; nobody is dropped, no memory is lost."""
    team = [Member(team_server.client(), number) for number in range(ROBOTS)]
    process = psutil.Process(team_server.process.pid)
    before = process.memory_info().rss
    deadline = time.monotonic() + PATIENCE
    with Attackers("medley", team_server.ports) as attackers:
        rates = [0.0]
        # A machine that was busy with other things gets another chance; a server that lets its
        # clients be hurt does not mend itself. Nor is it over before the attack has begun.
        while min(rates) < 0.95 or "client sends too fast" not in team_server.errors:
            assert time.monotonic() < deadline, f"too few lines per simulated time: {rates}"
            rates = rates_of(team, deadline)
        damage = attackers.stop()
    grown = process.memory_info().rss - before
    for one in team:
        one.end()
    assert [one.lost for one in team] == [None] * ROBOTS
    assert [one.cut for one in team] == [[]] * ROBOTS
    assert max(rates) < 1.05
    assert grown < 50 * MEGABYTE
    assert team_server.process.poll() is None
    assert "Traceback" not in team_server.errors
    assert len(team_server.errors.splitlines()) < 150
    assert "client sends too fast" in team_server.errors
    assert damage.sent > 100_000, "nobody attacked"
    assert damage.connections > 10
