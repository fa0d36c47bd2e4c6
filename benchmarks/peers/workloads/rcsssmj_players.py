"""Players over sockets in the soccer server: python -I rcsssmj_players.py WORK.json RESULT.json.

The server runs in a process of its own, not in real time, and waits in every cycle for an answer
of every player; the players live here, in one thread.
"""

from __future__ import annotations

import json
import math
import os
import re
import selectors
import socket
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from typing import Any

MODEL = "K1"
"""The robot: 22 joints, about as many as a Nao has."""
RULES, PER_TEAM = "fifa", 11
STIFFNESS, DAMPING = 100.0, 3.0
"""N m/rad and N m s/rad of every joint; with them it stands."""
SWING, SWING_RATE = 10.0, 3.0
"""Degrees and rad/s by which arms swing."""
PATIENCE = 30.0
SETTLE = 1.0
"""s before the first player asks to join: one that comes before the server's first step ends the
server (0.2.1)."""
ATTEMPTS = 3
TICK = os.sysconf("SC_CLK_TCK")
NOW = re.compile(rb"\(now ([-0-9.e]+)\)")
JOINT = re.compile(rb"\(HJ \(n q_(\w+)\)")


class Player:
    """One connection.

    Attributes:
        now: simulated time of the last perception, s.
        perceptions, octets: received so far.
    """

    def __init__(self, connection: socket.socket, number: int) -> None:
        team, shirt = divmod(number, PER_TEAM)
        self.now = -math.inf
        self.perceptions = self.octets = 0
        self._buffer = b""
        self._place = (-4.0 - 4.0 * (shirt // 4), 4.0 * (shirt % 4) - 6.0)
        self._joints: list[str] = []
        self.socket = connection
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._send(f"(init {MODEL} team{team} {shirt + 1})")

    def serve(self) -> None:
        """Read what is there and answer each perception."""
        data = self.socket.recv(65536)
        if not data:
            raise ConnectionError("the server hung up")
        self._buffer += data
        while len(self._buffer) >= 4:
            size = int.from_bytes(self._buffer[:4], "big")
            if len(self._buffer) < 4 + size:
                break
            message, self._buffer = self._buffer[4 : 4 + size], self._buffer[4 + size :]
            self._answer(message)

    def _answer(self, message: bytes) -> None:
        self.perceptions += 1
        self.octets += 4 + len(message)
        found = NOW.search(message)
        if found is not None:
            self.now = float(found[1])
        if not self._joints:
            # Sensors are called hj1, laj1 ...; their motors he1, lae1 ...
            names = [name.decode() for name in JOINT.findall(message)]
            self._joints = [name.replace("j", "e", 1) for name in names]
            self._send(f"(beam {self._place[0]:g} {self._place[1]:g} 0)")
            return
        swing = SWING * math.sin(SWING_RATE * self.now)
        self._send(
            "".join(
                f"({name} {swing if name[:2] in ('la', 'ra') else 0.0:.2f} 0 "
                f"{STIFFNESS:g} {DAMPING:g} 0)"
                for name in self._joints
            )
        )

    def _send(self, text: str) -> None:
        message = text.encode()
        self.socket.sendall(len(message).to_bytes(4, "big") + message)


class Game:
    """A server and its players."""

    def __init__(self, folder: str) -> None:
        self.players: list[Player] = []
        self._selector = selectors.DefaultSelector()
        self._port, monitors = _free_ports()
        command = [sys.executable, "-I", "-m", "rcsssmj", "--no-render", "--no-realtime", "--sync"]
        command += ["--rules", RULES, "--aport", str(self._port), "--mport", str(monitors)]
        # It logs to a file in its working directory.
        self.process = subprocess.Popen(
            command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def _connect(self, port: int) -> socket.socket:
        """Connect as soon as the server listens."""
        deadline = time.perf_counter() + PATIENCE
        while True:
            try:
                return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
            except OSError:
                if time.perf_counter() > deadline or self.process.poll() is not None:
                    raise
                time.sleep(0.1)

    def join(self, number: int) -> None:
        """Bring in one more player and play until it perceives."""
        deadline = time.perf_counter() + PATIENCE
        connection = self._connect(self._port)
        if not self.players:
            time.sleep(SETTLE)
        player = Player(connection, number)
        self.players.append(player)
        self._selector.register(player.socket, selectors.EVENT_READ, player)
        while not player.perceptions:
            if time.perf_counter() > deadline:
                raise TimeoutError(f"player {number + 1} perceives nothing")
            self.play()

    def play(self) -> None:
        """Serve whoever has something to read."""
        for key, _ in self._selector.select(1.0):
            key.data.serve()

    def play_until(self, now: float, deadline: float) -> None:
        """Play until the first player perceives a simulated time."""
        while self.players[0].now < now and time.perf_counter() < deadline:
            self.play()

    def cpu(self) -> float:
        """Processor time that the server has used, s (proc(5), fields 14 and 15)."""
        with open(f"/proc/{self.process.pid}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / TICK

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self.process.wait()
        for player in self.players:
            player.socket.close()
        self._selector.close()


def _free_ports() -> tuple[int, int]:
    with (
        socket.create_server(("127.0.0.1", 0)) as one,
        socket.create_server(("127.0.0.1", 0)) as other,
    ):
        return one.getsockname()[1], other.getsockname()[1]


def measure(game: Game, work: dict[str, Any]) -> dict[str, Any]:
    """Let everybody join, then measure."""
    for number in range(work["robots"]):
        game.join(number)
    first = game.players[0]
    game.play_until(first.now + work["warm_up"], time.perf_counter() + PATIENCE)
    messages = sum(one.perceptions for one in game.players)
    octets = sum(one.octets for one in game.players)
    start, wall, cpu = first.now, time.perf_counter(), game.cpu()
    game.play_until(start + work["seconds"], wall + work["wall_limit"])
    cpu, wall = game.cpu() - cpu, time.perf_counter() - wall
    return {
        "version": version("rcsssmj"),
        "simulated": first.now - start,
        "wall": wall,
        "cpu": cpu,
        "counts": {
            "messages": sum(one.perceptions for one in game.players) - messages,
            "octets": sum(one.octets for one in game.players) - octets,
        },
    }


def attempt(work: dict[str, Any]) -> dict[str, Any]:
    """Start a game of its own, measure, end it."""
    with tempfile.TemporaryDirectory() as folder:
        game = Game(folder)
        try:
            return measure(game, work)
        finally:
            game.close()


def main() -> None:
    """Do the work, write the result."""
    with open(sys.argv[1], encoding="utf-8") as file:
        work = json.load(file)
    for left in reversed(range(ATTEMPTS)):
        try:
            result = attempt(work)
            break
        except OSError:
            if not left:
                raise
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump(result, file)


if __name__ == "__main__":
    main()
