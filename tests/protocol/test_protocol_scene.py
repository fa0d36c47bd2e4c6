"""Frames and hellos of the scene port, without sockets."""

from __future__ import annotations

import contextlib
import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol.scene import (
    LONGEST,
    FrameReader,
    SceneError,
    message,
    pose_frame,
    read_hello,
)

KNOWN = ("scene", "poses")
JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
)


def test_a_message_byte_by_byte() -> None:
    """Length, big-endian, with the kind in it; the kind; the text."""
    assert message({"a": "é"}) == b"\x00\x00\x00\x0bJ" + '{"a":"é"}'.encode()


def test_poses_byte_by_byte() -> None:
    """Time, generation, count and seven numbers a pose, all little-endian."""
    frame = pose_frame(1.5, 7, np.arange(14, dtype=np.float32).reshape(2, 7))
    assert frame[:5] == struct.pack(">IB", 1 + 16 + 56, ord("P"))
    assert struct.unpack("<dII14f", frame[5:]) == (1.5, 7, 2, *range(14))


@given(st.lists(st.dictionaries(st.text(), JSON, max_size=4), max_size=5), st.data())
def test_messages_come_out_however_they_are_cut(
    messages: list[dict[str, object]], data: st.DataObject
) -> None:
    """The same bytes give the same messages in any pieces."""
    rest, reader, found, begun = b"".join(map(message, messages)), FrameReader(), [], 0
    for cut in sorted(data.draw(st.sets(st.integers(0, len(rest)), max_size=8)) | {len(rest)}):
        found += reader.feed(rest[begun:cut])
        begun = cut
    assert found == [json.loads(message(one)[5:]) for one in messages]


@given(st.binary(max_size=300))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    """CON-29: nothing but messages and `SceneError` comes out."""
    with contextlib.suppress(SceneError):
        assert all(isinstance(one, dict) for one in FrameReader().feed(data))


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"INIT {ClassName USARBot.P3AT}\r\n",
        struct.pack(">IB", LONGEST + 1, ord("J")),
        struct.pack(">IB", 3, ord("P")) + b"xx",
        struct.pack(">IB", 1, ord("J")),
        struct.pack(">IB", 3, ord("J")) + b"[]",
        struct.pack(">IB", 5, ord("J")) + b"\xff\xfe{}",
        struct.pack(">IB", 60001, ord("J")) + b"[" * 60000,
        struct.pack(">IB", 0, ord("J")),
    ],
)
def test_what_is_no_message_is_refused(data: bytes) -> None:
    """Other protocols, other kinds, lengths beyond all sense, no JSON, no object."""
    with pytest.raises(SceneError, match="message"):
        FrameReader().feed(data)


@given(st.dictionaries(st.sampled_from(["hello", "token", "channels", "rate_hz"]), JSON))
def test_any_hello_is_read_or_refused(fields: dict[str, object]) -> None:
    """CON-29: whatever stands in it."""
    with contextlib.suppress(SceneError):
        hello = read_hello(fields, KNOWN)
        assert 0.1 <= hello.rate_hz <= 30.0
        assert set(hello.channels) <= set(KNOWN)


def test_hellos() -> None:
    """What is absent has a default, the rate is kept within its limits, channels count once."""
    assert read_hello({"hello": 1}, KNOWN).channels == KNOWN
    hello = read_hello({"hello": 1, "rate_hz": 500, "channels": ["poses", "poses"]}, KNOWN)
    assert (hello.rate_hz, hello.channels) == (30.0, ("poses",))
    for wrong, why in (
        ({}, "hello"),
        ({"hello": 2}, "hello"),
        ({"hello": True}, "hello"),
        ({"hello": 1, "channels": ["sound"]}, "no channel 'sound' .known: scene, poses"),
        ({"hello": 1, "channels": "scene"}, "list"),
        ({"hello": 1, "rate_hz": "fast"}, "number"),
        ({"hello": 1, "token": 5}, "token"),
    ):
        with pytest.raises(SceneError, match=why):
            read_hello(wrong, KNOWN)
