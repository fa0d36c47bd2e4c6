"""How fast robots with lasers run in lockstep: the server's part of a comparison with others.

The work comes as a file that other simulators are given too (`benchmarks.peers.work`); the
same things are counted. The whole server takes part but its sockets: commands are parsed, sessions
run in their threads, reports are written as text. The clock does not hold anything up.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks import stepping
from usarsim_server import __version__
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.testing import Rehearsal

_SCAN = re.compile(r"SEN .*\{Type RangeScanner\}.*\{Range ([^{}]*)\}")


@dataclass(slots=True)
class Counts:
    """What was done within the measured time."""

    scans: int = 0  # whole scans, their beams, and those of them that hit something
    beams: int = 0
    hits: int = 0
    reach: float = 0.0  # sum of all ranges measured, m
    metres: float = 0.0  # way of all robots together

    def add_scan(self, line: str, far: float) -> None:
        """Count a line if it is a scan; `far` is the range of a beam that hits nothing, m."""
        found = _SCAN.match(line)
        if found is None:
            return
        ranges = [float(text) for text in found[1].split(",")]
        self.scans += 1
        self.beams += len(ranges)
        self.hits += sum(one < far for one in ranges)
        self.reach += sum(ranges)


def drive(work: dict[str, Any], world: Path, robots: Path, robot_class: str) -> dict[str, Any]:
    """Let robots do the work; returns versions, times (s) and counts.

    Raises:
        UsarsimError: if world or class cannot be used.
        RuntimeError: if a robot does not come into the world.
    """
    with Rehearsal(world=world, robots=(robots,), max_robots=work["robots"]) as rehearsal:
        crowd = _Crowd(rehearsal, work, robot_class)
        crowd.run(work["warm_up"], math.inf)
        crowd.forget()
        wall, cpu = time.perf_counter(), time.process_time()
        simulated = crowd.run(work["seconds"], wall + work["wall_limit"])
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        counts = crowd.counts(work["laser"]["range"])
    return {
        "version": __version__,
        "simulated": simulated,
        "wall": wall,
        "cpu": cpu,
        "counts": {name: getattr(counts, name) for name in Counts.__slots__},
    }


class _Crowd:
    """The robots' controllers; what they hear is looked at after the measurement."""

    def __init__(self, rehearsal: Rehearsal, work: dict[str, Any], robot_class: str) -> None:
        self._rehearsal, self._work = rehearsal, work
        self._period = 1.0 / work["laser"]["rate"]
        self._number = 0
        self._clients = [rehearsal.connect() for _ in range(work["robots"])]
        for number, client in enumerate(self._clients, start=1):
            client.send(
                f"INIT {{ClassName USARBot.{robot_class}}} {{Name R{number}}} "
                f"{{Start Start{number}}}"
            )
        if len(self._places()) != work["robots"]:
            raise RuntimeError("not all robots came into the world")
        self.forget()

    def forget(self) -> None:
        """Begin to count."""
        for client in self._clients:
            client.take()
        self._heard: list[str] = []
        self._metres = 0.0
        self._last = self._places()

    def run(self, seconds: float, deadline: float) -> float:
        """Advance by one command at least; returns the simulated s done."""
        begin = self._rehearsal.time
        while True:
            self._command()
            for _ in range(round(self._work["command_period"] / self._period)):
                self._rehearsal.run(self._period)
                self._note_places()
            for client in self._clients:
                self._heard += client.take("SEN")
            done = self._rehearsal.time - begin
            # Times add up in steps of the physics, not exactly to the end.
            if done > seconds - self._period / 2 or time.perf_counter() > deadline:
                return done

    def counts(self, far: float) -> Counts:
        """What was heard and done since the last `forget`."""
        counts = Counts(metres=self._metres)
        for line in self._heard:
            counts.add_scan(line, far)
        return counts

    def _command(self) -> None:
        commands = self._work["commands"]
        speeds = commands[self._number % len(commands)]
        self._number += 1
        for client, (left, right) in zip(self._clients, speeds, strict=True):
            client.send(f"DRIVE {{Left {left:g}}} {{Right {right:g}}}")

    def _note_places(self) -> None:
        places = self._places()
        self._metres += sum(map(math.dist, places, self._last))
        self._last = places

    def _places(self) -> list[tuple[float, float]]:
        snapshot = self._rehearsal.assembly.simulation.look()
        layouts = sorted(snapshot.layouts.items())
        bodies = [snapshot.xpos[layout.base] for _, layout in layouts]
        return [(float(place[0]), float(place[1])) for place in bodies]


def bare(work: dict[str, Any], world: Path) -> dict[str, Any]:
    """MuJoCo alone in the same world: `mj_step` in a loop, no laser, no server, wheels driven.

    Its robots are plain P3AT; see `benchmarks.stepping`. Times are processor
    times, since another loop runs in turns with it.
    """
    result = stepping.measure(str(world), work["robots"], work["seconds"])
    simulated = result.steps * PhysicsOptions().timestep
    seconds = result.steps / result.bare
    return {
        "version": __version__,
        "simulated": simulated,
        "wall": seconds,
        "cpu": seconds,
        "counts": {"contacts": result.bare_contacts},
    }


def main(arguments: Sequence[str]) -> int:
    """Do the work of a file, write the result to another."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.rovers")
    parser.add_argument("work", type=Path)
    parser.add_argument("result", type=Path)
    parser.add_argument("--world", type=Path, required=True, help="folder")
    parser.add_argument("--robots", type=Path, help="folder of robot files")
    parser.add_argument("--robot-class", default="P3AT")
    parser.add_argument("--bare", action="store_true", help="MuJoCo alone")
    given = parser.parse_args(arguments)
    work = json.loads(given.work.read_text(encoding="utf-8"))
    if given.bare:
        result = bare(work, given.world)
    else:
        result = drive(work, given.world, given.robots, given.robot_class)
    given.result.write_text(json.dumps(result), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
