"""UDK maps from end to end, and a real one where somebody has put it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from built_worlds import AXES, build_world
from udk_maps import room

from usarsim_maps.build.csg import evaluate
from usarsim_maps.findings import Findings
from usarsim_maps.reader import Context, read_scene
from usarsim_maps.unreal.brushes import read_built_level
from usarsim_maps.unreal.library import load_package
from usarsim_maps.unreal.udk import level_of
from usarsim_server.testing import Rehearsal

MAPS = os.environ.get("USARSIM_MAPS", "")
SOCCER = Path(MAPS) / "RoboSoccer.udk"

# ---- end to end ----------------------------------------------------------------------------


def test_a_package_can_be_served(tmp_path: Path) -> None:
    """The world of a server may be a UDK map; a robot stands in it (items 19, 27)."""
    source = tmp_path / "hall.udk"
    source.write_bytes(room().content())
    with Rehearsal(world=str(source)) as rehearsal:
        client = rehearsal.connect()
        client.send("GETSTARTPOSES")
        (line,) = client.take("NFO {StartPoses 1}")
        assert "PlayerStart_0 0.0000,0.0000,-0.2400" in line
        client.send("INIT {ClassName USARBot.P3AT} {Name R} {Start PlayerStart_0}")
        rehearsal.run(1.0)
        client.send("DRIVE {Left 3.0} {Right 3.0}")
        rehearsal.run(12.0)
        snapshot = rehearsal.assembly.simulation.look()
        layout = max(snapshot.layouts.items())[1]
        x, _, z = snapshot.xpos[layout.base]
        assert 1.2 < x < 2.0
        assert 0.0 < z < 0.4


# ---- the real map --------------------------------------------------------------------------

with_soccer = pytest.mark.skipif(
    not (MAPS and SOCCER.is_file()), reason="USARSIM_MAPS names no folder with RoboSoccer.udk"
)


@with_soccer
def test_soccer_map(tmp_path: Path) -> None:
    """The league's soccer map: actors, one untagged start 0.58 m above the floor (reference 3)."""
    findings = Findings()
    world = build_world(tmp_path, read_scene(SOCCER, Context(findings=findings)), findings)
    assert findings.classes["StaticMeshActor"] == 19
    assert [brush.name for brush in world.scene.brushes] == ["Brush_4", "Brush0", "Brush9"]
    assert [start.tag for start in world.scene.starts] == ["PlayerStart_0"]
    (place,) = world.built.places
    assert place.height == pytest.approx(0.576, abs=1e-3)
    assert place.overlap == 0.0
    assert len(world.scene.lights) == 8
    assert sum(n for kind, _, n in findings.missing_list() if kind == "mesh") == 20
    x, y, z = world.scene.starts[0].pose.position
    # A room of 10.24 x 6.144 m.
    front, back, left, right = world.rays((x, y, z), AXES)[:4]
    assert front + back == pytest.approx(10.24, abs=1e-3)
    assert left + right == pytest.approx(6.144, abs=1e-3)


@with_soccer
def test_soccer_map_is_as_the_editor_built_it() -> None:
    """Cells of the brushes and the stored tree agree at all of 20 000 points (reference 1.2)."""
    package = load_package(SOCCER)
    level = level_of(package)
    assert level is not None
    built = read_built_level(package, level)
    assert built is not None
    scene = read_scene(SOCCER)
    cells = evaluate(scene.brushes, scene.filled).cells
    points = np.random.default_rng(1).uniform((-5, -4, -4), (8, 5, 4), (20_000, 3))
    solid = np.zeros(len(points), dtype=bool)
    for cell in cells:
        normals = np.array([face.plane[:3] for face in cell.faces])
        offsets = np.array([face.plane.offset for face in cell.faces])
        solid |= (points @ normals.T <= offsets).all(axis=1)
    told = built.solid(points * [1, -1, 1] * 250.0)
    assert 2_000 < solid.sum() < 18_000
    assert (told == solid).all()
