"""Frames: header, raw pixels, JPEG pictures (side channels reference 2.3 to 2.5)."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image, JpegImagePlugin

from usarsim_conformance.case import Case
from usarsim_conformance.side_checks import checks_of
from usarsim_conformance.side_images import (
    OK,
    Frame,
    ImageClient,
    camera_robot,
    facts_of,
    rectangle,
    row_length,
)
from usarsim_conformance.verdicts import Failed, Severity

images = checks_of("images")

Floats = NDArray[np.float64]

_QUALITIES = {1: 100, 2: 75, 3: 50, 4: 25, 5: 10}
"""Nominal JPEG quality by type byte (2.3)."""
_STANDARD_MEAN = 57.625
"""Mean of the luminance quantization table of quality 50 (ITU-T T.81, table K.1)."""


@images("header.length", "The length is big-endian and true", "11.10, 2.3")
async def length(case: Case) -> None:
    """Bytes 1 to 4 of a reply are a big-endian length, equal to the number of payload bytes that
    follow: not more, not less."""
    client = await ImageClient.open(case)
    for request in (OK, rectangle(0, 0, 33, 21), OK):
        frame = await client.ask(request)
        case.expect(frame.size[0], "the payload is empty")
        await client.silent(0.3, "as many bytes as the header names")


@images("header.one-type", "All replies have the same type", "11.11, 2.3")
async def one_type(case: Case) -> None:
    """The type byte is the configured one, for OK, for U and for rectangles out of the frame."""
    client = await ImageClient.open(case)
    requests = (OK, rectangle(0, 0, 32, 32), rectangle(client.facts.width, 0, 1, 1))
    kinds = [(await client.ask(request)).kind for request in requests]
    case.expect(len(set(kinds)) == 1, f"OK, U and U outside have the types {kinds}")


@images("header.known-type", "The type is one of six", "2.3", Severity.SHOULD)
async def known_type(case: Case) -> None:
    """The type byte is 0 for raw pixels and 1 to 5 for JPEG; others are not documented."""
    kind = (await facts_of(case)).kind
    case.expect(kind <= 5, f"the type byte is {kind}")


@images("header.one-write", "Header and picture come together", "2.12, 10.4", Severity.SHOULD)
async def one_write(case: Case) -> None:
    """Some clients read once what is there: header and payload are handed over together."""
    wire = (await ImageClient.open(case)).wire
    await wire.send(rectangle(0, 0, 16, 16))
    first = await wire.read(15.0)
    case.expect(len(first) > 5, f"only {len(first)} bytes came in the first piece")


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
    case.expect(frame.payload[:2] == b"\xff\xd8", f"it begins with {frame.payload[:4].hex(' ')}")
    case.expect(frame.payload[-2:] == b"\xff\xd9", f"it ends with {frame.payload[-4:].hex(' ')}")


@images("jpeg.decodes", "JPEG pictures can be decoded", "11.12")
async def decodes(case: Case) -> None:
    """A JPEG payload decodes as a colour picture; that of U to the size of its rectangle."""
    client, frame = await _frame(case, raw=False)
    pixels = frame.pixels
    case.expect(pixels.ndim == 3 and pixels.shape[2] == 3, f"its shape is {pixels.shape}")
    part = (await client.ask(rectangle(0, 0, 50, 30))).pixels
    case.expect(part.shape == (30, 50, 3), f"50 x 30 asked for, its shape is {part.shape}")


@images("jpeg.baseline", "JPEG pictures suit old decoders", "2.3", Severity.SHOULD)
async def baseline(case: Case) -> None:
    """The pictures are sequential JPEG files in colour, not progressive ones or CMYK."""
    _, frame = await _frame(case, raw=False)
    with Image.open(io.BytesIO(frame.payload)) as picture:
        case.expect(picture.mode == "RGB", f"the picture's mode is {picture.mode}")
        case.expect("progressive" not in picture.info, "the picture is progressive")


@images("jpeg.quality", "The quality fits the type", "2.3", Severity.INFORMATIVE)
async def quality(case: Case) -> None:
    """Types 1 to 5 are JPEG at qualities 100, 75, 50, 25 and 10; estimated from the quantization
    table, 15 to either side are let pass."""
    _, frame = await _frame(case, raw=False)
    if frame.kind not in _QUALITIES:
        case.skip(f"no quality is documented for type {frame.kind}")
    with Image.open(io.BytesIO(frame.payload)) as picture:
        if not isinstance(picture, JpegImagePlugin.JpegImageFile):
            raise Failed(f"the picture is a {picture.format} file")
        scale = 100.0 * float(np.mean(picture.quantization[0])) / _STANDARD_MEAN
    # The scaling of tables by quality is that of the Independent JPEG Group's library.
    found = (200.0 - scale) / 2.0 if scale <= 100.0 else 5000.0 / scale
    wanted = _QUALITIES[frame.kind]
    case.expect(abs(found - wanted) <= 15.0, f"quality about {found:.0f} instead of {wanted}")


@images("raw.sides", "Raw pictures begin with their sides", "11.13, 2.4")
async def sides(case: Case) -> None:
    """A raw payload begins with width and height, big-endian and 16 bits each."""
    client, _ = await _frame(case, raw=True)
    frame = await client.ask(rectangle(0, 0, 40, 24))
    case.expect(frame.payload[:4] == bytes((0, 40, 0, 24)), f"not 40 x 24: {frame.payload[:4]!r}")


@images("raw.length", "Raw pictures have three bytes per pixel", "11.14, 2.4")
async def raw_length(case: Case) -> None:
    """The length of a raw reply is 4 + height * row, a row being 3 * width for even frames."""
    _, frame = await _frame(case, raw=True)
    width, height = frame.size
    wanted = 4 + height * row_length(width)
    case.expect(len(frame.payload) == wanted, f"{len(frame.payload)} bytes, not {wanted}")


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
    case.need(abs(blue - red) > 6.0, "the upper part of the picture has no colour: no sky")
    case.expect(blue > red, f"the sky is red ({red:.0f}) rather than blue ({blue:.0f})")


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
    case.expect(abs(top) > abs(bottom), "the sky is at the bottom")


@images("content.tile-of-frame", "Rectangles are cut from the frame", "11.21")
async def tile_of_frame(case: Case) -> None:
    """The picture of a rectangle is that part of the full frame, origin at the top left."""
    watcher = await camera_robot(case)
    await watcher.robot.run(1.0)
    client = await ImageClient.open(case)
    await client.send(watcher.tile.request + OK)  # together: what moves is in neither, or in both
    part = (await client.frame()).pixels.astype(float)
    frame = (await client.frame()).pixels
    again = watcher.tile.cut(frame)
    case.expect(part.shape == again.shape, f"shapes {part.shape} and {again.shape} differ")
    off = float(np.abs(part - again).mean())
    case.expect(off < 12.0, f"the rectangle differs from its part of the frame by {off:.0f} of 255")
