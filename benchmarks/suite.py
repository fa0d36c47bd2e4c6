"""All measurements by name."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

from benchmarks.plan import Plan
from usarsim_bench.figures import Report, Section, describe_machine
from usarsim_server.base.errors import UsarsimError

MEASUREMENTS: Mapping[str, tuple[str, str]] = {
    # What decides how large a team a lab can run.
    "swarm": ("swarm", "real-time factor and cost of teams of 64 and 128"),
    "watched": ("cameras", "24 robots whose cameras are all watched"),
    "physics": ("physics", "the physics thread of a running server against MuJoCo alone"),
    "rays": ("rays", "rays of all sensors against bare Embree"),
    "delivery": ("delivery", "pictures that arrive, against a loop that only renders"),
    "admission": ("admission", "from INIT to the first SEN, alone and in a crowd"),
    "jitter": ("swarm", "how evenly a stream of 10 Hz arrives from 24 robots"),
    "lockstep": ("swarm", "how fast 16 robots can be simulated"),
    "memory": ("memory", "memory of 64 robots that come and go for ten minutes"),
    # Teams with all their sensors, and what single commands and newcomers take.
    "team": ("team", "real-time factor and cost of a team of 16"),
    "largest": ("team", "largest team that keeps real time"),
    "latency": ("latency", "from DRIVE on the socket to the wheels"),
    "hostile": ("hostile_trial", "what a team notices of every attack that we know of"),
    "spawn": ("admission", "what the others notice of a newcomer"),
    # Kinds of robots and sensors, cameras, side channels, maps, the step loop.
    "sensors": ("sensors", "real time with a robot's every sensor, and with fast lasers"),
    "garage": ("team", "real-time factor and cost of 16 robots of all kinds"),
    "cameras": ("cameras", "pictures of a team's cameras, and what they cost"),
    "rendering": ("rendering", "pictures against a bare MuJoCo renderer, and their age"),
    "groundtruth": ("groundtruth", "answers to the wireless simulation, and their cost"),
    "relay": ("relay", "what radio links carry, beside a plain proxy, and under a team"),
    "import": ("importing", "maps of other programs: import, cache, rays, a team in them"),
    "stepping": ("stepping", "the step loop against MuJoCo alone"),
    "mission": ("mission", "what a referee costs, how fast a trial runs, how long reports take"),
    "explore": ("exploration", "a step of exploration on the grid, by team and environment"),
    "gym": ("gym", "environments for learning: steps, resets and memory of 100,000 steps"),
    # The operator console, in a browser.
    "console": ("console.measuring", "the operator console: sizes, costs, from key to wire"),
    # What an hour leaves behind.
    "soak": ("soak", "memory while everything comes and goes for an hour"),
}
"""Module of each, where `measure_NAME` makes a section of a plan, and one line of help; in the
order in which `all` takes them."""

LONG = ("console", "soak")
"""What takes half an hour or more."""
ALL = tuple(name for name in MEASUREMENTS if name not in LONG)
QUICK = tuple(name for name in ALL if name != "largest")
"""What is measured when it is to be quick: a search for the largest team cannot be."""
QUICK_SECONDS = 4.0
"""Length of each measurement then."""


def take(names: Sequence[str], plan: Plan, server_version: str) -> Report:
    """Take measurements, by keys of `MEASUREMENTS`, one after the other; one that fails does not
    keep the others back."""
    machine, now = describe_machine(server_version), datetime.now(UTC)
    return Report(machine, now, tuple(_take(name, plan) for name in names))


def _take(name: str, plan: Plan) -> Section:
    module, title = MEASUREMENTS[name]
    # What some of them need, such as MuJoCo and a whole server, is imported only with them.
    found = importlib.import_module(f"benchmarks.{module}")
    try:
        section: Section = getattr(found, f"measure_{name}")(plan)
    except UsarsimError as error:
        return Section(name, title[:1].upper() + title[1:], "", (), str(error))
    return section
