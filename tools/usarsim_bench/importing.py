"""Maps of other programs: what their import takes, and how robots get on in them.

The maps are written by the measurement itself (`map_sources.py`). Import and rays are measured by
the server's own instrument (`usarsim_bench.instruments.importing`), the robots from outside.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from usarsim_bench.camera_client import Viewer, summed_up
from usarsim_bench.cameras import RATE, TILE
from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.map_sources import BRUSHES, MESHES, write_hall, write_yard
from usarsim_bench.server import Server
from usarsim_bench.team import MIB, load_figures, try_team

ROBOTS = 4
SECONDS = 20.0

FACTOR_AIM = Aim(">=", 0.999)
CACHE_AIM = Aim(">=", 5.0)
SCAN_AIM = Aim("<", 100.0)
PICTURES_AIM = Aim(">=", 0.9 * RATE)

_INSTRUMENT = "usarsim_bench.instruments.importing"
_SHOWN_ERRORS = 2000
_PATIENCE = 300.0
"""s after which an import is given up."""


@dataclass(frozen=True, slots=True)
class Map:
    """One map.

    Attributes:
        name: for people.
        source: its file.
        assets: folders of the meshes that it names.
        seconds: aim for its import.
        scan: aim for a scan, us; None where it only informs.
    """

    name: str
    source: Path
    assets: Sequence[Path]
    seconds: Aim
    scan: Aim | None


def measure_importing(plan: Plan) -> Section:
    """Import two maps and let a team drive in each; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    figures: list[Figure] = []
    with tempfile.TemporaryDirectory(prefix="usarsim-bench-") as name:
        for one in _maps(Path(name)):
            plan.say(f"import: {one.name.lower()}, then {robots} robots in it for {seconds:g} s")
            out = Path(name, "worlds")
            out.mkdir(exist_ok=True)
            figures += _import_figures(one, _measured(one, out))
            figures += _team_figures(one, out / one.source.stem, robots, seconds, plan.seed)
    return Section(
        "import",
        "Maps of other programs",
        f"Hall: Unreal text of {BRUSHES} brushes, and {MESHES} static meshes of ten files. Yard: "
        "one COLLADA file. Both are written by the measurement; imported with an empty cache, then "
        f"again; scans are 181 beams of 20 m. Then {robots} {DEFAULT_CLASS} with all their sensors "
        f"drive at random for {seconds:g} s while an image client watches one tile at {RATE:g} Hz.",
        tuple(figures),
    )


def _maps(folder: Path) -> list[Map]:
    hall, assets = write_hall(folder)
    yard = write_yard(folder)
    return [
        Map("Hall", hall, (assets,), Aim("<", 10.0), None),
        Map("Yard", yard, (), Aim("<", 15.0), SCAN_AIM),
    ]


def _measured(one: Map, out: Path) -> dict[str, float]:
    command = [sys.executable, "-m", _INSTRUMENT, str(one.source), "--out", str(out)]
    for folder in one.assets:
        command += ["--assets", str(folder)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_PATIENCE
        )
    except subprocess.TimeoutExpired:
        raise BenchError(f"the import of {one.name} took more than {_PATIENCE:g} s") from None
    if done.returncode != 0:
        raise BenchError(f"the import instrument failed: {done.stderr[-_SHOWN_ERRORS:].strip()}")
    answer: dict[str, float] = json.loads(done.stdout)
    return answer


def _import_figures(one: Map, result: dict[str, float]) -> list[Figure]:
    name = one.name
    return [
        Figure(f"{name}: import", result["first"], "s", 2, one.seconds),
        Figure(
            f"{name}: first import / second, from the cache",
            result["first"] / max(result["again"], 1e-9),
            "",
            0,
            CACHE_AIM,
        ),
        Figure(f"{name}: memory of the import at the most", result["peak"] / MIB, "MiB", 0),
        Figure(f"{name}: triangles seen", result["triangles"], "", 0),
        Figure(f"{name}: pieces felt", result["pieces"], "", 0),
        Figure(f"{name}: compiling the model", result["compiling"], "s", 2),
        Figure(f"{name}: compiled model", result["model"] / MIB, "MiB", 1),
        Figure(f"{name}: one scan, median", 1e6 * result["scan"], "us", 0, one.scan),
        Figure(f"{name}: part of the beams that hit", result["hits"], "", 2),
    ]


def _team_figures(one: Map, world: Path, robots: int, seconds: float, seed: int) -> list[Figure]:
    began = time.perf_counter()
    with Server(str(world), robots) as server, Crowd(server.port, seed) as crowd:
        ready = time.perf_counter() - began
        port = server.ports.get("images")
        if port is None:
            raise BenchError("the server has no images")
        with Viewer(port, TILE, RATE) as viewer:
            trial = try_team(server, crowd, robots, seconds)
        seen = summed_up(viewer.pictures, trial.start, trial.stop)
    name = f"{one.name}, {robots} robots"
    return [
        Figure(f"{one.name}: server ready after", ready, "s", 2),
        Figure(f"{name}: real-time factor, lowest of all", trial.factor, "", 4, FACTOR_AIM),
        Figure(f"{name}: real-time factor, worst second", trial.worst, "", 4),
        Figure(f"{name}: processor use of the server", trial.load.process, "cores", 2),
        Figure(f"{name}: memory of the server", trial.resident / MIB, "MiB", 0),
        Figure(f"{name}: pictures of the tile", seen.pictures, "1/s", 1, PICTURES_AIM),
        *load_figures(trial.load),
    ]
