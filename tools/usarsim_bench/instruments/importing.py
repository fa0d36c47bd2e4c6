"""What it takes to import a map, to load it again, and to look around in it.

One import is measured in a process of its own, beginning with an empty cache:

* **first**: `import_map`, from the file to the world folder;
* **again**: the same call, which finds the world in the cache;
* **compile**: from the world folder to a model of MuJoCo;
* **scan**: the distances of one laser scan, asked of the caster that sensors use, from the map's
  first start pose; the median of many, each turned a little further;
* **peak**: the largest resident memory of this process up to the end of the first import.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

import numpy as np

from usarsim_maps.convert import Request, import_map
from usarsim_maps.reader import ImportOptions
from usarsim_server.errors import UsarsimError
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
    """One map.

    Attributes:
        first: s of wall time for the first import.
        again: s of wall time for the second, from the cache; the best of three.
        compiling: s of wall time from the world folder to a compiled model.
        scan: s of wall time for one scan of `BEAMS` beams, median.
        hits: part of the beams that met something.
        peak: bytes of resident memory at the most.
        model: bytes of the compiled model.
        pieces: solid geoms.
        triangles: that rays meet.
        starts: start poses.
    """

    first: float
    again: float
    compiling: float
    scan: float
    hits: float
    peak: int
    model: int
    pieces: int
    triangles: int
    starts: int


def measure(source: Path, out: Path, assets: Sequence[Path] = ()) -> Importing:
    """Import a map into a folder, with a cache that nobody else uses.

    Args:
        source: the map.
        out: exists; becomes the parent of the world folder.
        assets: folders of what it names.

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


def main(arguments: Sequence[str]) -> int:
    """Measure one map and print a JSON object."""
    parser = argparse.ArgumentParser(prog="python -m usarsim_bench.instruments.importing")
    parser.add_argument("source", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="where the world folder is made")
    parser.add_argument("--assets", type=Path, action="append", default=[], metavar="DIR")
    given = parser.parse_args(arguments)
    try:
        result = measure(given.source, given.out, given.assets)
    except UsarsimError as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(asdict(result)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
