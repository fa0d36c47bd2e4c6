"""Rays per second of the server against bare Embree; measured inside one process by the server's
own instrument (`usarsim_bench.instruments.rays`), which says what is compared with what."""

from __future__ import annotations

import json
import subprocess
import sys

from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.robot_files import SCOUT, SCOUT_SENSORS, scouts

ROBOTS = (1, 16, 64)
SECONDS = 3.0
RATIO_AIM = Aim(">=", 0.5)
JUDGED = 16
"""Size of the team whose ratio has an aim."""

_INSTRUMENT = "usarsim_bench.instruments.rays"
_SHOWN_ERRORS = 2000


def measure_rays(plan: Plan) -> Section:
    """Teams that stand; `plan.seconds` of processor time for each loop."""
    seconds = plan.seconds or SECONDS
    figures: list[Figure] = []
    sizes = plan.sizes(ROBOTS, JUDGED)
    plan.say(f"rays: {', '.join(map(str, sizes))} robots in {plan.world}")
    with scouts() as classes:
        command = [sys.executable, "-m", _INSTRUMENT, "--world", plan.world]
        command += ["--class", SCOUT, "--folder", classes[-1], "--seconds", str(seconds)]
        command += ["--robots", *map(str, sizes)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError(f"the ray instrument failed: {done.stderr[-_SHOWN_ERRORS:].strip()}")
    for line in done.stdout.splitlines():
        figures += ray_figures(json.loads(line))
    return Section(
        "rays",
        "Rays against bare Embree",
        f"P3AT with {SCOUT_SENSORS} each, standing in {plan.world}; the rays of all sensors at one "
        "instant as one batch. Bare: the same rays, cast by Embree alone in one scene of all "
        "triangles of world and robots, which is built beforehand; it knows no glass, no ranges "
        "and no names, and does not leave out the own body. On one thread, in turns, rates per s "
        "of processor time.",
        tuple(figures),
    )


def ray_figures(found: dict[str, float]) -> list[Figure]:
    """What the instrument said about one team."""
    robots = int(found["robots"])
    team = f"{robots} robot{'s' if robots != 1 else ''}"
    aim = RATIO_AIM if robots == JUDGED else None
    return [
        Figure(f"{team}: server / bare Embree", found["server"] / found["bare"], "", 2, aim),
        Figure(
            f"{team}: the same, lasers alone", found["server_scans"] / found["bare_scans"], "", 2
        ),
        Figure(
            f"{team}: the same, against what never moves",
            found["scenery"] / found["bare_scenery"],
            "",
            2,
        ),
        Figure(f"{team}: server", found["server"] / 1e6, "M rays/s", 2),
        Figure(f"{team}: bare Embree", found["bare"] / 1e6, "M rays/s", 2),
        Figure(f"{team}: rays in the batch", found["rays"], "", 0),
    ]
