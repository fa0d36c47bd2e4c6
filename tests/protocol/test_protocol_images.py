"""The image stream: which bytes are requests, and how replies are framed."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol.images import (
    IMAGE_TYPES,
    NORMAL,
    RAW,
    FullFrame,
    ImageType,
    Rectangle,
    RequestLexer,
    empty_reply,
    raw_header,
    raw_row_length,
    reply_header,
)

FULL = FullFrame()
TILE = Rectangle(320, 240, 320, 240)
TILE_BYTES = bytes.fromhex("55 00000140 000000F0 00000140 000000F0")


def requests(data: bytes) -> list[FullFrame | Rectangle]:
    """What a fresh lexer makes of these bytes."""
    return RequestLexer().feed(data)


# Requests


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        pytest.param(b"OK", [FULL], id="side channels 3"),
        pytest.param(b"OK\r\n", [FULL], id="side channels 4"),
        pytest.param(b"\r\nOK", [FULL], id="side channels 5"),
        pytest.param(b"ok", [], id="side channels 6"),
        pytest.param(b"OOK", [], id="side channels 7: the second O is used up"),
        pytest.param(b"OOKOK", [FULL], id="side channels 7: the next one counts"),
        pytest.param(b"OOOK", [FULL], id="two pairs"),
        pytest.param(b"OK" * 5, [FULL] * 5, id="side channels 9"),
        pytest.param(b"OUOK", [FULL], id="a U behind an O is used up"),
        pytest.param(TILE_BYTES, [TILE], id="rectangle"),
        pytest.param(b"\0\0\0" + TILE_BYTES, [TILE], id="side channels 22: PoAReT"),
        pytest.param(
            b"U" + b"OKUO" * 4,
            [Rectangle(*[0x4F4B554F] * 4)],
            id="side channels 24: no request inside",
        ),
        pytest.param(TILE_BYTES + b"OK" + TILE_BYTES, [TILE, FULL, TILE], id="side channels 26"),
        pytest.param(b"U" + b"\xff" * 16, [Rectangle(*[2**32 - 1] * 4)], id="unsigned"),
        pytest.param(TILE_BYTES[:-1], [], id="incomplete rectangle"),
        pytest.param(b"INIT {ClassName P3AT}\r\n", [], id="lost controller"),
        pytest.param(b"", [], id="nothing"),
    ],
)
def test_requests_of_the_tables(data: bytes, expected: list[FullFrame | Rectangle]) -> None:
    """Side channels reference 2.2 and side channels 3 to 9, 22, 24 and 26."""
    assert requests(data) == expected


def test_letters_half_a_second_apart_are_one_request() -> None:
    """Side channels 8: the lexer keeps the O until the K comes, however late."""
    lexer = RequestLexer()
    assert lexer.feed(b"O") == []
    assert lexer.feed(b"K") == [FULL]


def test_rectangle_byte_by_byte_is_one_request() -> None:
    """Side channels 23: sixteen bytes are held, the seventeenth completes the request."""
    lexer = RequestLexer()
    for number in range(16):
        assert lexer.feed(TILE_BYTES[number : number + 1]) == []
        assert lexer.pending == number + 1
    assert lexer.feed(TILE_BYTES[16:]) == [TILE]
    assert lexer.pending == 0


def slow_lexer(data: bytes) -> list[FullFrame | Rectangle]:
    """The original's loop, as side channels reference 2.2 tells it: one byte at a time."""
    found: list[FullFrame | Rectangle] = []
    bytes_left = iter(data)
    for byte in bytes_left:
        if byte == 0x4F:
            if next(bytes_left, None) == 0x4B:
                found.append(FULL)
        elif byte == 0x55:
            argument = bytes(itertools.islice(bytes_left, 16))
            if len(argument) == 16:
                found.append(Rectangle(*struct.unpack(">4I", argument)))
    return found


SPEECH = st.lists(
    st.sampled_from([b"OK", b"OK\r\n", b"O", b"U", b"K", b"\0\0\0", TILE_BYTES])
    | st.binary(max_size=20)
).map(b"".join)


@given(SPEECH, st.lists(st.integers(0, 400)))
def test_any_cut_gives_the_requests_of_the_original(data: bytes, cuts: list[int]) -> None:
    """However the bytes are cut: the requests of the original's loop, and bounded memory."""
    lexer = RequestLexer()
    found: list[FullFrame | Rectangle] = []
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    for start, end in itertools.pairwise(places):
        found += lexer.feed(data[start:end])
        assert lexer.pending <= 16
    assert found == slow_lexer(data)


# Replies


@pytest.mark.parametrize(
    ("width", "height", "expected"),
    [
        (320, 240, "00 00 03 84 04 01 40 00 F0"),
        (640, 480, "00 00 0E 10 04 02 80 01 E0"),
        (960, 720, "00 00 1F A4 04 03 C0 02 D0"),
        (1280, 960, "00 00 38 40 04 05 00 03 C0"),
        (1280, 240, "00 00 0E 10 04 05 00 00 F0"),
        (176, 144, "00 00 01 29 04 00 B0 00 90"),
    ],
)
def test_headers_of_the_table(width: int, height: int, expected: str) -> None:
    """Side channels reference 2.5; side channels 10, 13 and 14."""
    size = raw_header(width, height)
    header = reply_header(RAW, len(size) + height * raw_row_length(width))
    assert header + size == bytes.fromhex(expected)


def test_header_of_a_jpeg() -> None:
    """Side channels reference 2.5: 12186 bytes at NORMAL."""
    assert reply_header(NORMAL, 12186) == bytes.fromhex("03 00 00 2F 9A")


@pytest.mark.parametrize(("width", "length"), [(0, 0), (1, 4), (2, 8), (3, 12), (4, 12), (5, 16)])
def test_rows_are_filled_up(width: int, length: int) -> None:
    """Side channels 14: three bytes per pixel, rounded up to a multiple of four."""
    assert raw_row_length(width) == length


@pytest.mark.parametrize("size", [(65536, 1), (1, 65536), (-1, 1)])
def test_sides_that_have_no_header_are_refused(size: tuple[int, int]) -> None:
    """A raw picture names its sides with sixteen bits."""
    with pytest.raises(ValueError, match="raw picture"):
        raw_header(*size)


# Types


@pytest.mark.parametrize("change", [str.upper, str.lower, str.title])
def test_names_mean_their_numbers_in_any_letter_case(change: Callable[[str], str]) -> None:
    """Side channels 17."""
    types = [ImageType.named(change(name)) for name in IMAGE_TYPES]
    assert [one.byte for one in types] == [0, 1, 2, 3, 4, 5]
    assert [one.quality for one in types] == [None, 100, 75, 50, 25, 10]


def test_empty_name_is_normal() -> None:
    """Side channels 19."""
    assert ImageType.named("") == NORMAL == ImageType(3)


def test_unknown_name_is_refused() -> None:
    """A word that is no name is an error, not a silent default."""
    with pytest.raises(ValueError, match="JPEG2000"):
        ImageType.named("JPEG2000")


@pytest.mark.parametrize(("number", "byte"), [(6, 6), (255, 255), (256, 0), (259, 3), (1000, 232)])
def test_other_numbers_have_the_quality_of_good(number: int, byte: int) -> None:
    """Side channels reference 2.3, last row: JPEG at 75, the number modulo 256 in the reply."""
    assert ImageType(number).quality == 75
    assert reply_header(ImageType(number), 1)[0] == byte


def test_types_are_shown_as_they_are_written() -> None:
    """A name where there is one, else the number."""
    assert [str(ImageType(number)) for number in (0, 3, 5, 6)] == ["RAW", "NORMAL", "BAD", "6"]


@pytest.mark.parametrize(
    ("number", "expected"),
    [(0, "00 00000004 0000 0000"), (3, "03 00000000"), (256, "00 00000000")],
)
def test_empty_replies(number: int, expected: str) -> None:
    """Side channels 25: a raw picture of 0 x 0, or a header without payload."""
    assert empty_reply(ImageType(number)) == bytes.fromhex(expected)
