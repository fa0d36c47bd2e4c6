"""Cameras of robots in the full frame (side channels reference 2.10, 2.11)."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from usarsim_conformance.case import Case
from usarsim_conformance.recordings import wheels_of
from usarsim_conformance.side_checks import checks_of
from usarsim_conformance.side_images import (
    CameraRobot,
    ImageClient,
    Tile,
    ask_conf,
    camera_robot,
    facts_of,
    tiles_of,
)
from usarsim_conformance.verdicts import Inconclusive, NotApplicable, Severity

images = checks_of("images")

Floats = NDArray[np.float64]

_FLOAT = r"\d+\.\d{4}"
_FORM = re.compile(
    r"CONF \{Type Camera\}( \{Name [^{} ]+\}\{TextureOffsetX \d+\}\{TextureOffsetY \d+\}"
    r"\{TextureResolutionX \d+\}\{TextureResolutionY \d+\}"
    rf"\{{CameraDefFov {_FLOAT}\}}\{{CameraMinFov {_FLOAT}\}}\{{CameraMaxFov {_FLOAT}\}}"
    rf"\{{CameraFov {_FLOAT}\}})+"
)
_TWO_CAMERAS = ("Nao", "Kenaf", "ARDrone", "Talon", "TeleMax")
"""Classes that had, or may have, two cameras."""


@images("conf.unsolicited", "CONF comes when a tile is assigned", "11.38, 2.10")
async def unsolicited(case: Case) -> None:
    """Soon after INIT the server sends the CONF of the camera by itself, so that a question that
    came too early is repaired."""
    watcher = await camera_robot(case)
    client = watcher.robot.client
    confs = [line for line in client.lines if line.text.startswith("CONF {Type Camera}")]
    # One of them answers the question of `camera_robot`.
    if len(confs) < 2:
        await client.wait("CONF {Type Camera}", what="CONF {Type Camera} but the answer to GETCONF")


@images("conf.form", "The form of CONF", "11.39, 2.10")
async def form(case: Case) -> None:
    """`GETCONF {Type Camera}` lists all cameras in one line: a blank before each Name, none between
    the following segments, whole pixels, fields of view with four decimals."""
    watcher = await camera_robot(case)
    case.expect(_FORM.fullmatch(watcher.conf), f"another form: {watcher.conf}")


@images("conf.by-name", "CONF of one camera", "2.10")
async def by_name(case: Case) -> None:
    """`GETCONF {Type Camera} {Name n}` tells the same tile as the question without a name."""
    watcher = await camera_robot(case)
    name = watcher.tile.name
    found = tiles_of(await ask_conf(watcher.robot, f" {{Name {name}}}"))
    case.expect([tile.name for tile in found] == [name], f"asked for {name}, told {found}")
    case.expect(found[0] == watcher.tile, f"{found[0]} is not {watcher.tile}")


@images("conf.inside", "Tiles lie in the frame", "2.10")
async def inside(case: Case) -> None:
    """A tile that CONF names lies in the full frame, and its rectangle gives a picture."""
    watcher = await camera_robot(case)
    facts = await facts_of(case)
    for tile in watcher.tiles:
        case.expect(tile.width and tile.height, f"no area: {tile}")
        case.expect(
            tile.x + tile.width <= facts.width and tile.y + tile.height <= facts.height,
            f"{tile} is not in the frame of {facts.width} x {facts.height}",
        )
    client = await ImageClient.open(case)
    size = (await client.ask(watcher.tile.request)).size
    case.expect(size == (watcher.tile.width, watcher.tile.height), f"its picture is {size}")


@images("conf.degrees", "Fields of view are degrees", "11.41, 2.10")
async def degrees(case: Case) -> None:
    """CONF tells fields of view in degrees: above 5, at most 180, the least below the most, the
    default between."""
    tile = (await camera_robot(case)).tile
    case.expect(5.0 < tile.least_fov <= tile.default_fov <= tile.most_fov <= 180.0, f"{tile}")
    case.expect(tile.least_fov <= tile.fov <= tile.most_fov, f"the present one of {tile}")


@images("tiles.grid", "Tiles form a grid", "11.37, 11.40, 2.10")
async def grid(case: Case) -> None:
    """All tiles have the configured size, and their offsets are multiples of it."""
    watchers = [await camera_robot(case) for _ in range(2)]
    tiles = [tile for watcher in watchers for tile in watcher.tiles]
    sizes = {(tile.width, tile.height) for tile in tiles}
    case.expect(len(sizes) == 1, f"tiles of several sizes: {sizes}")
    off = [tile for tile in tiles if tile.x % tile.width or tile.y % tile.height]
    case.expect(not off, f"not on the grid: {off}")


@images("tiles.own", "Every camera has its own tile", "11.37, 11.42, 2.10")
async def own(case: Case) -> None:
    """Cameras of all robots share the frame, each in a tile of its own."""
    watchers = [await camera_robot(case) for _ in range(2)]
    places = [(tile.x, tile.y) for watcher in watchers for tile in watcher.tiles]
    case.need(places.count((0, 0)) < 2, "two cameras at 0, 0: the tiles may have run out")
    case.expect(len(set(places)) == len(places), f"cameras share a tile: {places}")


async def _alone(case: Case) -> CameraRobot:
    """A camera robot in an otherwise empty world, as far as tiles can tell."""
    watcher = await camera_robot(case)
    if (watcher.tile.x, watcher.tile.y) != (0, 0):
        raise Inconclusive("somebody else's camera has the first tile")
    return watcher


@images("tiles.first", "The first camera is at the top left", "11.36, 2.10", exclusive=True)
async def first(case: Case) -> None:
    """In an empty world the first camera gets tile 0, at offset 0, 0. Inconclusive while others
    have robots in the world."""
    async with case.clock.alone():
        watcher = await camera_robot(case)
        at = (watcher.tile.x, watcher.tile.y)
        if at != (0, 0):
            watcher.robot.close()
            client = await ImageClient.open(case)
            pixels = (await client.ask()).pixels
            tile = pixels[: watcher.tile.height, : watcher.tile.width]
            case.need(float(tile.std()) < 3.0, "tile 0 shows something: another robot may be there")
        case.expect(at == (0, 0), f"the only camera is at {at}")


@images("tiles.lowest", "A new camera takes the lowest tile", "11.44, 2.10", exclusive=True)
async def lowest(case: Case) -> None:
    """When a robot leaves, the next new camera takes its tile, and the others keep theirs."""
    async with case.clock.alone():
        leaving = await _alone(case)
        staying = await camera_robot(case)
        leaving.robot.close()
        await staying.robot.run(1.5)
        newcomer = await camera_robot(case)
        at = (newcomer.tile.x, newcomer.tile.y)
        case.expect(at == (0, 0), f"tile 0 is free, but the new camera is at {at}")
        again = tiles_of(await ask_conf(staying.robot))
        case.expect(again == staying.tiles, f"the camera moved from {staying.tiles} to {again}")


@images("tiles.two-cameras", "Each camera counts", "11.42, 2.10", Severity.SHOULD)
async def two_cameras(case: Case) -> None:
    """A robot with two cameras has two tiles. Not applicable without such a robot."""
    for class_name in _TWO_CAMERAS:
        try:
            watcher = await camera_robot(case, class_name)
        except NotApplicable:
            case.release()
            continue
        if len(watcher.tiles) > 1:
            places = {(tile.x, tile.y) for tile in watcher.tiles}
            case.need(places != {(0, 0)}, "cameras at 0, 0: the tiles may have run out")
            case.expect(len(places) == len(watcher.tiles), f"tiles at {places}")
            return
        case.release()
    case.skip(f"none of {', '.join(_TWO_CAMERAS)} has two cameras with tiles")


# What the tile shows.


async def _picture(client: ImageClient, tile: Tile) -> Floats:
    return (await client.ask(tile.request)).pixels.astype(float)


def _apart(one: Floats, other: Floats) -> float:
    return float(np.abs(one - other).mean())


@images("content.not-blank", "A tile shows something", "2.6")
async def not_blank(case: Case) -> None:
    """The tile of a robot's camera is not one colour: there is a world in it."""
    watcher = await camera_robot(case)
    await watcher.robot.run(1.0)
    client = await ImageClient.open(case)
    spread = float((await _picture(client, watcher.tile)).std())
    case.expect(spread > 3.0, f"the picture is one colour (spread {spread:.1f} of 255)")


@images("content.moves", "Pictures follow the robot", "11.34, 2.6", exclusive=True)
async def moves(case: Case) -> None:
    """While a robot turns, pictures taken some time apart differ more than those of a robot at
    rest. Inconclusive where there is nothing to be seen."""
    watcher = await camera_robot(case)
    await wheels_of(watcher.robot)
    client = await ImageClient.open(case)
    await watcher.robot.run(1.0)
    still = await _picture(client, watcher.tile)
    await watcher.robot.run(0.5)
    noise = _apart(still, await _picture(client, watcher.tile))
    before, after = await case.drive(watcher.robot, "DRIVE {Left -1.5} {Right 1.5}", 2.0)
    case.need(abs(before.yaw - after.yaw) > 0.1, "the robot did not turn")
    moved = _apart(still, await _picture(client, watcher.tile))
    case.need(float(still.std()) > 3.0, "there is nothing to be seen")
    case.expect(moved > noise + 0.5, f"turned: {moved:.2f} of 255 apart, at rest {noise:.2f}")


@images("camera.zoom", "SET FOV narrows the picture", "11.45, 2.11")
async def zoom(case: Case) -> None:
    """`SET {Type Camera} {Opcode FOV}` changes the field of view, which CONF tells, and 0 restores
    the default."""
    watcher = await camera_robot(case)
    narrow = await _fov(watcher, "0.5")
    case.expect(abs(narrow - 28.6) < 2.0, f"0.5 rad asked for, CONF tells {narrow} degrees")
    restored = await _fov(watcher, "0")
    default = watcher.tile.default_fov
    case.expect(abs(restored - default) < 0.01, f"0 gives {restored}, the default is {default}")


@images("camera.clamped", "Fields of view are clamped", "11.45, 2.11", Severity.SHOULD)
async def clamped(case: Case) -> None:
    """Fields of view beyond the limits of the camera are clamped to them."""
    watcher = await camera_robot(case)
    most, least = await _fov(watcher, "100"), await _fov(watcher, "0.01")
    case.expect(abs(most - watcher.tile.most_fov) < 1.0, f"100 rad gives {most} degrees")
    case.expect(abs(least - watcher.tile.least_fov) < 1.0, f"0.01 rad gives {least} degrees")


async def _fov(watcher: CameraRobot, radians: str) -> float:
    name = watcher.tile.name
    await watcher.robot.send(
        f"SET {{Type Camera}} {{Name {name}}} {{Opcode FOV}} {{Params {radians}}}"
    )
    await watcher.robot.run(0.4)
    return tiles_of(await ask_conf(watcher.robot))[0].fov


@images("camera.viewports", "SET Viewports does no harm", "11.46, 2.11")
async def viewports(case: Case) -> None:
    """`SET {Type Viewports}`, which only one generation of servers knows, never ends the
    connection, whatever its values."""
    robot = await case.spawn()
    await robot.send(
        "SET {Type Viewports} {Config SingleView} {Viewport1 Camera}",
        "SET {Type Viewports} {Config 1} {Viewport1 Disable} {Viewport2 NoSuchCamera}",
        "SET {Type Viewports}",
    )
    case.expect(await robot.client.is_alive(), "the connection is dead after SET {Type Viewports}")
