"""Maps of others, where somebody has put them: set USARSIM_MAPS to their folder to run these."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from built_worlds import AXES, build_world
from mesh_samples import read

from usarsim_maps.findings import Findings
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.view import View, looking

MAPS = os.environ.get("USARSIM_MAPS", "")


def modules() -> list[Path]:
    """T3D rooms of USARSim's world generator."""
    return sorted(Path(MAPS).glob("t3d/**/*.t3d")) if MAPS else []


@pytest.mark.skipif(not modules(), reason="USARSIM_MAPS names no folder with T3D modules in t3d/")
def test_rooms_of_the_world_generator(tmp_path: Path) -> None:
    """Every module is a closed room on the grid of 782 UU (worlds 4.2)."""
    for path in modules():
        findings = Findings()
        world = build_world(tmp_path, read(path, findings), findings)
        (x, y, _), (start,) = world.built.upper - world.built.lower, world.built.checks
        for extent in (x, y):
            cells = (extent + 16 / 250) / (782 / 250)
            assert abs(cells - round(cells)) < 0.15, (path.name, extent)
        assert start.overlap == 0.0
        place = world.description.starts[0].pose.position
        high = (place[0], place[1], place[2] + 1.0)
        assert np.isfinite(world.rays(high, AXES)).all(), path.name
        assert np.isfinite(world.solid_rays(high, AXES)).all(), path.name
        assert not [w for w in findings.warnings() if "not closed" in w.text]


@pytest.mark.skipif(not modules(), reason="USARSIM_MAPS names no folder with T3D modules in t3d/")
@pytest.mark.parametrize("path", modules(), ids=lambda path: path.stem)
def test_cameras_in_rooms_of_the_world_generator(tmp_path: Path, path: Path) -> None:
    """Who looks around sees walls, floor and ceiling, not the sky; lit, and of several colours."""
    world = build_world(tmp_path, read(path))
    assert len({tuple(rgba) for rgba in world.model.mat_rgba}) >= 3
    x, y, z = world.description.starts[0].pose.position
    options = PainterOptions(renderer="rays")
    painter = Painter(world.simulation.compiled, options)
    for bearing in np.arange(4) * math.pi / 2.0 + 0.3:
        ahead = (x + math.cos(bearing), y + math.sin(bearing), z + 0.4)
        view = View(looking((x, y, z + 0.5), ahead), 1.5, width=80, height=60)
        snapshot = world.simulation.look()
        geoms = painter.picture(replace(view, mode="segmentation"), snapshot)
        assert np.asarray(geoms, dtype=int).min() >= 0
        picture = np.asarray(painter.picture(view, snapshot), dtype=float)
        assert 30.0 < picture.mean() < 190.0
        assert (picture.max(axis=-1) > 254).mean() < 0.05
    painter.close()


SOCCER = Path(MAPS) / "RoboSoccer.udk" if MAPS else Path("/nowhere")


@pytest.mark.skipif(not SOCCER.is_file(), reason="USARSIM_MAPS names no folder with RoboSoccer.udk")
def test_the_soccer_hall_is_lit(tmp_path: Path) -> None:
    """Its lamps reach the floor: the middle is brighter than without them, and not white."""
    world = build_world(tmp_path, read(SOCCER))
    assert world.model.nlight == 7
    place = (1.5, 0.5, -2.048)
    light = 0.0
    for number in range(world.model.nlight):
        away = math.dist(place, world.model.light_pos[number])
        constant, linear, square = world.model.light_attenuation[number].tolist()
        fading = constant + linear * away + square * away**2
        light += float(world.model.light_diffuse[number].max()) / fading
    assert 0.3 < light < 1.2
