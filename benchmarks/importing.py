"""Maps of other programs: what their import takes, and how robots get on in them.

The maps are written by the measurement itself (`map_sources.py`). Each of them is imported in a
process of its own, beginning with an empty cache:

* **first**: `import_map`, from the file to the world folder;
* **again**: the same call, which finds the world in the cache;
* **compile**: from the world folder to a model of MuJoCo;
* **scan**: the distances of one laser scan, asked of the caster that sensors use, from the map's
  first start pose; the median of many, each turned a little further;
* **peak**: the largest resident memory of this process up to the end of the first import.

Then a team drives in it, watched from outside.
"""

from __future__ import annotations

import math
import resource
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.apart import run_apart
from benchmarks.cameras import RATE, TILE
from benchmarks.map_sources import BRUSHES, MESHES, write_hall, write_yard
from benchmarks.measures import summed_up
from benchmarks.plan import Plan
from benchmarks.server import Server
from benchmarks.team import MIB, load_figures, try_team
from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.figures import Aim, Figure, Section
from usarsim_bench.watching import watching
from usarsim_maps.convert import Request, import_map
from usarsim_maps.reader import ImportOptions
from usarsim_server.base.errors import UsarsimError
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene

BEAMS = 181
"""Of one scan: half a circle, one beam per degree, as a SICK LMS 200 has."""

RANGE = 20.0
SCANS = 300
_KIBI = 1024


@dataclass(frozen=True, slots=True)
class Importing:
    """One map."""

    first: float  # s of wall time for the first import
    again: float  # s of wall time for the second, from the cache; the best of three
    compiling: float  # s of wall time from the world folder to a compiled model
    scan: float  # s of wall time for one scan of `BEAMS` beams, median
    hits: float  # part of the beams that met something
    peak: int  # bytes of resident memory at the most
    model: int  # bytes of the compiled model
    pieces: int  # solid geoms
    triangles: int  # that rays meet
    starts: int  # start poses


def measure(source: Path, out: Path, assets: Sequence[Path] = ()) -> Importing:
    """Import a map into a folder, with a cache that nobody else uses.

    The world folder is made in `out`; `assets` are folders of what the map names.

    Raises:
        UsarsimError: the map cannot be imported.
    """
    options = ImportOptions(assets=tuple(assets))
    with tempfile.TemporaryDirectory(prefix="usarsim-bench-") as cache:
        request = Request(source=source, options=options, cache=Path(cache))
        began = time.perf_counter()
        done = import_map(request)
        first = time.perf_counter() - began
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _KIBI
        again = min(_again(request) for _ in range(3))
        folder = import_map(Request(source, out, options=options, cache=Path(cache))).folder
    world = load_world(folder)
    began = time.perf_counter()
    model = build_scene(world).compile()
    compiling = time.perf_counter() - began
    scan, hits = scan_time(world)
    seen = model.geom_dataid[(model.geom_group == 2) & (model.geom_type == 7)]
    return Importing(
        first=first,
        again=again,
        compiling=compiling,
        scan=scan,
        hits=hits,
        peak=peak,
        model=int(model.nbuffer),
        pieces=int(done.report.totals["pieces"]),
        triangles=int(model.mesh_facenum[seen].sum()),
        starts=len(world.starts),
    )


def _again(request: Request) -> float:
    began = time.perf_counter()
    found = import_map(request)
    seconds = time.perf_counter() - began
    if not found.cached:
        raise UsarsimError(f"{request.source}: was not found in the cache right after its import")
    return seconds


def scan_time(world: WorldDescription, scans: int = SCANS) -> tuple[float, float]:
    """Median s of wall time of a scan at the first start pose, and the part of beams that hit."""
    options = SimulationOptions(
        physics=PhysicsOptions(), speed=math.inf, lower=world.lower, upper=world.upper
    )
    simulation = Simulation(lambda: build_scene(world), options)
    snapshot = simulation.look()
    origin = np.array(world.starts[0].pose.position)
    times, hits = [], 0
    for number in range(scans + 1):
        angles = np.radians(np.arange(BEAMS) - BEAMS // 2) + 0.02 * number
        ways = np.stack([np.cos(angles), np.sin(angles), np.zeros(BEAMS)], axis=1)
        began = time.perf_counter()
        (found,) = simulation.cast([RayFan(origin, ways, RANGE)], snapshot, None)
        times.append(time.perf_counter() - began)
        hits += int(np.isfinite(found.distances).sum())
    # The first scan builds the caster's tree.
    return median(times[1:]), hits / (BEAMS * (scans + 1))


ROBOTS = 4
SECONDS = 20.0

FACTOR_AIM = Aim(">=", 0.999)
CACHE_AIM = Aim(">=", 5.0)
SCAN_AIM = Aim("<", 100.0)
PICTURES_AIM = Aim(">=", 0.9 * RATE)

_PATIENCE = 300.0
"""s after which an import is given up."""


@dataclass(frozen=True, slots=True)
class Map:
    """One map."""

    name: str  # for people
    source: Path  # its file
    assets: Sequence[Path]  # folders of the meshes that it names
    seconds: Aim  # aim for its import
    scan: Aim | None  # aim for a scan, us; None where it only informs


def measure_import(plan: Plan) -> Section:
    """Import two maps and let a team drive in each; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    figures: list[Figure] = []
    with tempfile.TemporaryDirectory(prefix="usarsim-bench-") as name:
        for one in _maps(Path(name)):
            plan.say(f"import: {one.name.lower()}, then {robots} robots in it for {seconds:g} s")
            out = Path(name, "worlds")
            out.mkdir(exist_ok=True)
            found = run_apart(measure, one.source, out, one.assets, patience=_PATIENCE)
            figures += _import_figures(one, found)
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


def _import_figures(one: Map, found: Importing) -> list[Figure]:
    name, saved = one.name, found.first / max(found.again, 1e-9)
    return [
        Figure(f"{name}: import", found.first, "s", 2, one.seconds),
        Figure(f"{name}: first import / second, from the cache", saved, "", 0, CACHE_AIM),
        Figure(f"{name}: memory of the import at the most", found.peak / MIB, "MiB", 0),
        Figure(f"{name}: triangles seen", found.triangles, "", 0),
        Figure(f"{name}: pieces felt", found.pieces, "", 0),
        Figure(f"{name}: compiling the model", found.compiling, "s", 2),
        Figure(f"{name}: compiled model", found.model / MIB, "MiB", 1),
        Figure(f"{name}: one scan, median", 1e6 * found.scan, "us", 0, one.scan),
        Figure(f"{name}: part of the beams that hit", found.hits, "", 2),
    ]


def _team_figures(one: Map, world: Path, robots: int, seconds: float, seed: int) -> list[Figure]:
    began = time.perf_counter()
    with Server(str(world), robots) as server, Crowd(server.port, seed) as crowd:
        ready = time.perf_counter() - began
        with watching(server.port_of("images"), [TILE], RATE) as [views]:
            trial = try_team(server, crowd, robots, seconds)
        seen = summed_up(views, trial.start, trial.stop)
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
