"""What the kit makes of ranges, sizes and units: sensors over the floor, cameras, dialects."""

from __future__ import annotations

import asyncio
import math
from typing import cast

import pytest

from usarsim_conformance.case import Case, Run
from usarsim_conformance.checks import images_frames, ranges, rovers
from usarsim_conformance.excursions import Equipment, Track
from usarsim_conformance.lines import Line
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Failed
from usarsim_conformance.side_images import Tile
from usarsim_conformance.walls import Scene, Surrounded, Wall

_CASE = Case(cast("Run", None), "udk")
_WALL = Wall(0.0, 1.5, -1.5, 1.5, -1.0, 0.1)
_FLOOR = 0.15


def _line(text: str) -> Line:
    return Line(f"{text}\r\n".encode())


def _among_walls(type: str, conf: str, place: str, value: float) -> Surrounded:
    """A robot whose one sensor says the same in every scene, 0.15 m above the floor."""
    worn = Equipment(
        "ERS",
        {type: _line(f"CONF {{Type {type}}} {{Name S}} {conf}")},
        {type: _line(f"GEO {{Type {type}}} {{Name S}} {place} {{Mount ERS}}")},
    )
    said = Track([_line(f"SEN {{Time 1.0}} {{Type {type}}} {{Name S}} {{Range {value:.3f}}}")])
    scenes = [
        Scene(name, wall, (), said) for name, wall in (("open", None), *[("ahead", _WALL)] * 3)
    ]
    return Surrounded(worn, Place(None), -_FLOOR, "Wall", tuple(scenes), _FLOOR)


@pytest.mark.parametrize(
    ("type", "down", "right", "wrong"),
    [
        ("IR", 0.5, (_FLOOR - 0.01) / math.sin(0.5), 0.35),
        ("IR", 0.5, (_FLOOR - 0.01) / math.sin(0.5), 1.5),
        ("Range", 0.5, (_FLOOR - 0.01) / math.sin(0.5), 0.24),
        ("Sonar", math.pi / 2.0, _FLOOR - 0.01, 0.24),
        ("Sonar", math.pi / 2.0, _FLOOR - 0.01, 1.5),
    ],
)
def test_sensors_that_look_at_the_floor(
    monkeypatch: pytest.MonkeyPatch, type: str, down: float, right: float, wrong: float
) -> None:
    """They see it nearer than the wall or MaxRange, and no other range is right."""
    check = {"IR": ranges.ir_range, "Range": ranges.range_range, "Sonar": ranges.sonar_range}[type]
    conf = "{MaxRange 1.500} {MinRange 0.050} {BeamAngle 0.349}"
    place = f"{{Location 0.10,0.00,0.01}} {{Orientation 0.00,{-down:.4f},0.00}}"

    async def judge(value: float) -> None:
        async def walls_for(case: Case, type: str) -> Surrounded:
            return _among_walls(type, conf, place, value)

        monkeypatch.setattr(ranges, "walls_for", walls_for)
        await check(_CASE)

    asyncio.run(judge(right))
    with pytest.raises(Failed, match=f"Range of S is {wrong:.3f} m"):
        asyncio.run(judge(wrong))


@pytest.mark.parametrize(("distance", "seen"), [(0.3, False), (0.35, True)])
def test_the_floor_in_a_wide_cone(distance: float, seen: bool) -> None:
    """It counts where no wall can be within the cone, and is nearest where the cone is upright."""
    wall = Wall(0.0, distance, -1.0, 1.0, -1.0, 0.1)
    way = (math.sin(0.4), 0.0, math.cos(0.4))
    found = ranges._floor_within(0.2, wall, (0.0, 0.0, 0.0), way, 0.5)
    assert found == (pytest.approx((0.2, 0.2 / math.cos(0.4))) if seen else None)


def test_turning_of_aircraft_in_degrees() -> None:
    """The same rate in rad/s and, in udk, in degrees/s; a mass has no such unit."""
    line = _line("CONF {Type AerialVehicle} {MaxRotationalVelocity 100.0000} {Mass 100.0000}")
    assert rovers._in_radians(line, "MaxRotationalVelocity", "udk") == pytest.approx(
        (1.7453,), abs=1e-4
    )
    assert rovers._in_radians(line, "MaxRotationalVelocity", "ut2004") == (100.0,)
    assert rovers._in_radians(line, "Mass", "udk") == (100.0,)


def _tile(x: int, y: int, width: int = 320, height: int = 240) -> Tile:
    return Tile("Camera", x, y, width, height, 80.0, 20.0, 100.0, 80.0)


def test_grid_of_tiles() -> None:
    """A camera's own smaller pictures stand on the grid of the others; sizes do not change from
    robot to robot, nor do offsets lie within a tile."""
    small = (176, 144)
    images_frames.judge_grid(
        _CASE, [[_tile(0, 0), _tile(320, 0, *small)], [_tile(640, 0), _tile(0, 240, *small)]]
    )
    with pytest.raises(Failed, match="several sizes"):
        images_frames.judge_grid(_CASE, [[_tile(0, 0)], [_tile(320, 0, *small)]])
    with pytest.raises(Failed, match="not on the grid"):
        images_frames.judge_grid(_CASE, [[_tile(0, 0), _tile(176, 0, *small)]])
