"""Encoded pictures: layout of raw ones, JPEGs that decode, work that is done once."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable
from itertools import product
from unittest.mock import Mock

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from usarsim_server.cameras.encoding import Encoder, encode_jpeg
from usarsim_server.cameras.view import Frame, Grid, Region
from usarsim_server.protocol.images import NORMAL, RAW, ImageType

GRID = Grid()
TILE = Region(320, 240, 320, 240)


def scene(height: int = 960, width: int = 1280) -> NDArray[np.uint8]:
    """A picture with a texture and a gradient, the same each time."""
    noise = np.random.default_rng(3).integers(0, 40, (height, width, 3), dtype=np.uint8)
    rows, columns = np.mgrid[0:height, 0:width]
    slope = np.stack([columns * 200 // width, rows * 200 // height, 0 * rows], axis=-1)
    return noise + slope.astype(np.uint8)


def frame(number: int = 1, pixels: NDArray[np.uint8] | None = None) -> Frame:
    """A frame with these pixels."""
    return Frame.of(number, 0.0, scene() if pixels is None else pixels)


def raw_pixels(message: memoryview) -> NDArray[np.uint8]:
    """Red, green, blue of a raw reply, read as side channels reference 2.4 tells."""
    width, height = int.from_bytes(message[5:7]), int.from_bytes(message[7:9])
    row = -(-3 * width // 4) * 4
    assert message[0] == 0
    assert int.from_bytes(message[1:5]) == len(message) - 5 == 4 + height * row
    rows = np.frombuffer(message, np.uint8, offset=9).reshape(height, row)
    return rows[:, : 3 * width].reshape(height, width, 3)[:, :, ::-1]


def jpeg_pixels(message: memoryview) -> NDArray[np.uint8]:
    """Red, green, blue of a JPEG reply."""
    assert int.from_bytes(message[1:5]) == len(message) - 5
    return np.asarray(Image.open(io.BytesIO(message[5:])).convert("RGB"))


# Frames


def test_every_region_of_a_frame_is_cut_out_of_its_tiles() -> None:
    """Regions in one tile are no copies; others are put together; all are read-only."""
    grid, dice = Grid(3, 2, 4, 3), np.random.default_rng(5)
    tiles = tuple(dice.integers(0, 256, (3, 4, 3), dtype=np.uint8) for _ in range(grid.tiles))
    for tile in tiles:
        tile.flags.writeable = False
    whole = np.vstack([np.hstack(tiles[:3]), np.hstack(tiles[3:])])
    cutting = Frame(1, 0.0, grid, tiles)
    assert np.array_equal(cutting.pixels, whole)
    for x, y in product(range(12), range(6)):
        for width, height in product(range(1, 13 - x), range(1, 7 - y)):
            found = cutting.cut(Region(x, y, width, height))
            assert np.array_equal(found, whole[y : y + height, x : x + width])
            assert not found.flags.writeable
    assert np.shares_memory(cutting.cut(grid.region(4)), tiles[4])
    for place in ((0, 0, 13, 1), (-1, 0, 1, 1), (0, 5, 1, 2), (0, 0, 0, 1)):
        with pytest.raises(ValueError, match="not inside 12 x 6"):
            cutting.cut(Region(*place))


# Raw


@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 320])
def test_raw_rows_are_filled_and_complete(width: int) -> None:
    """Side channels 13 and 14: size, filled rows, and every pixel of the region in its place."""
    source = frame()
    found = raw_pixels(Encoder(RAW).encode(source, Region(7, 11, width, 9)))
    assert np.array_equal(found, source.pixels[11:20, 7 : 7 + width])


def test_red_is_the_last_byte_of_a_raw_pixel() -> None:
    """Side channels 15: pure red is 00 00 FF."""
    pixels = np.zeros((2, 4, 3), dtype=np.uint8)
    pixels[:, :, 0] = 255
    assert Encoder(RAW).encode(frame(1, pixels), Region(0, 0, 4, 2))[9:] == b"\0\0\xff" * 8


def test_first_raw_row_is_the_top() -> None:
    """Side channels 16: a picture with a white top row begins with white."""
    pixels = np.zeros((3, 4, 3), dtype=np.uint8)
    pixels[0] = 255
    payload = Encoder(RAW).encode(frame(1, pixels), Region(0, 0, 4, 3))[9:]
    assert payload == b"\xff" * 12 + bytes(24)


# JPEG


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5, 77])
def test_jpeg_is_a_whole_file_of_the_region(number: int) -> None:
    """Side channels 10 to 12: type, length, FF D8 to FF D9, and the content of the region."""
    source = frame()
    message = Encoder(ImageType(number)).encode(source, TILE)
    assert message[0] == number
    assert bytes(message[5:7]) == b"\xff\xd8"
    assert bytes(message[-2:]) == b"\xff\xd9"
    found = jpeg_pixels(message)
    assert found.shape == (240, 320, 3)
    error = found.astype(float) - source.pixels[240:480, 320:640]
    assert np.abs(error).mean() < 12.0


def test_full_frame_decodes_to_its_full_size() -> None:
    """Side channels 12."""
    assert jpeg_pixels(Encoder(NORMAL).encode(frame(), GRID.frame)).shape == (960, 1280, 3)


def test_better_types_are_larger() -> None:
    """Side channels 18, for every neighbour: SUPER > GOOD > NORMAL > FAIR > BAD."""
    sizes = [len(Encoder(ImageType(number)).encode(frame(), TILE)) for number in range(1, 6)]
    assert sizes == sorted(sizes, reverse=True)
    assert len(set(sizes)) == 5


@pytest.mark.parametrize("quality", [100, 50])
def test_chroma_has_half_the_resolution(quality: int) -> None:
    """Side channels reference 2.3: 4:2:0, the default of the original's library, always."""
    message = encode_jpeg(scene(64, 64), quality, b"")
    layers = Image.open(io.BytesIO(message)).layer  # type: ignore[attr-defined]
    assert [layer[1:3] for layer in layers] == [(2, 2), (1, 1), (1, 1)]


def test_too_large_picture_is_refused_in_words() -> None:
    """A JPEG has at most 65535 pixels per side; the message names the size."""
    with pytest.raises(ValueError, match="65600 x 1"):
        encode_jpeg(np.zeros((1, 65600, 3), dtype=np.uint8), 50, b"")


def test_head_stands_before_the_file() -> None:
    """A codec leaves room for the header, so that nothing is copied for it."""
    message = encode_jpeg(scene(8, 8), 50, b"12345")
    assert bytes(message[:5]) == b"12345"
    assert bytes(message[5:7]) == b"\xff\xd8"


# Both


@pytest.mark.parametrize("image_type", [RAW, NORMAL])
def test_messages_cannot_be_changed(image_type: ImageType) -> None:
    """Several clients are sent the same memory."""
    assert Encoder(image_type).encode(frame(), TILE).readonly


@pytest.mark.parametrize(
    "region", [Region(1000, 0, 320, 240), Region(-1, 0, 2, 2), Region(0, 0, 0, 5)]
)
def test_region_outside_is_refused(region: Region) -> None:
    """No part of another picture is sent by mistake."""
    with pytest.raises(ValueError, match="not inside 1280 x 960"):
        Encoder(RAW).encode(frame(), region)


@pytest.mark.parametrize(("image_type", "read"), [(RAW, raw_pixels), (NORMAL, jpeg_pixels)])
def test_grey_picture_has_the_size_of_the_region(
    image_type: ImageType, read: Callable[[memoryview], NDArray[np.uint8]]
) -> None:
    """What stands for a picture that did not come is evenly grey."""
    found = read(Encoder(image_type).grey(TILE))
    assert found.shape == (240, 320, 3)
    assert np.all(found == 128)


def test_each_region_of_a_frame_is_encoded_once() -> None:
    """Several clients that ask for the same picture pay once; it is the same memory."""
    codec = Mock(side_effect=encode_jpeg)
    encoder = Encoder(NORMAL, codec)
    source = frame()
    assert encoder.found(source, TILE) is None
    first = encoder.encode(source, TILE)
    assert encoder.encode(source, TILE) is first
    assert encoder.found(source, TILE) is first
    encoder.encode(source, GRID.frame)
    assert codec.call_count == 2


def test_newer_frame_replaces_what_is_kept() -> None:
    """Of each region the newest picture is kept; what comes late never replaces it."""
    encoder = Encoder(NORMAL)
    old, new = frame(1), frame(2, scene() // 2)
    encoder.encode(old, TILE)
    message = encoder.encode(new, TILE)
    assert encoder.found(old, TILE) is None
    assert encoder.kept_bytes == len(message)
    late = encoder.encode(old, TILE)
    assert np.abs(jpeg_pixels(late).mean() - jpeg_pixels(message).mean()) > 20
    assert encoder.found(new, TILE) is message


def test_regions_are_kept_by_themselves() -> None:
    """A region in which nothing is new keeps its older frame beside newer ones of others."""
    codec = Mock(side_effect=encode_jpeg)
    encoder = Encoder(NORMAL, codec)
    old, new = frame(1), frame(2)
    still = encoder.encode(old, TILE)
    whole = encoder.encode(new, GRID.frame)
    assert encoder.encode(old, TILE) is still
    assert encoder.encode(new, GRID.frame) is whole
    assert encoder.kept_bytes == len(still) + len(whole)
    assert codec.call_count == 2


def test_cache_stays_within_its_budget() -> None:
    """However many rectangles clients invent, the oldest give way."""
    source = frame()
    encoder = Encoder(RAW, cache_bytes=100_000)
    regions = [Region(number, 0, 64, 64) for number in range(40)]
    for region in regions:
        encoder.encode(source, region)
        assert encoder.kept_bytes <= 100_000
        encoder.found(source, regions[0])
    assert encoder.found(source, regions[-1]) is not None
    assert encoder.found(source, regions[0]) is not None, "used all the time"
    assert encoder.found(source, regions[1]) is None
    encoder.encode(source, GRID.frame)
    assert encoder.found(source, GRID.frame) is None, "larger than the budget"


def test_threads_may_share_an_encoder() -> None:
    """Many threads, frames and regions at once: every reply is that of its own frame."""
    frames = [frame(number, np.full((96, 128, 3), number * 20, np.uint8)) for number in range(10)]
    encoder = Encoder(RAW, cache_bytes=50_000)
    wrong: list[object] = []

    def work(seed: int) -> None:
        chance = np.random.default_rng(seed)
        for _ in range(100):
            number = int(chance.integers(10))
            x, y = (int(value) for value in chance.integers(0, 60, 2))
            message = encoder.encode(frames[number], Region(x, y, 32, 32))
            if not np.all(raw_pixels(message) == number * 20):
                wrong.append((seed, number))

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
    assert encoder.kept_bytes <= 50_000
