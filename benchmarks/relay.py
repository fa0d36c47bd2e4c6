"""What the relays of the wireless simulation carry, beside a plain proxy, and what a team costs.

The proxy, with asyncio streams, does nothing but read and write: `python -m benchmarks.relay
PORT` listens on any free port, says which on standard output, and passes every connection on to
PORT of this machine.
"""

from __future__ import annotations

import asyncio
import contextlib
import selectors
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median

from benchmarks.measures import p99
from benchmarks.plan import Plan
from benchmarks.server import CarefulClosing, Server, load_between
from benchmarks.team import ROBOTS, SETTLE, gather, load_figures, paces
from usarsim_bench.crowd import DEFAULT_CLASS, Controller, Crowd
from usarsim_bench.figures import Aim, BenchError, Figure, Section, in_ms
from usarsim_client import BlockingConnection, ProtocolError, command, road
from usarsim_server.base.launch import Program, python

CHUNK = 64 * 1024


async def serve(target: int) -> None:
    """Listen and pass on until cancelled."""

    async def join(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there_reader, there_writer = await asyncio.open_connection("127.0.0.1", target)
        with contextlib.suppress(OSError):
            await asyncio.gather(_pump(reader, there_writer), _pump(there_reader, writer))
        for one in (writer, there_writer):
            one.close()

    server = await asyncio.start_server(join, "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


async def _pump(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(CHUNK):
        writer.write(data)
        await writer.drain()
    writer.write_eof()


SECONDS = 10.0
RATE = 100_000
"""Bytes/s that every station sends to the base."""
TICK = 0.05
PINGS = 300
BLOCK = 64 * 1024
_PATIENCE = 10.0

THROUGHPUT_AIM = Aim(">=", 0.5)
FACTOR_AIM = Aim(">=", 0.999)
DELIVERED_AIM = Aim(">=", 0.99)

RADIO = 'model = "obstacle"\nwall_attenuation = 0\nshare = 64.0\n'
"""Obstacles are counted as usual, but nobody gets out of range; links may use what there is."""


class Radio:
    """A station that is registered with the wireless simulation.

    Attributes:
        name: of its robot.
    """

    def __init__(self, port: int, name: str) -> None:
        """Register.

        Raises:
            BenchError: if the server does not want it.
        """
        self.name = name
        self._listening = socket.create_server(("127.0.0.1", 0))
        self._listening.settimeout(_PATIENCE)
        self._control = BlockingConnection(port, patience=_PATIENCE)
        own = self._listening.getsockname()[1]
        self._ask(f"INIT {{Robot {name}}} {{Port {own}}}", "INITREPLY {Status OK}")

    def road(self, other: str) -> int:
        """Port of the server that leads to another station."""
        return road(self._ask(f"DNS {{Robot {other}}}", "DNSREPLY"), other)

    def accept(self) -> socket.socket:
        """Take a connection that the server made."""
        end, _ = self._listening.accept()
        end.settimeout(_PATIENCE)
        return end

    def call(self, other: Radio) -> tuple[socket.socket, socket.socket]:
        """A link to another station: our end and theirs."""
        mine = BlockingConnection(self.road(other.name), patience=_PATIENCE)
        return mine.socket, other.accept()

    def close(self) -> None:
        """Hang up."""
        self._control.close()
        self._listening.close()

    def _ask(self, line: str, expected: str) -> str:
        try:
            answer = self._control.ask(command(line)).text
        except ProtocolError:
            raise BenchError(f"the wireless simulation hung up on {self.name}") from None
        if not answer.startswith(expected):
            raise BenchError(f"{line} was answered {answer}")
        return answer


def throughput(mine: socket.socket, theirs: socket.socket, seconds: float) -> float:
    """Bytes/s that arrive while one side sends as much as it can."""
    stop = threading.Event()

    def send() -> None:
        block = bytes(BLOCK)
        with contextlib.suppress(OSError):
            while not stop.is_set():
                mine.sendall(block)
            mine.shutdown(socket.SHUT_WR)

    sender = threading.Thread(target=send, daemon=True)
    sender.start()
    got, start = 0, time.perf_counter()
    while (now := time.perf_counter()) < start + seconds:
        got += len(theirs.recv(1 << 20))
    stop.set()
    while theirs.recv(1 << 20):
        pass
    sender.join(_PATIENCE)
    return got / (now - start)


def round_trips(mine: socket.socket, theirs: socket.socket, count: int) -> list[float]:
    """Seconds that a short message takes there and back, one after the other."""
    taken = []
    message = b"x" * 64
    for _ in range(count):
        start = time.perf_counter()
        mine.sendall(message)
        _receive(theirs, len(message))
        theirs.sendall(message)
        _receive(mine, len(message))
        taken.append(time.perf_counter() - start)
    return taken


class Traffic(CarefulClosing):
    """Stations that send at an even rate, and a base that counts; on a thread of its own.

    Attributes:
        sent, received: bytes.
        delays: s that a tick's bytes took to arrive, of every link.
    """

    def __init__(self, links: Sequence[tuple[socket.socket, socket.socket]], rate: int) -> None:
        """Begin to send so many bytes/s over each link, given by the ends of sender and base."""
        self.sent = self.received = 0
        self.delays: list[float] = []
        self._links = [_Flow(mine, theirs) for mine, theirs in links]
        self._block = bytes(int(rate * TICK))
        self._stop = threading.Event()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop sending and wait for the rest.

        Raises:
            BenchError: if a link was lost.
        """
        self._stop.set()
        self._thread.join(_PATIENCE)
        if self._error is not None:
            raise BenchError(f"a link of the wireless simulation was lost: {self._error}")

    def _run(self) -> None:
        try:
            self._work()
        except Exception as error:  # told by `close`, on the caller's thread
            self._error = error

    def _work(self) -> None:
        with selectors.DefaultSelector() as selector:
            for flow in self._links:
                selector.register(flow.theirs, selectors.EVENT_READ, flow)
            due = time.perf_counter()
            end = float("inf")
            while (now := time.perf_counter()) < end and not (
                self._stop.is_set() and self.received >= self.sent
            ):
                if self._stop.is_set():
                    end = min(end, now + 2.0)
                elif now >= due:
                    due = max(due + TICK, now)
                    for flow in self._links:
                        flow.mine.sendall(self._block)
                        self.sent += len(self._block)
                        flow.sent.append(now)
                for key, _ in selector.select(max(0.0, min(due, now + TICK) - now)):
                    self._read(key.data)

    def _read(self, flow: _Flow) -> None:
        data = flow.theirs.recv(BLOCK)
        if not data:
            raise BenchError("hung up")
        self.received += len(data)
        flow.received += len(data)
        while flow.arrived < len(flow.sent) and (
            flow.received >= (flow.arrived + 1) * len(self._block)
        ):
            self.delays.append(time.perf_counter() - flow.sent[flow.arrived])
            flow.arrived += 1


class _Flow:
    """One link and what is known about it."""

    def __init__(self, mine: socket.socket, theirs: socket.socket) -> None:
        self.mine, self.theirs = mine, theirs
        self.sent: list[float] = []
        self.received = self.arrived = 0


def measure_relay(plan: Plan) -> Section:
    """Relays beside a proxy, then under a team; each takes `plan.seconds` of wall time."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"relay: one link, then {robots} robots for {seconds:g} s, twice")
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        file = Path(folder) / "radio.toml"
        file.write_text(RADIO, encoding="utf-8")
        server = stack.enter_context(Server(plan.world, robots + 1, "--wireless", str(file)))
        crowd = stack.enter_context(Crowd(server.port, plan.seed))
        gather(crowd, 2, ("ComStation", DEFAULT_CLASS))
        port = server.ports["wireless"]
        base, first = (_registered(stack, port, one) for one in crowd.controllers)
        rate, pings = _measure_path(*first.call(base), seconds)
        with _proxy_link() as (mine, theirs):
            proxy_rate, proxy_pings = _measure_path(mine, theirs, seconds)
        gather(crowd, robots - 1, (DEFAULT_CLASS,))
        team = [first, *(_registered(stack, port, one) for one in crowd.controllers[2:])]
        links = [one.call(base) for one in team]
        crowd.run(SETTLE)
        quiet = _factor(crowd, seconds)
        before = server.usage()
        with Traffic(links, RATE) as traffic:
            busy = _factor(crowd, seconds)
            load = load_between(before, server.usage())
    return Section(
        "relay",
        "Radio links",
        "One link of the wireless simulation and a plain asyncio proxy in the same run, "
        f"{seconds:g} s each; then {robots} {DEFAULT_CLASS} in {plan.world}, first silent, then "
        f"each sending {RATE / 1e3:g} kB/s to a base, {seconds:g} s each.",
        (
            Figure("Throughput of one link", rate / 1e6, "MB/s", 0),
            Figure("Throughput of the proxy", proxy_rate / 1e6, "MB/s", 0),
            Figure("Link to proxy, throughput", rate / proxy_rate, "", 2, THROUGHPUT_AIM),
            in_ms("Round trip of one link, median", median(pings), 3),
            in_ms("Round trip of the proxy, median", median(proxy_pings), 3),
            Figure("Real-time factor without traffic", quiet, "", 4),
            Figure("Real-time factor with traffic", busy, "", 4, FACTOR_AIM),
            Figure("Part that arrived", traffic.received / traffic.sent, "", 4, DELIVERED_AIM),
            Figure("Data carried", traffic.sent / seconds / 1e3, "kB/s", 0),
            in_ms("Delay of 50 ms of data, median", median(traffic.delays)),
            in_ms("Delay of 50 ms of data, 99 %", p99(traffic.delays)),
            Figure("Processor use of the server", load.process, "cores", 2),
            *load_figures(load),
        ),
    )


def _registered(stack: ExitStack, port: int, controller: Controller) -> Radio:
    radio = Radio(port, controller.name)
    stack.callback(radio.close)
    return radio


def _measure_path(
    mine: socket.socket, theirs: socket.socket, seconds: float
) -> tuple[float, list[float]]:
    """Bytes/s of a link, and s of its round trips."""
    pings = round_trips(mine, theirs, PINGS)
    with mine, theirs:
        return throughput(mine, theirs, seconds), pings


def _factor(crowd: Crowd, seconds: float) -> float:
    """Real-time factor of the robot that had the lowest."""
    return min(factor for factor, _ in paces(crowd, *crowd.run(seconds)))


@contextmanager
def _proxy_link() -> Iterator[tuple[socket.socket, socket.socket]]:
    """A connection through a proxy in a process of its own, as the server is one."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(_PATIENCE)
        port = str(listening.getsockname()[1])
        with Program("the proxy", python("-m", "benchmarks.relay", port, tied=True)) as proxy:
            [said] = proxy.announced(r"\d+")
            mine = BlockingConnection(int(said[0]), patience=_PATIENCE).socket
            theirs, _ = listening.accept()
            theirs.settimeout(_PATIENCE)
            yield mine, theirs


def _receive(end: socket.socket, size: int) -> None:
    while size:
        data = end.recv(size)
        if not data:
            raise BenchError("a link of the wireless simulation was lost")
        size -= len(data)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serve(int(sys.argv[1])))
