"""What a replay calls the same and what not, and when a controller did something; no sockets."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_record.digest import Digest, Row, Tolerance, compare, shape_of
from usarsim_record.recording import CLIENT, DATA, END, OPEN, SERVER, Event, SessionClock, cues

STREAM = "STA {{Type GroundVehicle}} {{Time {time:.2f}}} {{Battery 1200}} {{Speed {speed:.4f}}}\r\n"


def said(*replies: str, speed: float = 0.5, hz: float = 5.0, count: int = 20) -> Digest:
    """A connection with some replies and a stream of status lines."""
    digest = Digest()
    for reply in replies:
        digest.feed(reply.encode() + b"\r\n")
    for number in range(count):
        digest.feed(STREAM.format(time=number / hz, speed=speed).encode())
    return digest


def judged(then: Digest, now: Digest) -> list[Row]:
    """Rows that differ."""
    return [row for row in compare(1, then, now, Tolerance()) if not row.passed]


REPLY = "POSITIONS {Robots 1} {Name rover Location 1.5000,0.2000,-0.1000 BatteryEmpty False}"


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (REPLY.replace("} {", "}  {"), "form"),
        (REPLY.replace("1.5000", "1.50"), "float2"),
        (REPLY.replace("1.5000", "2.5000"), "1.5 then, 2.5 now"),
        (REPLY.replace("rover", "Rover"), "'rover' then, 'Rover' now"),
        (REPLY.replace("False", "True"), "'False' then, 'True' now"),
        (REPLY.replace("BatteryEmpty", "Battery"), "'BatteryEmpty' then"),
        (REPLY + " {More 1}", "form '' then, ' ' now"),
        (REPLY.replace("POSITIONS", "PLACES"), "never came"),
    ],
)
def test_other_replies_differ(other: str, told: str) -> None:
    """Blanks, digits, numbers, words, names and heads of replies count."""
    rows = judged(said(REPLY), said(other))
    assert any(told in row.difference for row in rows), rows


def test_equal_replies_pass() -> None:
    """Numbers within the tolerance, other times and other ports are the same."""
    then = said(REPLY, "RES {Time 1.50} {Status OK}", "DNSREPLY {Robot A} {Port 4000}")
    now = said(
        REPLY.replace("1.5000", "1.5400"),
        "RES {Time 9.25} {Status OK}",
        "DNSREPLY {Robot A} {Port 5000}",
    )
    assert not judged(then, now)


def test_a_missing_reply_is_noticed() -> None:
    """One answer for two questions differs, however equal it is."""
    (row,) = judged(said(REPLY, REPLY), said(REPLY))
    assert (row.recorded, row.replayed, row.difference) == (2, 1, "2 then, 1 now")


def test_streams_are_compared_by_form_rate_and_values() -> None:
    """A slower stream, another value and another form differ; another count alone does not."""
    assert not judged(said(), said(count=14))
    assert "a second" in judged(said(), said(hz=2.0))[0].difference
    assert "to 3, was 0.5" in judged(said(), said(speed=3.0))[0].difference
    other = Digest()
    for _ in range(20):
        other.feed(b"STA {Time 1.00} {Type GroundVehicle} {Battery 1200}\r\n")
    assert "form" in judged(said(), other)[0].difference


def test_a_counter_may_end_a_little_further() -> None:
    """What grows from line to line may have grown by some lines more, not by many."""

    def counting(last: int) -> Digest:
        digest = Digest()
        for number in range(last):
            digest.feed(f"STA {{Time 1.00}} {{Ticks {number * 4}}}\r\n".encode())
        return digest

    assert not judged(counting(20), counting(22))
    assert "to 156, was" in judged(counting(20), counting(40))[0].difference


def test_a_turn_more_is_the_same_heading() -> None:
    """Noise about zero makes headings jump between 0 and a turn."""
    tolerance = Tolerance()
    assert tolerance.equal(0.0, 6.2830)
    assert tolerance.inside(6.28, 0.0, 0.01)
    assert not tolerance.equal(0.0, 12.566)
    assert not tolerance.equal(0.0, 3.14)


def test_a_hangup_is_noticed() -> None:
    """A server that hangs up by itself differs from one that does not."""
    then, now = said(), said()
    now.ended = True
    assert "now, not then" in judged(then, now)[0].difference


def picture(kind: int, payload: bytes) -> bytes:
    """An image reply (side channels reference 2.3)."""
    return struct.pack(">BI", kind, len(payload)) + payload


def test_pictures_are_compared_by_type_and_size() -> None:
    """Raw pictures by their sides, JPEG pictures by being some; their content may differ."""

    def seen(*replies: bytes) -> Digest:
        digest = Digest()
        digest.feed(b"".join(replies))
        return digest

    raw = struct.pack(">2H", 4, 2) + bytes(24)
    assert seen(picture(0, raw), picture(0, raw)).heads["picture"] == 2
    assert not judged(seen(picture(0, raw)), seen(picture(0, raw[:-1] + b"\x09")))
    assert judged(seen(picture(0, raw)), seen(picture(0, struct.pack(">2H", 2, 4) + bytes(24))))
    assert not judged(seen(picture(3, b"\xff\xd8ab")), seen(picture(3, b"\xff\xd8abcd")))
    assert judged(seen(picture(3, b"\xff\xd8ab")), seen(picture(3, b"")))
    assert judged(seen(picture(3, b"\xff\xd8ab")), seen(picture(2, b"\xff\xd8ab")))


@given(st.binary(max_size=400), st.lists(st.integers(1, 60), max_size=8))
def test_any_bytes_are_taken_in_any_pieces(data: bytes, cuts: list[int]) -> None:
    """A digest never raises, and does not depend on how the bytes were cut."""
    whole, parts = Digest(), Digest()
    whole.feed(data)
    rest = data
    for cut in cuts:
        parts.feed(rest[:cut])
        rest = rest[cut:]
    parts.feed(rest)
    assert whole.heads == parts.heads
    assert whole.bytes == parts.bytes == len(data)
    assert not [row for row in compare(1, whole, parts, Tolerance()) if not row.passed]


@given(st.text(alphabet="{} aA1.,-e", max_size=60))
def test_forms_keep_everything_but_values(line: str) -> None:
    """The form of a line never raises and is the same for the same line."""
    assert shape_of(line) == shape_of(line)
    assert all(isinstance(part, str) for part in shape_of(line))


def test_cues_follow_the_time_that_was_told() -> None:
    """Before any time is told pauses count; then what was told, on any connection, since the first
    time."""
    events = [
        Event(0.0, 1, OPEN),
        Event(0.7, 1, DATA, CLIENT, b"INIT\r\n"),
        Event(9.0, 1, DATA, SERVER, b"STA {Time 40.10}\r\n"),
        Event(9.9, 1, DATA, CLIENT, b"DRIVE\r\n"),
        Event(10.0, 1, DATA, SERVER, b"STA {Time 40.30}\r\nSEN {Type INS}\r\n"),
        Event(10.5, 2, OPEN),
        Event(10.6, 1, END, CLIENT),
        Event(12.6, 2, DATA, CLIENT, b"GETPOS\r\n"),
    ]
    found = [(cue.elapsed, round(cue.pause, 3)) for cue in cues(events)]
    assert found[1] == (None, 0.7)
    assert found[3] == (0.0, 0.0)
    assert round(found[5][0] or 0.0, 3) == 0.2
    assert found[7] == (found[5][0], 2.0)


def test_times_may_be_cut_anywhere() -> None:
    """A time in two pieces is told when its end is there; who has left tells none."""
    clock = SessionClock()
    assert not clock.hear(1, b"STA {Type X} {Tim")
    assert clock.hear(1, b"e 7.00}\r\n")
    assert clock.elapsed == 0.0
    clock.hear(1, b"STA {Time 8.00}")
    clock.end(1)
    assert not clock.telling
    clock.hear(2, b"STA {Time 20.00}")
    clock.hear(2, b"STA {Time 20.50}")
    assert clock.elapsed == 1.5
