"""Clients that mean a server no good, in a process of their own.

`python -m usarsim_tools.bench.attackers PORT` attacks the control port PORT of this machine until
its standard input ends, then says on standard output what it did, as JSON.
"""

from __future__ import annotations

import contextlib
import json
import random
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

from usarsim_tools.bench.closing import CarefulClosing
from usarsim_tools.bench.errors import BenchError

__all__ = ["RECONNECTS", "Attackers", "Damage", "attack"]

RECONNECTS = 50.0
"""Connections that the restless client makes per second."""
DRIP = 1.0
"""s between two bytes of the slow client."""
_TIMEOUT = 1.0
_END_TIMEOUT = 10.0
_PIECE = 16384


@dataclass(slots=True)
class Damage:
    """What the attackers got through.

    Attributes:
        garbage: bytes of garbage that the server's machine took.
        drips: bytes that were sent one by one.
        reconnects: connections made and given up again.
        refused: attempts to connect, or to say something, that failed.
        seconds: of wall time that it lasted.
    """

    garbage: int = 0
    drips: int = 0
    reconnects: int = 0
    refused: int = 0
    seconds: float = 0.0


class Attackers(CarefulClosing):
    """The process of the attackers, as the one who started it sees it."""

    def __init__(self, port: int) -> None:
        """Let them loose on a control port."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "usarsim_tools.bench.attackers", str(port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def stop(self) -> Damage:
        """Call them back.

        Raises:
            BenchError: if they did not live to tell.
        """
        try:
            said, _ = self._process.communicate("", _END_TIMEOUT)
            return Damage(**json.loads(said))
        except (subprocess.TimeoutExpired, ValueError, TypeError):
            self.close()
            raise BenchError("the attackers failed themselves") from None

    def close(self) -> None:
        """End them, whatever they are at; a second call does nothing."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


def attack(port: int, ended: threading.Event, damage: Damage) -> None:
    """Do everything at once until the event is set; what is done is written down meanwhile."""
    begun = time.perf_counter()
    works: tuple[Callable[[int, threading.Event, Damage], None], ...] = (
        _never_read,
        _send_garbage,
        _drip,
        _reconnect,
    )
    threads = [
        threading.Thread(target=work, args=(port, ended, damage), daemon=True) for work in works
    ]
    for thread in threads:
        thread.start()
    ended.wait()
    damage.seconds = time.perf_counter() - begun
    for thread in threads:
        thread.join(2.0 * _TIMEOUT)


def _dial(port: int) -> socket.socket:
    client = socket.create_connection(("127.0.0.1", port), timeout=_TIMEOUT)
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return client


def _never_read(port: int, ended: threading.Event, damage: Damage) -> None:
    """Have a robot with all its streams, and never read a byte of them."""
    with contextlib.suppress(OSError), _dial(port) as client:
        client.sendall(b"INIT {ClassName USARBot.P3AT} {Name Deaf}\r\n")
        ended.wait()


def _send_garbage(port: int, ended: threading.Event, damage: Damage) -> None:
    """Random bytes, braces without end, commands without sense, as fast as they are taken."""
    chance = random.Random(0)
    pieces = (
        *(chance.randbytes(_PIECE) for _ in range(8)),
        b"{" * _PIECE,
        b"".join(b"DRIVE {Left %d} {x\r\n" % number for number in range(800)),
        b"X\n" * (_PIECE // 2),
    )
    while not ended.is_set():
        try:
            with _dial(port) as client:
                while not ended.is_set():
                    with contextlib.suppress(TimeoutError):
                        damage.garbage += client.send(chance.choice(pieces))
        except OSError:
            damage.refused += 1
            ended.wait(_TIMEOUT)


def _drip(port: int, ended: threading.Event, damage: Damage) -> None:
    """A line that never ends, byte by byte."""
    with contextlib.suppress(OSError), _dial(port) as client:
        while not ended.wait(DRIP):
            client.sendall(b"D")
            damage.drips += 1


def _reconnect(port: int, ended: threading.Event, damage: Damage) -> None:
    """Come, ask something and leave without the answer, again and again."""
    due = time.perf_counter()
    while not ended.wait(max(0.0, due - time.perf_counter())):
        due = max(time.perf_counter(), due + 1.0 / RECONNECTS)
        try:
            with _dial(port) as client:
                client.sendall(b"GETSTARTPOSES\r\n")
            damage.reconnects += 1
        except OSError:
            damage.refused += 1


def _main() -> None:
    ended = threading.Event()

    def watch() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=watch, daemon=True).start()
    damage = Damage()
    attack(int(sys.argv[1]), ended, damage)
    print(json.dumps(asdict(damage)), flush=True)


if __name__ == "__main__":
    _main()
