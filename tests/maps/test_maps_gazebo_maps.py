"""Gazebo maps of others, where somebody has put them: set USARSIM_MAPS to run these.

The figures are those of the maps of 2016 of the rescue league's virtual robot competition
(m-shimizu/RoboCup2016RVRL_FieldModels).
"""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from built_worlds import build_world
from mesh_samples import read, whole

from usarsim_maps.convert import Request, import_map
from usarsim_maps.findings import Findings
from usarsim_server.simulation.frames import rpy_from_quaternion
from usarsim_server.testing import Rehearsal

MAPS = Path(os.environ.get("USARSIM_MAPS", "/nowhere")) / "gazebo"

pytestmark = pytest.mark.skipif(
    not MAPS.is_dir(), reason="USARSIM_MAPS names no folder with Gazebo maps in gazebo/"
)

MESHES = {
    "RC2016VRL_event1/event1.dae": (1169, (40.0, 60.0, 6.42)),
    "RC2016VRL_port1/port1.dae": (8305, (134.0, 228.29, 8.01)),
    "victim/girl-brunette-dae/girl-brunette.dae": (6457, (0.433, 0.31, 1.508)),
}


@pytest.mark.parametrize("name", MESHES)
def test_meshes(name: str, findings: Findings) -> None:
    """Triangles and extents of the three COLLADA files; every picture is found (worlds 43, 46)."""
    count, extents = MESHES[name]
    scene = read(MAPS / name, findings)
    mesh = whole(scene)
    assert len(mesh.triangles) == count
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(extents, abs=0.01)
    pictures = [m.texture for m in scene.materials.values() if m.texture is not None]
    assert len(pictures) >= 3
    assert all(picture.is_file() for picture in pictures)
    assert not findings.missing_list()


@pytest.mark.parametrize(
    ("name", "extents", "start"),
    [
        ("RC2016VRL_Final_RUN2_RETRY", (52.80, 79.20, 4.24), "StartPoint1"),
        ("RC2016VRL_PreLiminary1", (134.0, 228.29, 8.01), "StartPoint2"),
    ],
)
def test_worlds(tmp_path: Path, name: str, extents: tuple[float, float, float], start: str) -> None:
    """Worlds come with starts and victims of the league's text file, and a P3AT drives there."""
    imported = import_map(Request(MAPS / f"{name}.world", out=tmp_path))
    report = imported.report
    assert report.extents == pytest.approx(extents, abs=0.01)
    assert not report.missing
    assert report.totals["starts"] == 5
    assert report.totals["victims"] == 4
    for _, height, overlap in report.starts:
        assert height == pytest.approx(0.3, abs=0.02)
        assert overlap == 0.0
    with Rehearsal(world=str(imported.folder)) as rehearsal:
        client = rehearsal.connect()
        client.send(f"INIT {{ClassName USARBot.P3AT}} {{Name R}} {{Start {start}}}")
        rehearsal.run(1.5)

        def place() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
            snapshot = rehearsal.assembly.simulation.look()
            return np.array(snapshot.xpos[max(snapshot.layouts.items())[1].base])

        stands = place()
        rehearsal.run(1.0)
        assert np.abs(place() - stands).max() < 1e-3
        client.send("DRIVE {Left 2.0} {Right 2.0}")
        rehearsal.run(3.0)
        way = place() - stands
        assert np.hypot(way[0], way[1]) > 0.3
        assert abs(way[2]) < 0.02


def test_a_model_alone(tmp_path: Path) -> None:
    """A model without a world is a map, too; its floor and walls stop rays at the same places."""
    world = build_world(tmp_path, read(MAPS / "RC2016VRL_event1" / "model.sdf"))
    start = world.description.starts[0].pose.position
    down = np.array([[0.0, 0.0, -1.0]])
    seen, felt = world.rays(start, down), world.solid_rays(start, down)
    assert seen == pytest.approx(felt, abs=1e-4)
    assert seen[0] < 1.0


def test_victims_stand_where_the_figures_do() -> None:
    """The figure with roll 1.57 stands, for Gazebo ignores its up axis; it faces its z axis."""
    scene = read(MAPS / "RC2016VRL_Final_RUN2_RETRY.world")
    assert [victim.name for victim in scene.victims] == ["V1", "V2", "V3", "V4"]
    assert {victim.properties["figure"] for victim in scene.victims} == {"female"}
    assert {victim.posture for victim in scene.victims} == {"standing"}
    yaws = [rpy_from_quaternion(victim.pose.quaternion)[2] for victim in scene.victims]
    assert yaws == pytest.approx([0.0, -math.pi / 2, -math.pi / 2, math.pi / 2], abs=0.01)
