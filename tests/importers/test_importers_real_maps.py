"""Maps of others, where somebody has put them: set USARSIM_MAPS to their folder to run these."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from built_worlds import AXES, World

from usarsim_server.importers.builder import build
from usarsim_server.importers.findings import Findings
from usarsim_server.importers.reader import Context, read_scene

MAPS = os.environ.get("USARSIM_MAPS", "")


def modules() -> list[Path]:
    """T3D rooms of USARSim's world generator."""
    return sorted(Path(MAPS).glob("t3d/**/*.t3d")) if MAPS else []


@pytest.mark.skipif(not modules(), reason="USARSIM_MAPS names no folder with T3D modules in t3d/")
def test_rooms_of_the_world_generator(tmp_path: Path) -> None:
    """Every module is a closed room on the grid of 782 UU (reference 4.2)."""
    for number, path in enumerate(modules()):
        findings = Findings()
        scene = read_scene(path, Context(findings=findings))
        folder = tmp_path / f"m{number}"
        folder.mkdir()
        world = World(build(scene, folder, findings), findings, scene)
        (x, y, _), (start,) = world.built.upper - world.built.lower, world.built.places
        for extent in (x, y):
            cells = (extent + 16 / 250) / (782 / 250)
            assert abs(cells - round(cells)) < 0.15, (path.name, extent)
        assert start.overlap == 0.0
        place = world.description.starts[0].pose.position
        high = (place[0], place[1], place[2] + 1.0)
        assert np.isfinite(world.rays(high, AXES)).all(), path.name
        assert np.isfinite(world.solid_rays(high, AXES)).all(), path.name
        assert not [w for w in findings.warnings() if "not closed" in w.text]
