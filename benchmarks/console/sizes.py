"""What the console adds to an installation, and what its pages load (CON-02, CON-04)."""

from __future__ import annotations

import asyncio
import gzip
import tempfile
from importlib import metadata
from pathlib import Path

import aiohttp

from benchmarks.console.arithmetic import added_packages
from benchmarks.console.gateway import Rig
from benchmarks.console.programs import page
from benchmarks.map_sources import write_yard
from benchmarks.plan import Plan
from usarsim_bench.figures import Aim, BenchError, Figure

_LOADED = (".html", ".js", ".css", ".svg")
TRIANGLES = 100_000
PACKAGES_AIM, MEGABYTES_AIM = Aim("<=", 12), Aim("<=", 20)
PAGE_AIM, SCENE_AIM, MAP_AIM = Aim("<=", 300), Aim("<=", 50), Aim("<=", 5000)


def extra(plan: Plan) -> list[Figure]:
    """Distributions and bytes that `usarsim-server[console]` adds, as they are installed here."""
    try:
        added = added_packages("console")
    except metadata.PackageNotFoundError as error:
        raise BenchError(f"not installed here: {error.name}") from None
    plan.say(", ".join(added))
    return [
        Figure("new distributions", len(added), "", 0, PACKAGES_AIM),
        Figure("size of them, installed", sum(added.values()) / 1e6, "MB", 1, MEGABYTES_AIM),
    ]


async def page_and_scene(rig: Rig, _: Plan) -> list[Figure]:
    """The files of the page, and the scene of the world with its robots, as they are loaded."""
    from usarsim_report.serving import PAGE

    files = [path for path in sorted(PAGE.glob("*")) if path.suffix in _LOADED]
    if not files:
        raise BenchError("the page was not built (make page)")
    packed = sum(len(gzip.compress(path.read_bytes(), 9)) for path in files)
    async with aiohttp.ClientSession(auto_decompress=False) as http:
        served = 0
        for path in files:
            async with http.get(f"{rig.url}/{path.name}") as answer:
                served += len(await answer.read())
    return [
        Figure("page, compressed", packed / 1e3, "kB", 0, PAGE_AIM),
        Figure("page, as the gateway sends it", served / 1e3, "kB", 0),
        Figure(
            f"scene with {len(rig.robots)} robots, compressed",
            await _scene(rig) / 1e3,
            "kB",
            1,
            SCENE_AIM,
        ),
    ]


async def _scene(rig: Rig) -> int:
    """Bytes of the scene as an instructor's page loads it."""
    async with page(rig, "instructor", pictures=False, scans=False) as looking:
        await looking.until(lambda _: looking.generation is not None, "poses of the scene")
        url = f"{rig.url}/scene/{looking.generation}"
    headers = {"Authorization": f"Bearer {rig.tokens['instructor']}"}
    async with (
        aiohttp.ClientSession(auto_decompress=False) as http,
        http.get(url, headers=headers) as answer,
    ):
        if answer.status != 200:
            raise BenchError(f"the gateway has no scene: {answer.status}")
        return len(await answer.read())


def imported_map(plan: Plan) -> list[Figure]:
    """The scene of an imported map of many triangles, beside a gateway of its own."""
    from usarsim_maps.convert import Request, import_map

    if plan.brief or plan.seconds is not None:
        return []
    plan.say(f"imports a map of {TRIANGLES:,} triangles")
    with tempfile.TemporaryDirectory(prefix="usarsim-bench-") as folder:
        source = write_yard(Path(folder), TRIANGLES)
        world = import_map(Request(source, Path(folder, "world"), cache=Path(folder, "cache")))
        with Rig(str(world.folder), 1) as rig:
            size = asyncio.run(_scene(rig))
    return [Figure(f"map of {TRIANGLES:,} triangles", size / 1e3, "kB", 0, MAP_AIM)]
