"""From the intermediate scene to a world folder (worlds reference 11)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usarsim_maps.build.cells import Point
from usarsim_maps.build.emitter import Emitter
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
from usarsim_maps.build.level import MARGIN, add_brushes, add_heightfield, materials_of
from usarsim_maps.build.light import chosen_lights, glows, lamps
from usarsim_maps.build.materials import Finish, finish_materials
from usarsim_maps.build.mesh_error import note_error
from usarsim_maps.build.objects import (
    ObjectBuilder,
    bounds_of_object,
    is_giant,
    materials_of_objects,
)
from usarsim_maps.build.sheet import Entry, NameBook, smoke_tables, write_sheet
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Array, Heightfield, Plane, Scene
from usarsim_maps.units import matrix_of_pose
from usarsim_server.errors import MapImportError, at
from usarsim_server.worlds.description import NamedObject

SMALLEST, LARGEST = 1.0, 2000.0
"""m: extents of a map that can be true (worlds reference 11)."""

TINIEST = 1e-3
"""m: extent of a single thing that can be true."""

GEOMETRY = ("file", "mesh", "model", "sublevel")
"""Kinds of missing things without which there may be no map."""

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
    pieces: int  # geoms that are solid, and that are seen
    seen: int
    memory: float  # MiB of the compiled model


def build(
    scene: Scene,
    folder: Path,
    findings: Findings,
    progress: Callable[[str, float], None] = lambda step, part: None,
    origin: Entry | None = None,
) -> Built:
    """Write a world folder.

    Args:
        scene: what a reader found.
        folder: exists and is empty; its name becomes the world's.
        findings: takes facts and warnings.
        progress: told what is being done and the part of it that is done.
        origin: goes into `[extra.import]`: source, options, version.

    Raises:
        MapImportError: the map is empty, or of a size that cannot be true, or cannot be compiled.
    """
    extents, giants = _extents(scene)
    if extents is not None and not float((extents[1] - extents[0]).max()) <= LARGEST:
        scene = without_strays(scene, LARGEST, findings)
        extents, giants = _extents(scene)
    if extents is None:
        bounds = _of_planes(scene, findings)
    else:
        _check_size(scene, *extents, findings)
        bounds = _with_starts(scene, *extents)
    lower, upper = bounds
    extent = float((upper - lower).max())
    scene = within_reach(scene, bounds, findings)
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
    if giants:
        low, high = (lower - MARGIN).tolist(), (upper + MARGIN).tolist()
        limits = (low[0], low[1], low[2]), (high[0], high[1], high[2])
        findings.warn("level", f"{giants} backdrop(s) around the map were cut off at {MARGIN:g} m")
    lights = chosen_lights(scene.lights, findings)
    objects = ObjectBuilder(scene, emitter, names, findings)
    for number, thing in enumerate(scene.objects):
        progress("objects", number / len(scene.objects))
        objects.add(thing)
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
            lambda part: progress("brushes", part),
        )
    brushes = [NamedObject(brush.name, brush.name, brush.tag, "Brush") for brush in scene.brushes]
    progress("scene", 0.0)
    emitter.write(folder.name, lamps(lights), max(extent, 1.0), (lower + upper) / 2.0)
    probe = Probe(folder / "scene.xml", scene.source.path)
    progress("scene", 0.7)
    if not probe.has_ground:
        cure = "give the folder of its meshes with --assets, or --placeholders"
        raise MapImportError(at(scene.source.path, "nothing solid in this map", cure))
    note_floor(probe, bounds, findings)
    note_error(probe.model, findings, (BALL,))
    starts, checks = start_entries(scene, probe, bounds, findings)
    sheet = _sheet(scene, probe, bounds, starts, [*objects.things, *brushes], findings, origin)
    (folder / "world.toml").write_text(sheet, encoding="utf-8")
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


def _extents(scene: Scene) -> tuple[tuple[Array, Array] | None, int]:
    """Corners of all that has an end, None if nothing has; and how many brushes are backdrops."""
    brushes: list[tuple[Array, Array]] = []
    for brush in scene.brushes:
        points = [polygon.vertices for polygon in brush.polygons]
        if points:
            every = np.concatenate(points)
            brushes.append((every.min(axis=0), every.max(axis=0)))
    others = [b for b in map(bounds_of_object, scene.objects) if b is not None]
    others += [_field_bounds(field) for field in scene.heightfields]
    boxes = [box for box in (*brushes, *others) if np.isfinite(box[0]).all()]
    small = [box for box in boxes if not is_giant(*box)]
    if small:
        boxes = small
    giants = sum(is_giant(*box) for box in brushes) if small else 0
    if not boxes:
        return None, giants
    return (np.min([low for low, _ in boxes], 0), np.max([high for _, high in boxes], 0)), giants


def _with_starts(scene: Scene, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Corners moved apart so that start poses near the map are inside."""
    points = [np.array(start.pose.position) for start in scene.starts]
    near = [p for p in points if ((p > lower - 40.0) & (p < upper + 40.0)).all()]
    return np.min([lower, *near], axis=0), np.max([upper, *near], axis=0)


def _of_planes(scene: Scene, findings: Findings) -> tuple[Array, Array]:
    """The playable part of a map of endless planes: what is drawn of them, and the start poses.

    Raises:
        MapImportError: there are no planes, or they are only what is left of a map whose meshes
            and models are all missing.
    """
    source = scene.source.path
    lost = [name for kind, name, _ in findings.missing_list() if kind in GEOMETRY]
    files = [Path(name).name for name in lost]
    notes = (f"; {note.subject}: {note.text}" for note in findings.warnings())
    if lost:
        names = ", ".join(name[:80] for name in lost[:3])
        more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
        why = next((note for note in notes if any(file in note for file in files)), "")
        problem = f"none of the meshes and models that it names can be had: {names}{more}{why}"
        cure = "import it with --assets DIR for the folder in which they lie, or --placeholders"
        raise MapImportError(at(source, problem, cure))
    corners = [np.array(start.pose.position) for start in scene.starts]
    for thing in scene.objects:
        for part in thing.parts:
            if isinstance(part.shape, Plane):
                matrix = matrix_of_pose(thing.pose) @ part.matrix
                across = np.abs(matrix[:3, :2]) @ (np.minimum(part.shape.size, LARGEST) / 2.0)
                corners += [matrix[:3, 3] - across, matrix[:3, 3] + across]
    if len(corners) == len(scene.starts):
        cure = "check that the export contains geometry; meshes are found with --assets"
        problem = f"there is no geometry in this map{next(notes, '')}"
        raise MapImportError(at(source, problem, cure))
    return np.min(corners, axis=0), np.max(corners, axis=0)


def _field_bounds(field: Heightfield) -> tuple[Array, Array]:
    rows, columns = np.shape(field.heights)[:2]
    x, y = (columns - 1) * field.spacing[0], (rows - 1) * field.spacing[1]
    low, high = float(np.min(field.heights)), float(np.max(field.heights))
    corners = np.array([[a, b, c] for a in (0.0, x) for b in (0.0, y) for c in (low, high)])
    world = corners @ field.pose.matrix().T + np.array(field.pose.position)
    return world.min(axis=0), world.max(axis=0)


def _check_size(scene: Scene, lower: Array, upper: Array, findings: Findings) -> None:
    """Refuse what cannot be true; a single thing may be small, a map may not."""
    extent = float((upper - lower).max())
    source = scene.source
    guess = source.units_per_metre * extent / 30.0 if extent > 0.0 else 1.0
    cure = f"give the true scale, for example --scale {_plain(guess)} for a map of 30 m"
    size = " x ".join(_plain(value) for value in (upper - lower).tolist())
    a_map = source.whole_map or bool(scene.starts or scene.brushes)
    if TINIEST <= extent < SMALLEST and not a_map:
        findings.warn(source.path.name, f"{size} m are little; if this is a map {cure}")
        return
    if SMALLEST <= extent <= LARGEST and math.isfinite(extent):
        return
    problem = (
        f"the map would be {size} m large; absurd at {source.units_per_metre:g} units per metre"
    )
    raise MapImportError(at(source.path, problem, cure))


def _plain(value: float) -> str:
    """Three digits and, unless it is absurd, no exponent, as people write `--scale`."""
    if value and not 1e-9 < abs(value) < 1e9:
        return f"{value:.3g}"
    return np.format_float_positional(float(f"{value:.3g}"), trim="-")
