"""What teams cost that differ in one thing, in one process and in turns, without sockets and clock.

All teams are there at once, each in a world of its own; then each in its turn lives through a short
stretch of simulated time, again and again, so that whatever disturbs one disturbs all. Costs are
medians of processor time: of the thread that steps, and of all others, which write the reports.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from typing import Any

from usarsim_server.testing import Rehearsal, RehearsedClient

STRETCH = 0.5
"""Simulated s of a turn: between two commands of a robot, as with a real controller."""
WARM_UP = 2
"""Turns that do not count."""


class _Team:
    """One team in its world.

    Attributes:
        physics, reports: processor seconds per simulated second, of each turn that counted.
    """

    def __init__(self, work: Mapping[str, Any], seed: int) -> None:
        self.physics: list[float] = []
        self.reports: list[float] = []
        self._dice = random.Random(seed)
        settings: dict[str, object] = {"timestep": work["timestep"]} if "timestep" in work else {}
        self.rehearsal = Rehearsal(
            world=work["world"],
            robots=(Path(work["classes"]),),
            max_robots=work.get("room", work["robots"]),
            **settings,
        )
        starts = self.rehearsal.assembly.world.starts
        self._clients: list[RehearsedClient] = []
        for number in range(work["robots"]):
            client = self.rehearsal.connect()
            client.send(
                f"INIT {{ClassName USARBot.{work['robot_class']}}} {{Name R{number}}} "
                f"{{Start {starts[number % len(starts)].tag}}}"
            )
            self._clients.append(client)

    def turn(self, keep: bool) -> None:
        """Let the robots drive for a while."""
        for client in self._clients:
            left, right = self._dice.uniform(-100.0, 100.0), self._dice.uniform(-100.0, 100.0)
            client.send(f"DRIVE {{Left {left:.1f}}} {{Right {right:.1f}}} {{Normalized True}}")
        own, everybody = time.thread_time(), time.process_time()
        self.rehearsal.run(STRETCH)
        own, everybody = time.thread_time() - own, time.process_time() - everybody
        for client in self._clients:
            client.take()
        if keep:
            self.physics.append(own / STRETCH)
            self.reports.append(max(0.0, everybody - own) / STRETCH)


def measure(works: Sequence[Mapping[str, Any]], turns: int, seed: int) -> list[dict[str, float]]:
    """The cost of each team, in the order given.

    Args:
        works: `world`, `classes` (a folder), `robot_class`, `robots`; `timestep` and `room` if they
            differ from the defaults.
        turns: that count.
        seed: of the commands, the same for all teams.

    Raises:
        UsarsimError: if a world or class cannot be used.
    """
    with ExitStack() as stack:
        teams = []
        for work in works:
            team = _Team(work, seed)
            stack.enter_context(team.rehearsal)
            teams.append(team)
        for number in range(WARM_UP + turns):
            for team in teams:
                team.turn(keep=number >= WARM_UP)
        return [
            {"physics": median(team.physics), "reports": median(team.reports)} for team in teams
        ]


def main(arguments: Sequence[str]) -> int:
    """Measure the teams of a JSON file; print a JSON list.

    Args:
        arguments: the file with `works`, `turns` and `seed` as `measure` takes them.
    """
    asked = json.loads(Path(arguments[0]).read_text())
    print(json.dumps(measure(asked["works"], asked["turns"], asked["seed"])))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
