"""Our own side of the comparison: the same work, inside one process and over sockets."""

from __future__ import annotations

import math
import re
import selectors
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.peers.work import ROVER, Outcome, Work, run_workload, write_robots, write_world
from benchmarks.server import Server
from usarsim_bench.crowd import Controller
from usarsim_bench.figures import BenchError
from usarsim_client import Closing

HUMANOID = "Nao"
JOINT_PERIOD = 0.02
"""Simulated s between two commands to a humanoid's joints, as the soccer server has it."""
SWING, SWING_RATE = math.radians(10.0), 3.0
"""rad and rad/s by which arms swing."""

_TIMEOUT = 600.0
_PATIENCE = 60.0
_READ = 1 << 18
_TIME = re.compile(rb"STA [^\r\n]*?\{Time ([0-9.]+)\}")
_JOINT = re.compile(r"\{((?:Head|[LR](?:Shoulder|Elbow|Hip|Knee|Ankle))\w*) (-?[0-9.]+)\}")
_FOLLOWS = "RHipYawPitch"
"""Goes with its left neighbour and takes no commands (robots reference 1.7)."""

Command = Callable[[int, float], str]
"""The command line for a robot (from 0) at a simulated time since the start."""


class OwnSide(Closing):
    """Does work with our own server, in files that are thrown away."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="usarsim-peers-")
        self._robots = write_robots(Path(self._folder.name, "robots"))

    def in_process(self, work: Work) -> Outcome:
        """Rovers without sockets, in lockstep; `BenchError` if that cannot be measured."""
        robots = ("--robots", str(self._robots), "--robot-class", ROVER)
        return self._instrument(work, robots)

    def bare(self, work: Work) -> Outcome:
        """MuJoCo alone; `BenchError` if that cannot be measured."""
        return self._instrument(work, ("--bare",))

    def over_sockets(self, work: Work, robot_class: str = ROVER) -> Outcome:
        """A server with `--speed max`, clients in this process; processor time of the server.

        Raises:
            BenchError: if the server fails a client.
        """
        world = self._world(work)
        options = ("--robots", str(self._robots), "--speed", "max")
        with (
            Server(str(world), work.robots, *options) as server,
            _Clients(server, work, robot_class) as clients,
        ):
            return clients.measure()

    def close(self) -> None:
        """Throw the files away."""
        self._folder.cleanup()

    def _world(self, work: Work) -> Path:
        return write_world(Path(self._folder.name, f"worlds{work.robots}"), work)

    def _instrument(self, work: Work, arguments: Sequence[str]) -> Outcome:
        command = [sys.executable, "-m", "benchmarks.peers.rovers"]
        after = ("--world", str(self._world(work)), *arguments)
        return run_workload(command, work.as_json(), _TIMEOUT, after, foreign=False)


def joints_told(line: str) -> dict[str, float]:
    """The joints of a humanoid that take commands, with their angles, from its STA line."""
    return {name: float(text) for name, text in _JOINT.findall(line) if name != _FOLLOWS}


def joint_targets(rest: dict[str, float], now: float) -> str:
    """The command that holds every joint at rest but lets the shoulders swing."""
    swing = SWING * math.sin(SWING_RATE * now)
    words = [
        f"{{{name} {angle + (swing if 'ShoulderPitch' in name else 0.0):.4f}}}"
        for name, angle in rest.items()
    ]
    return f"MULTIDRIVE {' '.join(words)}"


@dataclass(slots=True)
class _Client:
    """One connection."""

    controller: Controller  # its socket
    now: float = -math.inf  # simulated time of the latest STA line, s
    due: float = 0.0  # simulated time of the next command, s
    lines: int = 0  # received so far
    scans: int = 0
    status: bytes = b""  # the latest STA line
    tail: bytes = b""  # the beginning of a line that is not whole yet

    def read(self) -> None:
        """Take what has arrived; remember the latest simulated time."""
        try:
            data = self.controller.socket.recv(_READ)
        except BlockingIOError:
            return
        except OSError as error:
            raise BenchError(f"the server dropped {self.controller.name}: {error}") from None
        if not data:
            raise BenchError(f"the server hung up on {self.controller.name}")
        whole, end, rest = (self.tail + data).rpartition(b"\r\n")
        self.tail = rest
        self.lines += whole.count(b"\r\n") + bool(end)
        self.scans += whole.count(b"{Type RangeScanner}")
        start = whole.rfind(b"STA ")
        found = _TIME.match(whole, start) if start >= 0 else None
        if found is not None:
            self.now = float(found[1])
            self.status = whole[start:].partition(b"\r\n")[0]


class _Clients(Closing):
    """All clients of one server, in one thread, by simulated time."""

    def __init__(self, server: Server, work: Work, robot_class: str) -> None:
        self._server, self._work = server, work
        self._selector = selectors.DefaultSelector()
        self._clients: list[_Client] = []
        for number in range(1, work.robots + 1):
            self._join(number, robot_class)
        humanoid = robot_class == HUMANOID
        self._period = JOINT_PERIOD if humanoid else work.command_period
        self._command: Command = self._joints if humanoid else self._wheels
        self._begin = max(one.now for one in self._clients)
        self._rest = joints_told(self._clients[0].status.decode("latin-1"))
        if humanoid and not self._rest:
            raise BenchError(f"{robot_class} tells no joints")
        for one in self._clients:
            one.due = self._begin

    def measure(self) -> Outcome:
        """Warm up, then watch; s and counts of what was watched."""
        first, work = self._clients[0], self._work
        self._play(lambda: first.now >= self._begin + work.warm_up, _PATIENCE)
        start, before, counts = first.now, self._server.usage(), self._counts()
        self._play(lambda: first.now >= start + work.seconds, work.wall_limit)
        after = self._server.usage()
        if first.now <= start:
            raise BenchError("the server's time stands still")
        return Outcome(
            version="",
            simulated=first.now - start,
            wall=after.wall - before.wall,
            cpu=after.cpu - before.cpu,
            counts={name: value - counts[name] for name, value in self._counts().items()},
        )

    def close(self) -> None:
        """Hang up."""
        for one in self._clients:
            one.controller.socket.close()
        self._selector.close()

    def _join(self, number: int, robot_class: str) -> None:
        try:
            controller = Controller(self._server.port, f"R{number}", robot_class)
        except OSError as error:
            raise BenchError(f"the server takes no connection: {error}") from None
        client = _Client(controller, due=math.inf)
        self._clients.append(client)
        self._selector.register(controller.socket, selectors.EVENT_READ, client)
        controller.send(
            f"INIT {{ClassName USARBot.{robot_class}}} {{Name R{number}}} {{Start Start{number}}}"
        )
        self._play(lambda: client.now > -math.inf, _PATIENCE)
        if client.now == -math.inf:
            raise BenchError(f"no STA line after INIT for R{number}")

    def _play(self, finished: Callable[[], bool], patience: float) -> None:
        """Read and command until something is so, or too much wall time has passed."""
        deadline = time.perf_counter() + patience
        while not finished() and time.perf_counter() < deadline:
            for key, _ in self._selector.select(0.5):
                client: _Client = key.data
                client.read()
                if client.now >= client.due:
                    number = self._clients.index(client)
                    client.controller.send(self._command(number, client.now - self._begin))
                    # Not before now: a client that was held up does not send in bursts.
                    client.due = max(client.now, client.due + self._period)

    def _wheels(self, number: int, now: float) -> str:
        commands = self._work.commands
        left, right = commands[int(now / self._period) % len(commands)][number]
        return f"DRIVE {{Left {left:g}}} {{Right {right:g}}}"

    def _joints(self, number: int, now: float) -> str:
        return joint_targets(self._rest, now)

    def _counts(self) -> dict[str, float]:
        return {
            "messages": sum(one.lines for one in self._clients),
            "scans": sum(one.scans for one in self._clients),
        }
