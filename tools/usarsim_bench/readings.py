"""What one reading of every type of sensor costs; measured inside one process by the server's own
instrument (`usarsim_bench.instruments.readings`), which says what is measured."""

from __future__ import annotations

import json
import subprocess
import sys

from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Figure, Plan, Section

ROBOTS = 16
ROUNDS_PER_SECOND = 5.0
"""Of the `plan.seconds` of simulated time."""
SECONDS = 6.0

_INSTRUMENT = "usarsim_bench.instruments.readings"
_SHOWN_ERRORS = 2000
_PATIENCE = 300.0


def measure_readings(plan: Plan) -> Section:
    """All types, read by a team for `plan.seconds` of simulated time."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"readings: {robots} robots with every type of sensor in {plan.world}")
    figures: list[Figure] = []
    for one in _measured(plan.world, robots, max(1, round(ROUNDS_PER_SECOND * seconds))):
        name = f"{one['type']} ({one['count']} rays)" if one["count"] else str(one["type"])
        figures += [
            Figure(name, float(one["whole"]), "us", 0),
            Figure(f"{name}: casting", float(one["cast"]), "us", 0),
            Figure(f"{name}: reading and text", float(one["text"]), "us", 0),
            Figure(f"{name}: alone", float(one["alone"]), "us", 0),
        ]
    return Section(
        "readings",
        "What a reading costs",
        f"Processor time of one reading of each type of sensor, from the robot's state to the line "
        f"of text, for {robots} robots in {plan.world} whose reports fall due together; alone: for "
        "one robot whose report falls due alone. Medians, dearest first.",
        tuple(figures),
    )


def _measured(world: str, robots: int, rounds: int) -> list[dict[str, float | str]]:
    command = [sys.executable, "-m", _INSTRUMENT, "--world", world]
    command += ["--robots", str(robots), "--rounds", str(rounds)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_PATIENCE
        )
    except subprocess.TimeoutExpired:
        raise BenchError(f"the readings took more than {_PATIENCE:g} s") from None
    if done.returncode != 0:
        raise BenchError(f"the readings instrument failed: {done.stderr[-_SHOWN_ERRORS:].strip()}")
    return [json.loads(line) for line in done.stdout.splitlines()]
