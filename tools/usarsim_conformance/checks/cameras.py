"""Where cameras have their tiles, and what they show of light and tilt (side channels reference
2)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from usarsim_conformance.case import Case
from usarsim_conformance.control import pose_of, turned
from usarsim_conformance.grounds import open_floor
from usarsim_conformance.lines import Line, numbers
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Severity, checks_of
from usarsim_conformance.side_images import (
    CameraRobot,
    ImageClient,
    Pixels,
    camera_robot,
    facts_of,
)

images = checks_of("images")

Floats = NDArray[np.float64]

_MOST = 5
"""Robots that are put to see where a second row of tiles begins."""
_FRESH = 15.0
"""s of simulated time until a picture shows what has changed; slow machines draw seldom."""
_TRIES = 10
"""Pictures at least, where simulated time runs faster than they are drawn."""
_LIT = 5.0
"""Of 255 by which a headlight brightens some part of a picture."""
_PARTS = 8
"""Parts of a picture along each side."""
_BANKED = 0.1
"""rad of roll that a horizon shows."""
_SLOPE = 0.05


async def _columns(case: Case, watcher: CameraRobot) -> int:
    """Tiles side by side in the full frame."""
    columns = (await facts_of(case)).width // watcher.tile.width
    case.need(columns, f"no tile of {watcher.tile.width} pixels fits into the frame")
    return columns


@images("tiles.rows", "Tiles follow each other row by row", "11.40, 2.10", exclusive=True)
async def rows(case: Case) -> None:
    """In an empty world the k-th camera gets the tile in column k mod n and row k div n, with n
    tiles side by side in the full frame. Inconclusive while others have robots in the world."""
    async with case.clock.alone():
        first = await camera_robot(case)
        case.need((first.tile.x, first.tile.y) == (0, 0), "somebody else has the first tile")
        columns = await _columns(case, first)
        tiles = list(first.tiles)
        for _ in range(_MOST - 1):
            if len(tiles) > columns or len(case.run.places.all) <= 1:
                break
            tiles += (await camera_robot(case)).tiles
        case.need(len(tiles) > 1, "there is room for one camera only")
        for number, tile in enumerate(tiles):
            row, column = divmod(number, columns)
            wanted = column * first.tile.width, row * first.tile.height
            case.expect(
                (tile.x, tile.y) == wanted,
                f"TextureOffsetX and Y of camera no. {number + 1} are {tile.x}, {tile.y}, not "
                f"{wanted[0]}, {wanted[1]}: column {column}, row {row} of {columns} columns",
            )


@images("tiles.view", "View of STA is the number of the tile", "2.10; protocol reference 4.3")
async def view(case: Case) -> None:
    """View of STA is the number of the tile of the robot's first camera, counted from 0 row by row.
    Not applicable where STA has none."""
    watcher = await camera_robot(case)
    columns = await _columns(case, watcher)
    line = await watcher.robot.wait(lambda line: line.head == "STA", what="STA")
    if line.get("View") is None:
        case.skip("STA has no View")
    tile = min(watcher.tiles, key=lambda tile: (tile.y, tile.x))
    wanted = tile.y // tile.height * columns + tile.x // tile.width
    case.expect(
        line.number("View") == wanted,
        f"View of STA is {line.get('View')}, not {wanted}, the number of the tile at {tile.x}, "
        f"{tile.y}",
    )


def _parts(picture: Pixels) -> Floats:
    """Mean brightness of each of 8 x 8 parts of a picture, of 255."""
    grey = picture.astype(float).mean(axis=2)
    height, width = (side // _PARTS * _PARTS for side in grey.shape)
    shape = (_PARTS, height // _PARTS, _PARTS, width // _PARTS)
    found: Floats = grey[:height, :width].reshape(shape).mean(axis=(1, 3))
    return found


@images("content.headlight", "A headlight lights", "protocol reference 3.6 and 4.3")
async def headlight(case: Case) -> None:
    """After `DRIVE {Light true}`, when LightToggle of STA is True, some eighth by eighth of the
    picture is brighter by more than 5 of 255 than before, and dark again after `{Light false}`."""
    async with open_floor(case) as lot:  # nobody passes by there
        await _switched(case, lot)


async def _switched(case: Case, lot: Place) -> None:
    watcher = await camera_robot(case, place=lot)
    robot = watcher.robot
    if robot.first.get("LightToggle") is None:
        case.skip("STA has no LightToggle")
    client = await ImageClient.open(case)

    async def switch(word: str) -> None:
        await robot.send(f"DRIVE {{Light {word}}}")
        line = await robot.client.maybe(_toggled(word), 3.0)
        if line is None:
            case.skip("LightToggle stays as it is: the robot has no light that can be switched")

    async def rises(unlit: Floats, wanted: bool) -> float:
        """By how much a picture is brighter, once it is as wanted, or at last."""
        latest, tries = case.clock.after(_FRESH), 0
        while True:
            tries += 1
            rise = float((_parts((await client.ask(watcher.tile.request)).pixels) - unlit).max())
            if (rise > _LIT) == wanted or (case.clock.now > latest and tries >= _TRIES):
                return rise
            await case.clock.sleep(0.4)

    await switch("false")
    await robot.run(1.5)
    unlit = _parts((await client.ask(watcher.tile.request)).pixels)
    await switch("true")
    found = await rises(unlit, True)
    case.expect(
        found > _LIT,
        f"the picture is brighter by {found:.1f} of 255 at most while LightToggle of STA is True, "
        f"not by more than {_LIT:g}",
    )
    await switch("false")
    found = await rises(unlit, False)
    case.expect(
        found < _LIT,
        f"the picture is brighter by {found:.1f} of 255 when LightToggle of STA is False again, "
        f"not by less than {_LIT:g}",
    )


def _toggled(word: str) -> Callable[[Line], bool]:
    return lambda line: line.head == "STA" and (line.get("LightToggle") or "").lower() == word


def horizon(picture: Pixels) -> float:
    """Slope of the line between sky and ground, rows by column, positive if it falls to the right;
    NaN if there is none.

    In every column it is where brightness and colour change most within some rows; a line through
    these places is fitted by the median of the slopes of all pairs (Theil and Sen), which some
    columns with other edges do not matter to.
    """
    values = picture.astype(float)
    height, width = values.shape[:2]
    columns = np.linspace(0.03 * width, 0.97 * width, 41).astype(int)
    window = max(2, height // 60)
    edges = []
    for column in columns:
        strip = values[:, max(column - 2, 0) : column + 3].mean(axis=1)
        total = np.cumsum(np.vstack([np.zeros((1, 3)), strip]), axis=0)
        means = (total[window:] - total[:-window]) / window
        steps = np.abs(means[window:] - means[:-window]).sum(axis=1)
        edges.append((column, int(np.argmax(steps)) + window, float(steps.max())))
    strong = [(x, y) for x, y, step in edges if step > 20.0]
    slopes = [(b[1] - a[1]) / (b[0] - a[0]) for n, a in enumerate(strong) for b in strong[n + 1 :]]
    return float(np.median(slopes)) if len(strong) > 25 else math.nan


@images("content.horizon", "A camera that leans has a slanting horizon", "2.6", Severity.SHOULD)
async def slanting(case: Case) -> None:
    """Where a robot stands with its right side lower, a camera that looks ahead shows a horizon
    that rises to the right by the tangent of the roll, within 0.05. Not applicable without a start
    pose on a bank."""
    banked = [place for place in case.survey.tilted if abs(place.rotation[0]) > _BANKED]
    if not banked:
        case.skip("no start pose is on a bank")
    await case.place()  # so many robots at a time and no more
    watcher = await camera_robot(case, place=banked[0])
    robot, name = watcher.robot, watcher.tile.name
    geo = await robot.client.ask(f"GETGEO {{Type Camera}} {{Name {name}}}", "GEO {Type Camera")
    angles = numbers(geo.items()[0]["Orientation"])
    if max(abs(math.remainder(angle, math.tau)) for angle in angles) > 0.05:
        case.skip(f"{name} does not look straight ahead")
    lines = await robot.run(2.0)
    poses = [pose_of(line) for line in lines if line.type == "GroundTruth"]
    if not poses:
        case.skip(f"{robot.class_name} has no GroundTruth")
    roll = turned(0.0, poses[-1].orientation[0])
    if abs(roll) < _BANKED:
        case.skip("the robot rights itself")
    client = await ImageClient.open(case)
    latest, tries, wanted = case.clock.after(_FRESH), 0, -math.tan(roll)
    while True:
        tries += 1
        found = horizon((await client.ask(watcher.tile.request)).pixels)
        good = abs(found - wanted) < _SLOPE
        if good or (case.clock.now > latest and tries >= _TRIES):
            break
        await case.clock.sleep(0.4)
    case.need(not math.isnan(found), "there is no horizon in the picture")
    case.expect(
        good,
        f"the horizon changes by {found:.3f} rows for each column to the right, not by "
        f"{wanted:.3f}, with a roll of {roll:.3f} rad by GroundTruth",
    )
