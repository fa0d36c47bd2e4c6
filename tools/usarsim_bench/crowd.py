"""Many controllers in one thread: they drive around and store all that they get (`recording`)."""

from __future__ import annotations

import gc
import heapq
import random
import selectors
import time
from collections.abc import Callable, Iterable
from itertools import count

from usarsim_bench.figures import BenchError
from usarsim_bench.recording import Chunk
from usarsim_client import BlockingConnection, Closing, command
from usarsim_client.decoder import decode
from usarsim_client.reports import StartPoses

DEFAULT_CLASS = "P3AT"
DRIVE_PERIOD = 0.5
"""Mean s between two DRIVE commands of one robot."""
_DRIVE_SCATTER = 0.5
"""Part of the mean by which that varies, so that it never beats in time with the physics."""
_SPEAK_TIMEOUT = 30.0
_ANSWER_TIMEOUT = 10.0
_READ = 65536


class Controller:
    """One client and its robot.

    Attributes:
        name, robot_class: of the robot. joined: wall time of its INIT.
        chunks: everything received so far; stays empty in a crowd that does not keep.
        speaking: whether a STA line has come, so that the robot is in the world.
    """

    def __init__(self, port: int, name: str, robot_class: str = DEFAULT_CLASS) -> None:
        """Connect; `OSError` if that fails."""
        self.name, self.robot_class = name, robot_class
        self.joined = 0.0
        self.chunks: list[Chunk] = []
        self.speaking = False
        # Its bytes are taken as they come: a client that reads lines costs several times as much.
        self.socket = BlockingConnection(port, patience=_ANSWER_TIMEOUT).socket
        self.socket.setblocking(False)

    def send(self, text: str) -> float:
        """Send one command line; returns the wall time just before.

        Raises:
            BenchError: if the server does not take it.
        """
        line = command(text)
        moment = time.perf_counter()
        try:
            taken = self.socket.send(line)
        except OSError as error:
            raise BenchError(f"the server takes nothing from {self.name}: {error}") from None
        if taken != len(line):
            raise BenchError(f"the server does not read what {self.name} sends")
        return moment

    def read(self, keep: bool) -> None:
        """Take what has arrived; `BenchError` if the server has hung up."""
        try:
            data = self.socket.recv(_READ)
        except BlockingIOError:
            return
        except OSError as error:
            raise BenchError(f"the server dropped {self.name}: {error.strerror}") from None
        if not data:
            raise BenchError(f"the server hung up on {self.name}")
        moment = time.perf_counter()
        self.speaking = self.speaking or b"STA {" in data
        if keep:
            self.chunks.append((moment, data))


Behaviour = Callable[[Controller, random.Random], None]
"""Called whenever a robot is to get its next command; sends it."""


def wander(controller: Controller, dice: random.Random) -> None:
    """Drive with random wheel speeds: arcs, turns in place, forward and backward."""
    left, right = dice.uniform(-100.0, 100.0), dice.uniform(-100.0, 100.0)
    controller.send(f"DRIVE {{Left {left:.1f}}} {{Right {right:.1f}}} {{Normalized True}}")


class Crowd(Closing):
    """Controllers of one server, worked by `run` in the calling thread.

    Attributes:
        controllers: those connected, in the order in which they joined.
        tags: of the start poses of the world.
    """

    def __init__(
        self, port: int, seed: int = 0, behaviour: Behaviour = wander, *, keep: bool = True
    ) -> None:
        """Start without anybody.

        Args:
            port: of robot control. seed: of what the controllers do.
            behaviour: what they do, every `DRIVE_PERIOD` on average.
            keep: store what they receive.

        Raises:
            BenchError: if the server has no start poses.
        """
        self.controllers: list[Controller] = []
        self._port, self._behaviour, self._keep = port, behaviour, keep
        self._dice = random.Random(seed)
        self._selector = selectors.DefaultSelector()
        self._numbers = count(1)
        self._drives: list[tuple[float, int, Controller]] = []
        self.tags = _ask_start_tags(port)

    def join(self, robot_class: str = DEFAULT_CLASS) -> Controller:
        """Connect one more and send its INIT; start poses are used in turn."""
        number = next(self._numbers)
        controller = Controller(self._port, f"R{number}", robot_class)
        tag = self.tags[(number - 1) % len(self.tags)]
        controller.joined = controller.send(
            f"INIT {{ClassName USARBot.{robot_class}}} {{Name {controller.name}}} {{Start {tag}}}"
        )
        self.controllers.append(controller)
        self._selector.register(controller.socket, selectors.EVENT_READ, controller)
        first = time.perf_counter() + self._dice.uniform(0.0, DRIVE_PERIOD)
        heapq.heappush(self._drives, (first, number, controller))
        return controller

    def leave(self, controller: Controller) -> None:
        """Hang up."""
        self._selector.unregister(controller.socket)
        controller.socket.close()
        self.controllers.remove(controller)
        self._drives = [entry for entry in self._drives if entry[2] is not controller]
        heapq.heapify(self._drives)

    def run(self, seconds: float) -> tuple[float, float]:
        """Read and drive for some s; the wall times at which that began and ended."""
        start = time.perf_counter()
        self._run_until(start + seconds, lambda: False)
        return start, time.perf_counter()

    def wait_until_speaking(self, controllers: Iterable[Controller] | None = None) -> None:
        """Read and drive until all, or the given ones, have a robot in the world.

        Raises:
            BenchError: if one has none after half a minute.
        """
        awaited = list(self.controllers if controllers is None else controllers)
        deadline = time.perf_counter() + _SPEAK_TIMEOUT
        self._run_until(deadline, lambda: all(one.speaking for one in awaited))
        silent = [one.name for one in awaited if not one.speaking]
        if silent:
            raise BenchError(f"no STA line after INIT for {', '.join(silent)}")

    def close(self) -> None:
        """Hang up on behalf of everybody."""
        for controller in list(self.controllers):
            self.leave(controller)
        self._selector.close()

    def _run_until(self, deadline: float, finished: Callable[[], bool]) -> None:
        gc.disable()  # it would walk over all that is stored
        try:
            while not finished() and (now := time.perf_counter()) < deadline:
                self._drive_due(now)
                wake = min(deadline, self._drives[0][0]) if self._drives else deadline
                for key, _ in self._selector.select(max(0.0, wake - now)):
                    key.data.read(self._keep)
        finally:
            gc.enable()

    def _drive_due(self, now: float) -> None:
        while self._drives and self._drives[0][0] <= now:
            due, number, controller = self._drives[0]
            self._behaviour(controller, self._dice)
            scatter = self._dice.uniform(1.0 - _DRIVE_SCATTER, 1.0 + _DRIVE_SCATTER)
            # Not before now: a client that was held up does not send in bursts.
            next_due = max(now, due + DRIVE_PERIOD * scatter)
            heapq.heapreplace(self._drives, (next_due, number, controller))


def _ask_start_tags(port: int) -> list[str]:
    with BlockingConnection(port, patience=_ANSWER_TIMEOUT) as client:
        line = client.ask(command("GETSTARTPOSES"), "NFO {StartPoses")
    match decode(line.raw.strip()):
        case [StartPoses(poses)] if poses:
            return [pose.tag for pose in poses]
    raise BenchError("the world has no start poses")
