"""A team at work beside clients that never read, send garbage, dawdle, and come and go.

What the team gets is judged in simulated time, so that a slow machine is no excuse and no reproach.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator

import psutil
import pytest

from usarsim_bench.hostile.attackers import Attackers
from usarsim_server.testing import ScriptedClient, ServerProcess

MEGABYTE = 1 << 20
ROBOTS = 5
SPAN = 4.0
"""Simulated s over which lines are counted."""
PATIENCE = 90.0
"""s of wall time for the whole of it, on a machine that has a lot else to do."""
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
        client.wait_for("STA", 30.0)
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
        self._thread.join(10.0)
        self.client.close()

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                line = self.client.read_line(30.0)
                if not WHOLE.fullmatch(line):
                    self.cut.append(line)
                if found := TIME.match(line):
                    self.times.append(float(found[1]))
                    self.client.send("DRIVE {Left 1.0} {Right 0.5}")
        except (OSError, TimeoutError) as error:
            self.lost = error


def until(condition: Callable[[], bool], deadline: float, what: str) -> None:
    """Wait for something to come true."""
    while not condition():
        assert time.monotonic() < deadline, f"not in time: {what}"
        time.sleep(0.05)


def rates_of(team: list[Member], deadline: float) -> list[float]:
    """The rate of each of a team from now on."""
    until(lambda: all(one.times for one in team), deadline, "first lines")
    since = max(one.times[-1] for one in team)
    rates: list[float] = []
    while len(rates) < len(team):
        assert [one.lost for one in team] == [None] * len(team)
        assert time.monotonic() < deadline, "time stands still"
        time.sleep(0.05)
        rates = [rate for one in team if (rate := one.rate(since)) is not None]
    return rates


@pytest.fixture
def server() -> Iterator[ServerProcess]:
    """A server with room for the team and for the robot that nobody reads."""
    with ServerProcess("--world", "empty", "--max-robots", str(ROBOTS + 1)) as process:
        yield process


def test_a_team_works_on_beside_four_hostile_clients(server: ServerProcess) -> None:
    """Everybody's STA comes as often as it should, whole; nobody is dropped, no memory is lost."""
    team = [Member(server.client(), number) for number in range(ROBOTS)]
    process = psutil.Process(server.process.pid)
    before = process.memory_info().rss
    deadline = time.monotonic() + PATIENCE
    with Attackers("medley", server.ports) as attackers:
        rates = [0.0]
        # A machine that was busy with other things gets another chance; a server that lets its
        # clients be hurt does not mend itself.
        while min(rates) < 0.95:
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
    assert server.process.poll() is None
    assert "Traceback" not in server.errors
    assert len(server.errors.splitlines()) < 150
    assert "client sends too fast" in server.errors
    assert damage.sent > 100_000, "nobody attacked"
    assert damage.connections > 10
