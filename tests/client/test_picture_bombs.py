"""Pictures that name more pixels than anybody draws, or are of formats that nobody speaks."""

from __future__ import annotations

import io
import struct

import pytest
from PIL import Image

from usarsim_client import Picture, ProtocolError
from usarsim_client.pictures import MOST_PIXELS


def named(width: int, height: int) -> bytes:
    """A JPEG of a few hundred bytes that names so many pixels."""
    out = io.BytesIO()
    Image.new("RGB", (16, 16), "red").save(out, "JPEG")
    data = out.getvalue()
    at = data.index(b"\xff\xc0") + 5
    return data[:at] + struct.pack(">HH", height, width) + data[at + 4 :]


@pytest.mark.parametrize(("width", "height"), [(65_500, 65_500), (12_000, 10_000), (4097, 4096)])
@pytest.mark.filterwarnings("error")
def test_more_pixels_than_anybody_draws(width: int, height: int) -> None:
    """Neither its size nor its pixels are told, and nothing is decoded; raw ones likewise."""
    raw = struct.pack(">HH", width, height)
    for picture in (Picture(1, named(width, height)), Picture(0, raw)):
        with pytest.raises(ProtocolError, match="no real one"):
            _ = picture.size
        with pytest.raises(ProtocolError, match="no real one"):
            _ = picture.pixels


def test_the_largest_picture() -> None:
    """As many pixels as a server may draw are believed."""
    assert Picture(1, named(4096, 4096)).size == (4096, 4096)
    assert MOST_PIXELS == 4096 * 4096


@pytest.mark.parametrize("format", ["PNG", "TIFF", "GIF", "PPM"])
def test_only_jpeg_is_read(format: str) -> None:
    """What others are able to read may take long, or run what is in it."""
    out = io.BytesIO()
    Image.new("RGB", (16, 16)).save(out, format)
    with pytest.raises(ProtocolError, match="no JPEG"):
        _ = Picture(1, out.getvalue()).pixels
