"""Cameras of a robot file; as in `parts.py` the wire frame goes in, the simulation frame out."""

from __future__ import annotations

from collections.abc import Sequence

from usarsim_server.robots.description import CameraDescription, RobotDescription
from usarsim_server.robots.reading.parts import WORD, read_link, read_pose
from usarsim_server.robots.tables import TableReader

__all__ = ["read_cameras"]

NARROWEST = 0.01  # rad
WIDEST = 3.0  # rad; a flat picture of half a turn would have no end
RATES = (0.1, 60.0)  # Hz, as the server's own
SIZES = (16, 8192)  # pixels a side, as a tile's

_HINTS = {"interval": "write rate = pictures per second", "type": "leave it out"}


def read_cameras(
    reader: TableReader, links: Sequence[str], parent: RobotDescription | None
) -> tuple[CameraDescription, ...]:
    """Cameras in mount order; one that bears the name of an inherited one replaces it.

    Args:
        reader: the file.
        links: names of wheels and other links that may carry cameras.
        parent: the robot that is extended.
    """
    dropped = {name.lower() for name in reader.texts("without")}
    inherited = parent.cameras if parent else ()
    cameras = [camera for camera in inherited if camera.name.lower() not in dropped]
    for camera in cameras:
        if camera.link is not None and camera.link not in links:
            reader.fail(
                f"the inherited camera {camera.name!r} sits on {camera.link!r}, which is gone",
                "keep that name, or drop the camera with without = [...]",
                "camera",
            )
    own: set[str] = set()
    for table in reader.tables("camera"):
        camera = _camera(table, links)
        key = camera.name.lower()
        if key in own:
            table.fail(f"a second camera is called {camera.name!r}", "rename one of them", "name")
        own.add(key)
        for index, other in enumerate(cameras):
            if other.name.lower() == key:
                cameras[index] = camera
                break
        else:
            cameras.append(camera)
    return tuple(cameras)


def _camera(table: TableReader, links: Sequence[str]) -> CameraDescription:
    usual = CameraDescription(name="")
    if table.has("type"):
        table.choice("type", ("Camera",))
    name = table.text("name")
    if not WORD.fullmatch(name):
        table.fail(f"is {name!r}", "use one word without blanks and braces", "name")
    low = table.number("min_fov", usual.min_fov, low=NARROWEST, high=WIDEST)
    high = table.number("max_fov", max(low, usual.max_fov), low=low, high=WIDEST)
    camera = CameraDescription(
        name=name,
        link=read_link(table, links),
        pose=read_pose(table),
        fov=table.number("fov", min(max(usual.fov, low), high), low=low, high=high),
        min_fov=low,
        max_fov=high,
        rate=table.number("rate", low=RATES[0], high=RATES[1]) if table.has("rate") else None,
        where=table.place,
        size=_size(table),
    )
    table.finish(_HINTS)
    return camera


def _size(table: TableReader) -> tuple[int, int] | None:
    if not table.has("size"):
        return None
    width, height = table.numbers("size", (2,), low=SIZES[0], high=SIZES[1])
    if width != int(width) or height != int(height):
        table.fail(f"is {width:g} x {height:g}", "write whole numbers of pixels", "size")
    return int(width), int(height)
