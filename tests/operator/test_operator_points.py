"""Points of range cameras and scanners of rows, from a real server to a page.

A KitBench stands before a wall with every such sensor on its front, and a KinectBot, whose camera
tilts: all that they tell has to lie on that wall or on the floor.
"""

from __future__ import annotations

import math
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from console_harness import Gateway, PageProgram, gateway
from numpy.typing import NDArray

from usarsim_client import frames
from usarsim_operator.robot_link import Driven
from usarsim_server.testing import running_server

STAGE = Path(__file__).parents[2] / "tools" / "usarsim_conformance" / "stage"
WALL = '<geom name="wall" class="obstacle" type="box" pos="2.5 0 1" size="0.5 9 3"/>'
WALL_X = 2.0  # m, its face


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Of a server with one wall and robots with sensors of every type."""
    world = tmp_path_factory.mktemp("stage") / "world"
    shutil.copytree(STAGE / "world", world)
    scene = world / "scene.xml"
    scene.write_text(scene.read_text().replace("<!-- floor -->", WALL))
    robots = (STAGE / "robots",)
    with running_server(world=str(world), robots=robots) as (_, endpoints):
        yield endpoints["control"].port


def _cloud(page: PageProgram, robot: str) -> NDArray[np.float64]:
    """The newest points of a robot, (n, 3) m in the world, as a page places them."""
    row = page.row(robot)
    assert row is not None
    data = next(one for one in reversed(page.binary) if one[0] == 3 and one[1] == row["index"])
    (count,) = struct.unpack_from("<I", data, 16)
    assert len(data) == 20 + 12 * count
    points = np.frombuffer(data, "<f4", 3 * count, 20).reshape(count, 3).astype(float)
    pose = row["pose"]
    return frames.to_world(points, tuple(pose[:3]), tuple(pose[3:]))


async def _watch(console: Gateway, page: PageProgram, robot: str, **more: object) -> None:
    answer = await page.ask("spawn", name=robot, **more)
    assert answer["ok"], answer
    await page.until(lambda: (page.row(robot) or {}).get("pose") is not None)
    await page.until(lambda: console.station.robots[robot].learned)
    await page.ask("select", robot=robot)


def _off(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """m between points and the nearer of wall and floor."""
    return np.minimum(np.abs(points[:, 0] - WALL_X), np.abs(points[:, 2]))


async def test_points_lie_on_what_is_there(port: int) -> None:
    """CON-09: points of every kind, in the world, within 3 cm of the wall that they saw."""
    names = ("Scan3D", "Kinect", "Spin", "Array", "Line")
    async with gateway(port) as console, console.page() as page:
        place = [0.0, 0.0, -0.3]
        await _watch(console, page, "Bench", **{"class": "KitBench"}, place=place)
        clouds = console.station.robots["Bench"].clouds
        await page.until(lambda: all(clouds.count(name) >= 9 for name in names))
        seen = len(page.binary)
        await page.until(lambda: any(one[0] == 3 for one in page.binary[seen:]))
        points = _cloud(page, "Bench")
        assert len(points) > 100
        assert _off(points).max() < 0.03
        assert np.abs(points[:, 1]).max() > 0.5  # they spread over the wall


async def test_camera_that_tilts_is_followed(port: int) -> None:
    """CON-09: points of a depth camera on a joint stay on the wall while it nods."""
    async with gateway(port) as console, console.page() as page:
        place = [-1.0, 5.0, -0.1]
        await _watch(console, page, "Nod", **{"class": "KinectBot"}, place=place)
        driven = console.station.robots["Nod"]
        assert (await page.ask("take", robot="Nod"))["ok"]
        for angle in (0.0, 0.2):
            assert (await page.ask("camera_pose", robot="Nod", tilt=angle))["ok"]
            await page.until(lambda angle=angle: _still(page, driven, angle))
            seen = len(page.binary)
            await page.until(lambda seen=seen: any(one[0] == 3 for one in page.binary[seen:]))
            # Of points taken while it moved some are on their way still.
            await page.until(lambda: np.quantile(_off(_cloud(page, "Nod")), 0.99) < 0.03)
            assert len(_cloud(page, "Nod")) > 1000


def _still(page: PageProgram, driven: Driven, angle: float) -> bool:
    """Whether the camera looks up by an angle, rad."""
    return abs(math.asin(driven.mounts.of("KinectDepth")[2, 0]) + angle) < 0.004
