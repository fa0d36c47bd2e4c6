"""Frames and the pictures of robots in them: header, raw pixels, JPEG, tiles (side channels
reference 2.3 to 2.5, 2.10, 2.11)."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, JpegImagePlugin

from usarsim_client.pictures import FULL_FRAME, rectangle, row_length
from usarsim_conformance.case import Case
from usarsim_conformance.recordings import wheels_of
from usarsim_conformance.registry import Failed, Inconclusive, NotApplicable, Severity, checks_of
from usarsim_conformance.side_images import (
    CameraRobot,
    Frame,
    ImageClient,
    Tile,
    ask_conf,
    camera_robot,
    facts_of,
    tiles_of,
)

images = checks_of("images")

Floats = NDArray[np.float64]

_QUALITIES = {1: 100, 2: 75, 3: 50, 4: 25, 5: 10}
"""Nominal JPEG quality by type byte (side channels 2.3)."""
_STANDARD_MEAN = 57.625
"""Mean of the luminance quantization table of quality 50 (ITU-T T.81, table K.1)."""


@images("header.length", "The length is big-endian and true", "11.10, 2.3")
async def length(case: Case) -> None:
    """Bytes 1 to 4 of a reply are a big-endian length, equal to the number of payload bytes that
    follow: not more, not less."""
    client = await ImageClient.open(case)
    for request in (FULL_FRAME, rectangle(0, 0, 33, 21), FULL_FRAME):
        frame = await client.ask(request)
        named = len(frame.payload)
        more = len(await client.wire.silence(0.3))
        case.expect(
            not more,
            f"the length in the header is {named}, but {named + more} bytes of payload follow it, "
            "not as many",
        )
        case.expect(
            frame.size[0], f"a picture of {named} bytes of payload is empty, not one with pixels"
        )


@images("header.one-type", "All replies have the same type", "11.11, 2.3")
async def one_type(case: Case) -> None:
    """The type byte is the configured one, for OK, for U and for rectangles out of the frame."""
    client = await ImageClient.open(case)
    requests = (FULL_FRAME, rectangle(0, 0, 32, 32), rectangle(client.facts.width, 0, 1, 1))
    kinds = [(await client.ask(request)).kind for request in requests]
    case.expect(
        len(set(kinds)) == 1,
        f"the type bytes of OK, U and U outside of the frame are {kinds}, not the same",
    )


@images("header.known-type", "The type is one of six", "2.3", Severity.SHOULD)
async def known_type(case: Case) -> None:
    """The type byte is 0 for raw pixels and 1 to 5 for JPEG; others are not documented."""
    kind = (await facts_of(case)).kind
    case.expect(kind <= 5, f"the type byte is {kind}, not 0 to 5")


@images("header.type-alone", "The type byte comes by itself", "2.12", Severity.INFORMATIVE)
async def type_alone(case: Case) -> None:
    """The original sent type, length and picture by three calls, and a client of UT2004 takes a
    receive of exactly one byte as the start of a picture."""
    pieces = []
    for _ in range(5):
        wire = (await ImageClient.open(case)).wire
        await wire.send(rectangle(0, 0, 16, 16))
        pieces.append(len(await wire.read(15.0)))
        if pieces[-1] == 1:
            return
    case.expect(
        False, f"the first pieces of five pictures have {pieces} bytes, not 1, the type byte alone"
    )


async def _frame(case: Case, raw: bool) -> tuple[ImageClient, Frame]:
    facts = await facts_of(case)
    if raw != (facts.kind == 0):
        case.skip(f"the stream is of type {facts.kind}: {'no ' if raw else ''}raw pixels")
    client = await ImageClient.open(case)
    return client, await client.ask()


@images("jpeg.markers", "JPEG pictures are complete files", "11.12, 2.3")
async def markers(case: Case) -> None:
    """A JPEG payload begins with FF D8 and ends with FF D9."""
    _, frame = await _frame(case, raw=False)
    case.expect(
        frame.payload[:2] == b"\xff\xd8",
        f"the JPEG picture begins with {frame.payload[:2].hex(' ')}, not ff d8",
    )
    case.expect(
        frame.payload[-2:] == b"\xff\xd9",
        f"the JPEG picture ends with {frame.payload[-2:].hex(' ')}, not ff d9",
    )


@images("jpeg.decodes", "JPEG pictures can be decoded", "11.12")
async def decodes(case: Case) -> None:
    """A JPEG payload decodes as a colour picture; that of U to the size of its rectangle."""
    client, frame = await _frame(case, raw=False)
    pixels = frame.pixels
    case.expect(
        pixels.ndim == 3 and pixels.shape[2] == 3,
        f"a picture has the shape {pixels.shape}, not height, width and 3 colours",
    )
    part = (await client.ask(rectangle(0, 0, 50, 30))).pixels
    case.expect(
        part.shape == (30, 50, 3),
        f"a picture of 50 x 30 has the shape {part.shape}, not (30, 50, 3)",
    )


@images("jpeg.baseline", "JPEG pictures suit old decoders", "2.3", Severity.SHOULD)
async def baseline(case: Case) -> None:
    """The pictures are sequential JPEG files in colour, not progressive ones or CMYK."""
    _, frame = await _frame(case, raw=False)
    with Image.open(io.BytesIO(frame.payload)) as picture:
        case.expect(
            picture.mode == "RGB", f"the mode of the JPEG picture is {picture.mode}, not RGB"
        )
        case.expect(
            "progressive" not in picture.info,
            f"the JPEG picture of type {frame.kind} is progressive, not sequential",
        )


@images("jpeg.quality", "The quality fits the type", "2.3", Severity.INFORMATIVE)
async def quality(case: Case) -> None:
    """Types 1 to 5 are JPEG at qualities 100, 75, 50, 25 and 10; estimated from the quantization
    table, 15 to either side are let pass."""
    _, frame = await _frame(case, raw=False)
    if frame.kind not in _QUALITIES:
        case.skip(f"no quality is documented for type {frame.kind}")
    with Image.open(io.BytesIO(frame.payload)) as picture:
        if not isinstance(picture, JpegImagePlugin.JpegImageFile):
            raise Failed(f"the picture is a {picture.format} file, not JPEG")
        scale = 100.0 * float(np.mean(picture.quantization[0])) / _STANDARD_MEAN
    # The scaling of tables by quality is that of the Independent JPEG Group's library.
    found = (200.0 - scale) / 2.0 if scale <= 100.0 else 5000.0 / scale
    wanted = _QUALITIES[frame.kind]
    case.expect(
        abs(found - wanted) <= 15.0,
        f"the picture has a quality of about {found:.0f}, not {wanted}, as type {frame.kind} has",
    )


@images("raw.sides", "Raw pictures begin with their sides", "11.13, 2.4")
async def sides(case: Case) -> None:
    """A raw payload begins with width and height, big-endian and 16 bits each."""
    client, _ = await _frame(case, raw=True)
    frame = await client.ask(rectangle(0, 0, 40, 24))
    case.expect(
        frame.payload[:4] == bytes((0, 40, 0, 24)),
        f"the raw picture begins with {frame.payload[:4].hex(' ')}, not 00 28 00 18, its 40 x 24",
    )


@images("raw.length", "Raw pictures have three bytes per pixel", "11.14, 2.4")
async def raw_length(case: Case) -> None:
    """The length of a raw reply is 4 + height * row, a row being 3 * width for even frames."""
    _, frame = await _frame(case, raw=True)
    width, height = frame.size
    wanted = 4 + height * row_length(width)
    case.expect(
        len(frame.payload) == wanted,
        f"a raw picture of {width} x {height} has {len(frame.payload)} bytes of payload, not "
        f"{wanted}",
    )


@images("raw.padding", "Raw rows are filled up to four bytes", "11.14, 2.4")
async def padding(case: Case) -> None:
    """Rows whose length is no multiple of four are padded, as those of Windows bitmaps are."""
    client, _ = await _frame(case, raw=True)
    for width in (1, 2, 3, 5, 30):
        frame = await client.ask(rectangle(0, 0, width, 3))
        wanted = 4 + 3 * row_length(width)
        case.expect(
            len(frame.payload) == wanted,
            f"{width} x 3 pixels: {len(frame.payload)} bytes, not {wanted}",
        )


@images("content.sky-is-blue", "Pixels are blue, green, red", "11.15, 2.4", Severity.SHOULD)
async def sky_is_blue(case: Case) -> None:
    """In raw mode the bytes of a pixel are blue, green, red. Judged by the sky above a robot, so
    the check is inconclusive indoors; a JPEG picture with swapped colours fails as well."""
    watcher = await camera_robot(case)
    client = await ImageClient.open(case)
    pixels = (await client.ask(watcher.tile.request)).pixels
    red, _, blue = pixels[: len(pixels) // 8].reshape(-1, 3).mean(axis=0)
    case.need(
        abs(blue - red) > 6.0,
        f"red and blue of the upper part of the picture are {red:.0f} and {blue:.0f} of 255: no "
        "sky",
    )
    case.expect(blue > red, f"blue of the sky is {blue:.0f} of 255, not above red, {red:.0f}")


@images("content.upright", "The first row is the top", "11.16, 2.4", Severity.SHOULD)
async def upright(case: Case) -> None:
    """Rows come from top to bottom: sky is above, the ground below. Inconclusive where there is
    no sky, or ground as blue as it."""
    watcher = await camera_robot(case)
    client = await ImageClient.open(case)
    pixels = (await client.ask(watcher.tile.request)).pixels.astype(float)
    eighth = max(1, len(pixels) // 8)

    def tint(rows: Floats) -> float:
        red, _, blue = rows.reshape(-1, 3).mean(axis=0)
        return float(blue - red)

    top, bottom = tint(pixels[:eighth]), tint(pixels[-eighth:])
    case.need(abs(abs(top) - abs(bottom)) > 6.0, "sky and ground cannot be told apart")
    case.need(top * bottom >= 0.0 or abs(top) > abs(bottom), "there is more than sky and ground")
    case.expect(
        abs(top) > abs(bottom),
        f"the lowest eighth is more blue than red by {bottom:.0f} of 255, the top by {top:.0f}: "
        "the sky is at the bottom, not at the top",
    )


@images("content.tile-of-frame", "Rectangles are cut from the frame", "11.21")
async def tile_of_frame(case: Case) -> None:
    """The picture of a rectangle is that part of the full frame, origin at the top left."""
    watcher = await camera_robot(case)
    await watcher.robot.run(1.0)
    client = await ImageClient.open(case)
    # Together: what moves is in neither, or in both.
    await client.send(watcher.tile.request + FULL_FRAME)
    part = (await client.frame()).pixels.astype(float)
    frame = (await client.frame()).pixels
    again = watcher.tile.cut(frame)
    case.expect(
        part.shape == again.shape,
        f"the rectangle of a tile has the shape {part.shape}, not {again.shape}, as its part of "
        "the full frame",
    )
    off = float(np.abs(part - again).mean())
    case.expect(
        off < 12.0,
        f"the rectangle differs from its part of the frame by {off:.0f} of 255, not by less than "
        "12",
    )


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
    case.expect(
        _FORM.fullmatch(watcher.conf),
        "CONF of cameras has another form, not {Name n}{TextureOffsetX n} and so on to "
        f"{{CameraFov f}}: {watcher.conf}",
    )


@images("conf.by-name", "CONF of one camera", "2.10")
async def by_name(case: Case) -> None:
    """`GETCONF {Type Camera} {Name n}` tells the same tile as the question without a name."""
    watcher = await camera_robot(case)
    name = watcher.tile.name
    found = tiles_of(await ask_conf(watcher.robot, f" {{Name {name}}}"))
    case.expect(
        [tile.name for tile in found] == [name],
        f"CONF asked for {name} tells of {[tile.name for tile in found]}, not of that one only",
    )
    case.expect(
        found[0] == watcher.tile,
        f"CONF of {name}, asked for by name, tells {found[0]}, not {watcher.tile}, as without the "
        "name",
    )


@images("conf.inside", "Tiles lie in the frame", "2.10")
async def inside(case: Case) -> None:
    """A tile that CONF names lies in the full frame, and its rectangle gives a picture."""
    watcher = await camera_robot(case)
    facts = await facts_of(case)
    for tile in watcher.tiles:
        case.expect(tile.width and tile.height, f"a tile of a camera has no area: {tile}")
        case.expect(
            tile.x + tile.width <= facts.width and tile.y + tile.height <= facts.height,
            f"{tile} is not in the frame of {facts.width} x {facts.height}",
        )
    client = await ImageClient.open(case)
    size = (await client.ask(watcher.tile.request)).size
    case.expect(
        size == (watcher.tile.width, watcher.tile.height),
        f"the picture of a tile has the size {size}, not "
        f"{(watcher.tile.width, watcher.tile.height)}",
    )


@images("conf.degrees", "Fields of view are degrees", "11.41, 2.10")
async def degrees(case: Case) -> None:
    """CONF tells fields of view in degrees: above 5, at most 180, the least below the most, the
    default between."""
    tile = (await camera_robot(case)).tile
    case.expect(
        5.0 < tile.least_fov <= tile.default_fov <= tile.most_fov <= 180.0,
        f"CameraMinFov, CameraDefFov, CameraMaxFov are {tile.least_fov}, {tile.default_fov}, "
        f"{tile.most_fov}, not above 5, at most 180 and growing",
    )
    case.expect(
        tile.least_fov <= tile.fov <= tile.most_fov,
        f"CameraFov is {tile.fov}, not {tile.least_fov} to {tile.most_fov}, CameraMinFov to "
        "CameraMaxFov",
    )


@images("tiles.grid", "Tiles form a grid", "11.37, 11.40, 2.10")
async def grid(case: Case) -> None:
    """All tiles have the configured size, and their offsets are multiples of it. A camera may have
    smaller pictures, of the same size in every tile."""
    watchers = [await camera_robot(case) for _ in range(2)]
    judge_grid(case, [watcher.tiles for watcher in watchers])


def judge_grid(case: Case, robots: Sequence[Sequence[Tile]]) -> None:
    """Tiles of robots of one class stand on a grid of the largest of them."""
    sizes = [[(tile.width, tile.height) for tile in tiles] for tiles in robots]
    case.expect(
        sizes.count(sizes[0]) == len(sizes),
        f"tiles of robots of one class have several sizes, not one: {sizes}",
    )
    width, height = (max(side) for side in zip(*sizes[0], strict=True))
    off = [tile for tiles in robots for tile in tiles if tile.x % width or tile.y % height]
    case.expect(not off, f"tiles are not on the grid of {width} x {height}: {off}")


@images("tiles.own", "Every camera has its own tile", "11.37, 11.42, 2.10")
async def own(case: Case) -> None:
    """Cameras of all robots share the frame, each in a tile of its own."""
    watchers = [await camera_robot(case) for _ in range(2)]
    places = [(tile.x, tile.y) for watcher in watchers for tile in watcher.tiles]
    case.need(places.count((0, 0)) < 2, "two cameras at 0, 0: the tiles may have run out")
    case.expect(
        len(set(places)) == len(places),
        f"tiles of two robots are at {places}, not each at a place of its own",
    )


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
        case.expect(at == (0, 0), f"the tile of the only camera is at {at}, not at (0, 0)")


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
        case.expect(
            at == (0, 0), f"the tile of a new camera is at {at}, not at (0, 0), which is free"
        )
        again = tiles_of(await ask_conf(staying.robot))
        case.expect(
            again == staying.tiles,
            f"tiles of a robot that stays are {again}, not {staying.tiles}, as before",
        )


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
            case.expect(
                len(places) == len(watcher.tiles),
                f"{len(watcher.tiles)} tiles of a robot are at {places}, not each at a place of "
                "its own",
            )
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
    case.expect(
        spread > 3.0,
        f"the picture of a tile has a spread of {spread:.1f} of 255, not above 3: it is one colour",
    )


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
    case.need(
        abs(before.yaw - after.yaw) > 0.1,
        f"the robot turned by {abs(before.yaw - after.yaw):.2f} rad, not by more than 0.1",
    )
    moved = _apart(still, await _picture(client, watcher.tile))
    case.need(
        float(still.std()) > 3.0,
        f"the picture has a spread of {float(still.std()):.1f} of 255, not above 3: there is "
        "nothing to be seen",
    )
    case.expect(
        moved > noise + 0.5,
        f"the picture after a turn by {abs(before.yaw - after.yaw):.2f} rad differs by {moved:.2f} "
        f"of 255 from that before it, not by more than {noise + 0.5:.2f} (at rest {noise:.2f}): it "
        "is stale",
    )


@images("camera.zoom", "SET FOV narrows the picture", "11.45, 2.11")
async def zoom(case: Case) -> None:
    """`SET {Type Camera} {Opcode FOV}` changes the field of view, which CONF tells, and 0 restores
    the default."""
    watcher = await camera_robot(case)
    narrow = await _fov(watcher, "0.5")
    case.expect(
        abs(narrow - 28.6) < 2.0,
        f"CameraFov of CONF is {narrow} after SET FOV 0.5 rad, not 28.6 degrees",
    )
    restored = await _fov(watcher, "0")
    default = watcher.tile.default_fov
    case.expect(
        abs(restored - default) < 0.01,
        f"CameraFov of CONF is {restored} after SET FOV 0, not CameraDefFov, {default}",
    )


@images("camera.clamped", "Fields of view are clamped", "11.45, 2.11", Severity.SHOULD)
async def clamped(case: Case) -> None:
    """Fields of view beyond the limits of the camera are clamped to them."""
    watcher = await camera_robot(case)
    most, least = await _fov(watcher, "100"), await _fov(watcher, "0.01")
    case.expect(
        abs(most - watcher.tile.most_fov) < 1.0,
        f"CameraFov is {most} after SET FOV 100 rad, not CameraMaxFov, {watcher.tile.most_fov}",
    )
    case.expect(
        abs(least - watcher.tile.least_fov) < 1.0,
        f"CameraFov is {least} after SET FOV 0.01 rad, not CameraMinFov, {watcher.tile.least_fov}",
    )


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
    await case.expect_alive(robot.client, "SET {Type Viewports}")
