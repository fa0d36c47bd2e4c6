"""Small UDK maps, written and read, for the tests of that reader."""

from __future__ import annotations

from pathlib import Path

from built_worlds import World, build_world
from unreal_fixture import (
    Map,
    Ref,
    Writer,
)

from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context, ImportOptions, read_scene
from usarsim_maps.scene import Scene

TABLE = Ref("Furniture.Kitchen.Table", "StaticMesh")
"""A mesh of the package `Furniture.upk`, which most tests do not have."""


def scene_of(
    folder: Path, made: Writer, findings: Findings | None = None, **options: object
) -> Scene:
    """Write a package and read it."""
    source = folder / "map.udk"
    source.write_bytes(made.content())
    chosen = ImportOptions(**options)  # type: ignore[arg-type]
    return read_scene(source, Context(chosen, findings or Findings()))


def world_of(folder: Path, made: Writer, **options: object) -> World:
    """Write a package, read and build it."""
    findings = Findings()
    return build_world(folder, scene_of(folder, made, findings, **options), findings)


def room() -> Map:
    """A closed room, 4 m square and 3 m high, cut out of the solid; without a built level."""
    made = Map()
    made.box("Room", (-500, -500, 0), (500, 500, 750), "CSG_Subtract")
    made.start("PlayerStart_0", (0, 0, 60))
    return made
