"""The map of a console: scans stand where the scanner was when it saw them."""

from __future__ import annotations

import numpy as np
from toy_world import Plan, Toy
from virtual_station import VirtualPage, VirtualStation

from usarsim_client.decoder import decode
from usarsim_client.reports import Geometry
from usarsim_operator.occupancy import CELL
from usarsim_operator.roles import Role

ROOM = Plan("#" * 12 + "\n" + ("#" + "." * 10 + "#\n") * 10 + "#" * 12)
"""5 m by 5 m inside; its walls begin at 0.5 m and 5.5 m."""


async def test_walls_are_sharp_while_a_robot_turns() -> None:
    """A scanner 0.3 m ahead of the middle, told 0.1 s before the pose of its instant, at 40
    degrees a second: nine of ten wall cells are within two cells of the true walls."""
    station = VirtualStation()
    page = VirtualPage(station, "Ada", Role.OPERATOR)
    driven = station.spawned("R")
    geo = "GEO {Type RangeScanner} {Name Scanner1} {Location 0.3,0,-0.2} {Orientation 0,0,0}"
    (told,) = decode(f"{geo} {{Mount HARD}}".encode())
    assert isinstance(told, Geometry)
    driven.mounts.know(told.items)
    toy = Toy(ROOM, 3.0, 3.0, left=0.47, right=-0.47, ahead=0.3)
    try:
        for _ in range(240):
            toy.step()
            station.clock += 0.1
            station.hear("R", toy.scan_line())
            station.hear("R", toy.pose_line())
        part = station.map.part()
        assert part is not None
        (x, y), cells = part
        rows, columns = np.nonzero(cells == 2)
        wall_x, wall_y = x + (columns + 0.5) * CELL, y + (rows + 0.5) * CELL
        off = np.maximum(np.abs(wall_x - 3.0), np.abs(wall_y - 3.0)) - 2.5
        assert len(off) > 150
        assert np.quantile(np.abs(off - CELL / 2), 0.9) < 2.0 * CELL
    finally:
        await station.end(page)


async def test_a_robot_that_leans_maps_what_is_near() -> None:
    """Pitched by 0.2 rad, an echo 1.5 m away is 0.3 m off the plane of the floor: what is farther
    says nothing of walls, nor of the floor before them."""
    station = VirtualStation()
    page = VirtualPage(station, "Ada", Role.OPERATOR)
    station.spawned("R")
    toy = Toy(ROOM, 3.0, 1.5)
    try:
        for lean, most in ((0.2, 1.6), (0.0, 4.8)):
            for _ in range(12):
                toy.step()
                station.clock += 0.1
                station.hear(
                    "R", toy.pose_line().replace("{Orientation 0,0,", f"{{Orientation 0,{lean},")
                )
                station.hear("R", toy.scan_line())
            part = station.map.part()
            assert part is not None
            (x, y), cells = part
            rows, columns = np.nonzero(cells)
            far = np.hypot(x + (columns + 0.5) * CELL - 3.0, y + (rows + 0.5) * CELL - 1.5)
            assert 0.9 * most < far.max() < most + CELL
    finally:
        await station.end(page)
