"""All measurements by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime

from usarsim_bench.admission import measure_admission
from usarsim_bench.cameras import measure_cameras
from usarsim_bench.delivery import measure_delivery
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Plan, Report, Section
from usarsim_bench.garage import measure_garage
from usarsim_bench.groundtruth import measure_ground_truth
from usarsim_bench.hostile.measuring import measure_hostile
from usarsim_bench.importing import measure_importing
from usarsim_bench.jitter import measure_jitter
from usarsim_bench.latency import measure_latency
from usarsim_bench.lockstep import measure_lockstep
from usarsim_bench.machine import describe_machine
from usarsim_bench.memory import measure_memory
from usarsim_bench.physics import measure_physics
from usarsim_bench.rays import measure_rays
from usarsim_bench.relay import measure_relay
from usarsim_bench.rendering import measure_rendering
from usarsim_bench.sensors import measure_sensors
from usarsim_bench.soak import measure_soak
from usarsim_bench.spawn import measure_spawn
from usarsim_bench.stepping import measure_stepping
from usarsim_bench.swarm import measure_swarm
from usarsim_bench.team import measure_largest, measure_team
from usarsim_bench.watched import measure_watched

Measurement = Callable[[Plan], Section]

MEASUREMENTS: Mapping[str, tuple[Measurement, str]] = {
    # What decides how large a team a lab can run.
    "swarm": (measure_swarm, "real-time factor and cost of teams of 64 and 128"),
    "watched": (measure_watched, "24 robots whose cameras are all watched"),
    "physics": (measure_physics, "the physics thread of a running server against MuJoCo alone"),
    "rays": (measure_rays, "rays of all sensors against bare Embree"),
    "delivery": (measure_delivery, "pictures that arrive, against a loop that only renders"),
    "admission": (measure_admission, "from INIT to the first SEN, alone and in a crowd"),
    "jitter": (measure_jitter, "how evenly a stream of 10 Hz arrives from 24 robots"),
    "lockstep": (measure_lockstep, "how fast 16 robots can be simulated"),
    "memory": (measure_memory, "memory of 64 robots that come and go for ten minutes"),
    # Teams with all their sensors, and what single commands and newcomers take.
    "team": (measure_team, "real-time factor and cost of a team of 16"),
    "largest": (measure_largest, "largest team that keeps real time"),
    "latency": (measure_latency, "from DRIVE on the socket to the wheels"),
    "hostile": (measure_hostile, "what a team notices of every attack that we know of"),
    "spawn": (measure_spawn, "what the others notice of a newcomer"),
    # Kinds of robots and sensors, cameras, side channels, maps, the step loop.
    "sensors": (measure_sensors, "real time with a robot's every sensor, and with fast lasers"),
    "garage": (measure_garage, "real-time factor and cost of 16 robots of all kinds"),
    "cameras": (measure_cameras, "pictures of a team's cameras, and what they cost"),
    "rendering": (measure_rendering, "pictures against a bare MuJoCo renderer, and their age"),
    "groundtruth": (measure_ground_truth, "answers to the wireless simulation, and their cost"),
    "relay": (measure_relay, "what radio links carry, beside a plain proxy, and under a team"),
    "import": (measure_importing, "maps of other programs: import, cache, rays, a team in them"),
    "stepping": (measure_stepping, "the step loop against MuJoCo alone"),
    # What an hour leaves behind.
    "soak": (measure_soak, "memory while everything comes and goes for an hour"),
}
"""Function and one line of help of each, in the order in which `all` takes them."""

LONG = ("soak",)
"""What takes an hour."""
ALL = tuple(name for name in MEASUREMENTS if name not in LONG)
QUICK = tuple(name for name in ALL if name != "largest")
"""What is measured when it is to be quick: a search for the largest team cannot be."""
QUICK_SECONDS = 4.0
"""Length of each measurement then."""


def take(names: Sequence[str], plan: Plan, server_version: str) -> Report:
    """Take measurements, one after the other; one that fails does not keep the others back.

    Args:
        names: keys of `MEASUREMENTS`.
        plan: for each of them.
        server_version: for the report.
    """
    machine, now = describe_machine(server_version), datetime.now(UTC)
    return Report(machine, now, tuple(_take(name, plan) for name in names))


def _take(name: str, plan: Plan) -> Section:
    measure, title = MEASUREMENTS[name]
    try:
        return measure(plan)
    except BenchError as error:
        return Section(name, title[:1].upper() + title[1:], "", (), str(error))
