"""A long run by itself: robots drive about, and a hash of all they hear and of the world is shown.

Run as a program with a seed and a number of simulated seconds.
"""

from __future__ import annotations

import hashlib
import random
import sys
import tempfile
from pathlib import Path

from usarsim_server.testing import Rehearsal, RehearsedClient

ROBOTS = 8
PAUSE = 1.0
"""Simulated s between two commands of a robot."""

SCOUT = """
extends = "P3AT"
without = ["TachTest", "W2", "battery"]
sensor = [
    { type = "GroundTruth", name = "GndTruth", interval = 0.5 },
    { type = "INS", name = "InsTest", interval = 0.5 },
    { type = "SICK", name = "lms200", position = [0.2085, 0, -0.2], interval = 1.0 },
    { type = "Encoder", name = "W1", wheel = 1, interval = 0.5 },
    { type = "Odometry", name = "Odometer", interval = 0.5 },
    { type = "Sonar", name = "F1", position = [0.245, 0, -0.06], interval = 0.5, noise = 0.01 },
]
[drive]
max_wheel_speed = 8.17
"""


class Listener(RehearsedClient):
    """A client that keeps a hash of what it hears instead of the text."""

    def __init__(self, stage: Rehearsal, peer: str) -> None:
        super().__init__(stage, peer)
        self.digest = hashlib.sha256()
        self.heard = 0

    def hear(self, line: bytes) -> None:
        """Add a line to the hash."""
        self.digest.update(line)
        self.heard += 1


def play(seed: int, seconds: float) -> str:
    """The run; returns the hash, how many lines were heard, and the simulated time reached."""
    dice = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "Scout.toml").write_text(SCOUT, encoding="utf-8")
        with Rehearsal(world="arena", seed=seed, timestep=0.005, robots=(Path(folder),)) as stage:
            clients = [Listener(stage, f"scout{number}") for number in range(ROBOTS)]
            starts = stage.assembly.world.starts
            for number, client in enumerate(clients):
                tag = starts[number % len(starts)].tag
                client.send(f"INIT {{ClassName Scout}} {{Start {tag}}}")
            while stage.time < seconds:
                for client in clients:
                    left, right = dice.uniform(-40.0, 100.0), dice.uniform(-40.0, 100.0)
                    client.send(f"DRIVE {{Left {left}}} {{Right {right}}} {{Normalized True}}")
                stage.run(PAUSE)
            total = hashlib.sha256()
            for client in clients:
                total.update(client.digest.digest())
            snapshot = stage.assembly.simulation.look()
            for state in (snapshot.qpos, snapshot.qvel, snapshot.xpos):
                total.update(state.tobytes())
            heard = sum(client.heard for client in clients)
            return f"{total.hexdigest()} {heard} {snapshot.time:.3f}"


if __name__ == "__main__":
    print(play(int(sys.argv[1]), float(sys.argv[2])))
