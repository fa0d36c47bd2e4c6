"""Lines out of bytes: terminators, chunking, limits (protocol reference 1.4, checklist 6.2)."""

from __future__ import annotations

import time
import tracemalloc

import pytest

from usarsim_server.protocol.framing import MAX_LINE, LineFramer


def feed_bytewise(framer: LineFramer, data: bytes) -> list[bytes]:
    lines: list[bytes] = []
    for index in range(len(data)):
        lines += framer.feed(data[index : index + 1])
    return lines


@pytest.mark.parametrize(
    "terminator",
    [b"\r\n", b"\n", b"\r", b"\n\r", b"\r\n\n", b"\n\n\n", b"\r\r", b"\r\n\r\n"],
    ids=repr,
)
def test_every_terminator_ends_a_line_once(terminator: bytes) -> None:
    """21 to 24: CR LF, LF, CR, LF CR and any run of them end a line exactly once."""
    assert LineFramer().feed(b"GETSTARTPOSES" + terminator) == [b"GETSTARTPOSES"]


@pytest.mark.parametrize("terminator", [b"\r\n", b"\n", b"\r", b"\n\r"], ids=repr)
def test_terminators_split_over_reads_end_a_line_once(terminator: bytes) -> None:
    """24, 26: a two byte terminator cut in half ends the line once, and no blank line follows."""
    framer = LineFramer()
    data = b"A" + terminator + b"B" + terminator
    assert feed_bytewise(framer, data) == [b"A", b"B"]


def test_a_lone_line_feed_needs_no_further_input() -> None:
    """22: the line is there as soon as its LF is, unlike in the original."""
    framer = LineFramer()
    assert framer.feed(b"GETSTARTPOSES") == []
    assert framer.feed(b"\n") == [b"GETSTARTPOSES"]


def test_two_lines_in_one_read_keep_their_order() -> None:
    """25: several commands of one packet come out in order."""
    assert LineFramer().feed(b"INIT {A 1}\r\nDRIVE {B 2}\nSET\r") == [
        b"INIT {A 1}",
        b"DRIVE {B 2}",
        b"SET",
    ]


def test_a_rest_without_terminator_is_held() -> None:
    """27: a command without terminator does not come out until the terminator arrives."""
    framer = LineFramer()
    assert framer.feed(b"DRIVE {Left 1}\r\nDRIVE {Le") == [b"DRIVE {Left 1}"]
    assert framer.pending == len(b"DRIVE {Le")
    assert framer.feed(b"") == []
    assert framer.feed(b"ft 2}\r") == [b"DRIVE {Left 2}"]
    assert framer.pending == 0


@pytest.mark.parametrize("terminator", [b"\r\n", b"\n", b"\r", b"\n\r"], ids=repr)
def test_blank_lines_produce_nothing(terminator: bytes) -> None:
    """28: twenty blank lines produce no line and are not counted as discarded."""
    framer = LineFramer()
    assert framer.feed(terminator * 20) == []
    assert framer.discarded == 0


def test_blank_line_after_every_command() -> None:
    """The 2011 controllers send CR LF LF after each command, which yields each command once."""
    framer = LineFramer()
    assert framer.feed(b"Init {A 1}\r\n\nDrive {B 2}\r\n\n") == [b"Init {A 1}", b"Drive {B 2}"]


def test_other_control_characters_do_not_end_a_line() -> None:
    """Only CR and LF are line ends: vertical tab, form feed, NUL and NEL are data."""
    line = b"SET {Params a\x0b\x0c\x00\x1c\x85b}"
    assert LineFramer().feed(line + b"\n") == [line]


@pytest.mark.parametrize("bytewise", [False, True])
def test_a_line_of_the_maximum_passes(bytewise: bool) -> None:
    """20: a line of exactly 65536 bytes is processed, however it arrives."""
    framer = LineFramer()
    line = b"x" * MAX_LINE
    lines = feed_bytewise(framer, line + b"\r\n") if bytewise else framer.feed(line + b"\r\n")
    assert lines == [line]
    assert framer.discarded == 0


@pytest.mark.parametrize("bytewise", [False, True])
def test_a_longer_line_is_discarded_to_its_end(bytewise: bool) -> None:
    """20: one byte more and the line is thrown away, while its neighbours survive."""
    framer = LineFramer(max_line=10)
    data = b"before\n" + b"x" * 11 + b"\nafter\r\n"
    lines = feed_bytewise(framer, data) if bytewise else framer.feed(data)
    assert lines == [b"before", b"after"]
    assert framer.discarded == 1


def test_a_line_that_grows_over_the_maximum_is_counted_once() -> None:
    """A discarded line counts once, at the moment it outgrows the limit, not per chunk."""
    framer = LineFramer(max_line=10)
    for _ in range(100):
        assert framer.feed(b"xxxxx") == []
    assert framer.discarded == 1
    assert framer.feed(b"\n" + b"y" * 12 + b"\nok\n") == [b"ok"]
    assert framer.discarded == 2


def test_a_mebibyte_without_terminator_is_discarded() -> None:
    """20: 1 MiB without terminator holds nothing back and the next command works."""
    framer = LineFramer()
    assert framer.feed(b"z" * (1 << 20)) == []
    assert framer.pending == 0
    assert framer.discarded == 1
    assert framer.feed(b"tail\r\nDRIVE {Left 1}\r\n") == [b"DRIVE {Left 1}"]


def test_memory_stays_bounded() -> None:
    """Megabytes without a line end never hold more than one line of memory."""
    framer = LineFramer()
    chunk = b"q" * 4096
    tracemalloc.start()
    try:
        for _ in range(1024):
            framer.feed(chunk)
            assert framer.pending <= MAX_LINE
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 4 * MAX_LINE


def test_byte_by_byte_takes_linear_time() -> None:
    """A megabyte in single bytes costs seconds at most; copying the rest each time costs hours."""
    framer = LineFramer(max_line=1 << 21)
    started = time.thread_time()
    assert feed_bytewise(framer, b"b" * (1 << 20)) == []
    assert time.thread_time() - started < 10.0
    assert framer.pending == 1 << 20


def test_a_silly_limit_is_refused() -> None:
    """The error names the argument and shows the value."""
    with pytest.raises(ValueError, match="max_line must be at least 1, not 0"):
        LineFramer(max_line=0)


def test_framers_share_nothing() -> None:
    """Two connections do not see each other's bytes."""
    one, other = LineFramer(), LineFramer()
    one.feed(b"DRI")
    assert other.feed(b"VE\n") == [b"VE"]
    assert one.feed(b"VE\n") == [b"DRIVE"]
