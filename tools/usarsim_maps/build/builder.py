"""From the intermediate scene to a world folder (worlds reference 11)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usarsim_maps.build.cells import Point
from usarsim_maps.build.clear import SeenThrough, seen_through, with_solids_shown
from usarsim_maps.build.cut_outs import Finish
from usarsim_maps.build.emitter import Emitter
from usarsim_maps.build.extent import (
    LARGEST,
    MARGIN,
    check_size,
    extent_of_planes,
    measure,
    tell,
    with_starts,
    without_sky,
)
from usarsim_maps.build.facts import (
    BALL,
    Probe,
    StartCheck,
    note_floor,
    path_node_entries,
    start_entries,
    victim_entries,
    within_reach,
    without_strays,
)
from usarsim_maps.build.level import add_brushes, add_heightfield, materials_of
from usarsim_maps.build.light import chosen_lights, glows, lamps
from usarsim_maps.build.materials import finish_materials
from usarsim_maps.build.mesh_error import note_error
from usarsim_maps.build.objects import ObjectBuilder, materials_of_objects
from usarsim_maps.build.sheet import Entry, NameBook, smoke_tables, write_sheet
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Array, Scene
from usarsim_server.base.errors import MapImportError, at, plain
from usarsim_server.world_cost import LARGE, LIMITS, WorldLimits, check_cost
from usarsim_server.worlds.description import NamedObject

ROOM_BELOW, ROOM_ABOVE, ROOM_AROUND = 10.0, 100.0, 20.0
"""m around a map that robots may be in: flying ones go high."""


@dataclass(frozen=True, slots=True, eq=False)
class Built:
    """What was made."""

    folder: Path  # of the world
    extents: tuple[Array, Array] | None
    """Corners of everything that has an end, m; None if there are only endless planes."""
    lower: Array  # corners of the playable part, which start poses belong to
    upper: Array
    checks: tuple[StartCheck, ...]  # of the starts
    things: tuple[NamedObject, ...]  # named objects
    finishes: dict[str, Finish]  # materials by the map's names
    clear: SeenThrough  # what is not opaque
    pieces: int  # geoms that are solid, and that are seen
    seen: int
    memory: float  # MiB of the compiled model


def build(
    scene: Scene,
    folder: Path,
    findings: Findings,
    progress: Callable[[str, float], None] = lambda step, part: None,
    origin: Entry | None = None,
    most: WorldLimits = LIMITS,
) -> Built:
    """Write a world folder.

    Args:
        scene: what a reader found.
        folder: exists and is empty; its name becomes the world's.
        findings: takes facts and warnings.
        progress: told what is being done and the part of it that is done.
        origin: goes into `[extra.import]`: source, options, version.
        most: bounds of the world.

    Raises:
        MapImportError: the map is empty, of a size that cannot be true, or beyond its bounds, or it
            cannot be compiled.
    """
    scene = without_sky(scene, findings)
    measured = measure(scene)
    if (
        measured.corners is not None
        and not float(np.ptp(measured.corners, axis=0).max()) <= LARGEST
    ):
        scene = without_strays(scene, LARGEST, findings)
        measured = measure(scene)
    extents = measured.corners
    tell(measured, findings)
    if extents is None:
        bounds = extent_of_planes(scene, findings)
    else:
        check_size(scene, extents, findings)
        bounds = with_starts(scene, measured, extents)
    lower, upper = bounds
    extent = float((upper - lower).max())
    scene = with_solids_shown(within_reach(scene, bounds, findings), findings)
    progress("materials", 0.0)
    names = NameBook("world", "daylight", "usarsim:shelf")
    used = list(
        dict.fromkeys(
            [
                *materials_of(scene.brushes),
                *materials_of_objects(scene.objects),
                *(field.material for field in scene.heightfields),
            ]
        )
    )
    finishes = finish_materials(scene.materials, used, folder / "textures", findings)
    emitter = Emitter(folder, finishes)
    limits: tuple[Point, Point] | None = None
    if measured.rocks:
        low, high = (lower - MARGIN).tolist(), (upper + MARGIN).tolist()
        limits = (low[0], low[1], low[2]), (high[0], high[1], high[2])
    lights = chosen_lights(scene.lights, findings)

    def bound() -> None:
        """Refuse too many pieces before even more of them are made."""
        if emitter.pieces > most.pieces:
            cost, source = emitter.cost(), scene.source.path
            check_cost(cost, most, source, emitter.largest(), MapImportError, whole=False)

    def cut(part: float) -> None:
        progress("brushes", part)
        bound()

    objects = ObjectBuilder(scene, emitter, names, findings)
    for number, thing in enumerate(scene.objects):
        progress("objects", number / len(scene.objects))
        objects.add(thing)
        bound()
    objects.finish()
    for field in scene.heightfields:
        add_heightfield(emitter, field, names, findings)
    if scene.brushes:
        add_brushes(
            emitter,
            scene.brushes,
            scene.filled,
            limits,
            glows(lights),
            names,
            findings,
            cut,
        )
    brushes = [NamedObject(brush.name, brush.name, brush.tag, "Brush") for brush in scene.brushes]
    progress("scene", 0.0)
    cost, largest = emitter.cost(), emitter.largest()
    check_cost(cost, most, scene.source.path, largest, MapImportError)
    findings.fact("to serve", cost.text())
    if cost.pieces >= LARGE:
        findings.warn("pieces", f"{largest}; a sidecar can leave them out or coarsen them")
    emitter.write(folder.name, lamps(lights), max(extent, 1.0), (lower + upper) / 2.0)
    probe = Probe(folder / "scene.xml", scene.source.path)
    progress("scene", 0.7)
    if not probe.has_ground:
        cure = "give the folder of its meshes with --assets, or --placeholders"
        raise MapImportError(at(scene.source.path, "nothing solid in this map", cure))
    note_floor(probe, bounds, findings)
    far = [thing.name for thing in objects.things if thing.original in measured.backdrops]
    note_error(probe.model, findings, (BALL, *far))
    starts, checks = start_entries(scene, probe, bounds, findings)
    sheet = _sheet(scene, probe, bounds, starts, [*objects.things, *brushes], findings, origin)
    (folder / "world.toml").write_text(plain(sheet), encoding="utf-8")
    model = probe.model
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    return Built(
        folder=folder,
        extents=extents,
        lower=lower,
        upper=upper,
        checks=tuple(checks),
        things=(*objects.things, *brushes),
        finishes=finishes,
        clear=seen_through(model),
        pieces=int(solid.sum()) - 1,
        seen=int((model.geom_group < 3).sum()) - 1,
        memory=probe.memory,
    )


def _sheet(
    scene: Scene,
    probe: Probe,
    bounds: tuple[Array, Array],
    starts: list[Entry],
    things: list[NamedObject],
    findings: Findings,
    origin: Entry | None,
) -> str:
    lower, upper = bounds
    floor = lower[2] - ROOM_BELOW
    if scene.kill_z is not None and -200.0 < scene.kill_z - lower[2] < 0.0:
        floor = scene.kill_z
    head: Entry = {
        "title": scene.title or scene.source.path.stem,
        "description": f"Imported from {scene.source.path.name} ({scene.source.format}).",
    }
    return write_sheet(
        head,
        {
            "bounds": {
                "lower": [float(v) for v in (*(lower[:2] - ROOM_AROUND), floor)],
                "upper": [float(v) for v in (*(upper[:2] + ROOM_AROUND), upper[2] + ROOM_ABOVE)],
            },
            "extra": {"import": dict(origin or {})},
        },
        {
            "start": starts,
            "victim": victim_entries(scene, probe, findings),
            "path_node": path_node_entries(scene, findings),
            "smoke": smoke_tables(scene.smoke),
            "object": [_thing(thing) for thing in things],
        },
    )


def _thing(thing: NamedObject) -> Entry:
    return {
        "name": thing.name,
        "original": thing.original if thing.original != thing.name else None,
        "tag": thing.tag or None,
        "kind": thing.kind or None,
        "movable": True if thing.movable else None,
    }
