"""Lines out of bytes, words and segments out of lines: terminators, chunking, limits, glued
commands (protocol reference 1.4, 1.5, 1.7, 6.2 and 6.3).
"""

from __future__ import annotations

import time
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.protocol.grammar import (
    KNOWN_WORDS,
    MAX_LINE,
    MOST_SEGMENTS,
    WEIGHT_BYTES,
    Command,
    LineFramer,
    parse_line,
)


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
    """Protocol 21 to 24: CR LF, LF, CR, LF CR and any run of them end a line exactly once."""
    assert LineFramer().feed(b"GETSTARTPOSES" + terminator) == [b"GETSTARTPOSES"]


@pytest.mark.parametrize("terminator", [b"\r\n", b"\n", b"\r", b"\n\r"], ids=repr)
def test_terminators_split_over_reads_end_a_line_once(terminator: bytes) -> None:
    """Protocol 24, 26: a two byte terminator cut in half ends the line once, and no blank line
    follows."""
    framer = LineFramer()
    data = b"A" + terminator + b"B" + terminator
    assert feed_bytewise(framer, data) == [b"A", b"B"]


def test_a_lone_line_feed_needs_no_further_input() -> None:
    """Protocol 22: the line is there as soon as its LF is, unlike in the original."""
    framer = LineFramer()
    assert framer.feed(b"GETSTARTPOSES") == []
    assert framer.feed(b"\n") == [b"GETSTARTPOSES"]


def test_two_lines_in_one_read_keep_their_order() -> None:
    """Protocol 25: several commands of one packet come out in order."""
    assert LineFramer().feed(b"INIT {A 1}\r\nDRIVE {B 2}\nSET\r") == [
        b"INIT {A 1}",
        b"DRIVE {B 2}",
        b"SET",
    ]


def test_a_rest_without_terminator_is_held() -> None:
    """Protocol 27: a command without terminator does not come out until the terminator arrives."""
    framer = LineFramer()
    assert framer.feed(b"DRIVE {Left 1}\r\nDRIVE {Le") == [b"DRIVE {Left 1}"]
    assert framer.pending == len(b"DRIVE {Le")
    assert framer.feed(b"") == []
    assert framer.feed(b"ft 2}\r") == [b"DRIVE {Left 2}"]
    assert framer.pending == 0


@pytest.mark.parametrize("terminator", [b"\r\n", b"\n", b"\r", b"\n\r"], ids=repr)
def test_blank_lines_produce_nothing(terminator: bytes) -> None:
    """Protocol 28: twenty blank lines produce no line and are not counted as discarded."""
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
    """Protocol 20: a line of exactly 65536 bytes is processed, however it arrives."""
    framer = LineFramer()
    line = b"x" * MAX_LINE
    lines = feed_bytewise(framer, line + b"\r\n") if bytewise else framer.feed(line + b"\r\n")
    assert lines == [line]
    assert framer.discarded == 0


@pytest.mark.parametrize("bytewise", [False, True])
def test_a_longer_line_is_discarded_to_its_end(bytewise: bool) -> None:
    """Protocol 20: one byte more and the line is thrown away, while its neighbours survive."""
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
    """Protocol 20: 1 MiB without terminator holds nothing back and the next command works."""
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


DRIVE = ("DRIVE", (("Left", "1"), ("Right", "1")))


def parsed(line: bytes) -> list[tuple[str, tuple[tuple[str, str], ...]]]:
    return [(command.word, command.segments) for command in parse_line(line)]


@pytest.mark.parametrize(
    "line",
    [
        b"DRIVE {Left 1} {Right 1}",
        b"DRIVE{Left 1}{Right 1}",
        b"DRIVE {  Left   1  }   {Right 1}",
        b"DRIVE {Left 1} junk {Right 1}",
        b"DRIVE } {Left 1} {Right 1}",
        b"DRIVE {Left\t1}\t{\tRight 1\t}",
        b" \t DRIVE {Left 1} {Right 1} \t ",
        b"DRIVE {Left 1}}{Right 1}}",
        b"DRIVE {{Left 1}{Right 1}",
        b"DRIVE {} {Left 1} {   } {Right 1}",
        b"drive {Left 1} {Right 1}",
        b"dRiVe{Left 1}{Right 1} trailing",
        b"\xef\xbb\xbfDRIVE {Left 1} {Right 1}",
        b"DRIVE junk {Left 1} {Right 1}",
    ],
    ids=repr,
)
def test_lenient_spellings_of_one_command(line: bytes) -> None:
    """Protocol 31, 33 to 35, 38: blanks, junk, stray braces and a byte order mark change
    nothing."""
    assert parsed(line) == [DRIVE]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"DRIVE {Left 1.0} {Right", [("DRIVE", (("Left", "1.0"),))]),
        (b"DRIVE {Left 1} {Right 1", [("DRIVE", (("Left", "1"),))]),
        (b"DRIVE {Left 1} {Bad} {Right 1}", [("DRIVE", (*DRIVE[1][:1], ("Bad", ""), DRIVE[1][1]))]),
        (b"DRIVE {Left 1 {Right 2}", [("DRIVE", (("Right", "2"),))]),
        (b"DRIVE Left 1.0}", [("DRIVE", ())]),
        (b"DRIVE", [("DRIVE", ())]),
        (b"DRIVER {Left 1}", [("DRIVER", (("Left", "1"),))]),
        (b"{Left 1}", [("", (("Left", "1"),))]),
        (b"?? {Left 1}", [("", (("Left", "1"),))]),
        (b"}", [("", ())]),
    ],
    ids=repr,
)
def test_malformed_lines(
    line: bytes, expected: list[tuple[str, tuple[tuple[str, str], ...]]]
) -> None:
    """Protocol 36, 37 and table 1.7: a broken segment is dropped, its neighbours stay
    visible."""
    assert parsed(line) == expected


@pytest.mark.parametrize(
    "line", [b"", b" ", b"\t \t", b"\xef\xbb\xbf", b"\xef\xbb\xbf  "], ids=repr
)
def test_lines_with_nothing_in_them(line: bytes) -> None:
    """Protocol 28: blanks are no command at all."""
    assert parse_line(line) == []


def test_lookup_ignores_case_and_takes_the_first() -> None:
    """Protocol 32, 39: names match in any case as whole words, and the first of a repeated name
    wins."""
    (command,) = parse_line(b"drive {left 1} {LEFT 5} {Lefty 7} {RIGHT 2}")
    assert command.get("Left") == "1"
    assert command.get("rIGHT") == "2"
    assert command.get("Righ") is None
    assert command.get("Speed", "0") == "0"
    assert command.has("lefty")
    assert not command.has("Speed")


def test_a_segment_of_one_word_is_present_but_empty() -> None:
    """A name without value is found with an empty value, which differs from an absent name."""
    (command,) = parse_line(b"DRIVE {Flip}")
    assert command.has("flip")
    assert command.get("flip") == ""


def test_values_keep_inner_blanks_and_commas() -> None:
    """Protocol 40: inner blanks and commas belong to the value, outer blanks do not."""
    (command,) = parse_line(b"SET {Params   118 two  words, more } {Opcode Write}")
    assert command.get("Params") == "118 two  words, more"
    assert command.get("Opcode") == "Write"


def test_multi_pair_segments_read_as_one_value() -> None:
    """Protocol 1.5: a client's `{Name F1 Range 2.1}` is name `Name`, value `F1 Range 2.1`."""
    assert parsed(b"X {Name F1 Range 2.1}") == [("X", (("Name", "F1 Range 2.1"),))]


def test_non_ascii_bytes_pass_through() -> None:
    """Protocol 52: foreign bytes in a name survive as Latin-1 and hide nothing behind them."""
    (command,) = parse_line("INIT {Name Röver Žluťoučký} {Start A}".encode())
    assert command.get("Name") == "Röver Žluťoučký".encode().decode("latin-1")
    assert command.get("Start") == "A"


@pytest.mark.parametrize("byte", [0x00, 0x0B, 0x1C, 0x85, 0xA0, 0xFF])
def test_only_blank_and_tab_separate(byte: int) -> None:
    """Protocol 1.5: bytes that Unicode calls white space belong to the value."""
    character = chr(byte)
    (command,) = parse_line(f"SET {{Params {character}a{character}}}".encode("latin-1"))
    assert command.get("Params") == f"{character}a{character}"


def test_glued_command_of_rdk() -> None:
    """Protocol 29: a known word glued behind a closing brace starts its own command."""
    line = b"SET {Type RFIDReleaser} {Name Gun} {Opcode Release}DRIVE {Left 1.0} {Right 1.0}"
    assert parsed(line) == [
        ("SET", (("Type", "RFIDReleaser"), ("Name", "Gun"), ("Opcode", "Release"))),
        ("DRIVE", (("Left", "1.0"), ("Right", "1.0"))),
    ]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"SET {A 1}GETSTARTPOSES", ["SET", "GETSTARTPOSES"]),
        (b"SET {A 1} getstartposes  ", ["SET", "GETSTARTPOSES"]),
        (b"Init {A 1}Drive {B 2}MultiDrive  {C 3}", ["INIT", "DRIVE", "MULTIDRIVE"]),
        (b"SET {A 1}DRIVE", ["SET", "DRIVE"]),
        (b"{A 1}DRIVE {B 2}", ["", "DRIVE"]),
        (b"SET {A 1}DRIVEN {B 2}", ["SET"]),
        (b"SET {A 1}DRIVE now {B 2}", ["SET"]),
        (b"SET {A 1}DRIVE} {B 2}", ["SET"]),
        (b"SET {A 1}xDRIVE {B 2}", ["SET"]),
        (b"SET {A 1}{DRIVE {B 2}", ["SET"]),
        (b"SET {Name DRIVE} {B 2}", ["SET"]),
        (b"SET DRIVE {B 2}", ["SET"]),
    ],
    ids=repr,
)
def test_what_starts_a_glued_command(line: bytes, words: list[str]) -> None:
    """Protocol 1.4: only a whole known word outside braces, followed by a brace or the end,
    does."""
    assert [command.word for command in parse_line(line)] == words


@pytest.mark.parametrize("word", sorted(KNOWN_WORDS))
def test_every_known_word_can_be_glued(word: str) -> None:
    """Protocol 1.4: all command words of protocol 3.1 and 3.15 start a glued command, in any
    case."""
    line = f"SET {{A 1}}{word.lower()}{{B 2}}".encode()
    assert parsed(line) == [("SET", (("A", "1"),)), (word, (("B", "2"),))]


def test_glued_commands_keep_their_own_text() -> None:
    """The log text of each glued command is its own part of the line."""
    texts = [command.text for command in parse_line(b"SET {A 1} DRIVE {B 2}")]
    assert texts == ["SET {A 1}", "DRIVE {B 2}"]


def test_log_text_is_short_and_printable() -> None:
    """A hostile line cannot write control characters or kilobytes into a log."""
    (command,) = parse_line(b"INIT {Name \x1b[31m\x00\xff}" + b"{A b}" * 1000)
    assert command.text.isascii()
    assert command.text.isprintable()
    assert command.text.startswith(r"INIT {Name \x1b[31m\x00\xff}")
    assert command.text.endswith("...")
    assert len(command.text) < 300
    assert len(command.segments) == 1001
    (command,) = parse_line(b"\xff" * 60_000)
    assert len(command.text) < 300


@pytest.mark.parametrize("segment", [b"{A b}", b"{}", b"{} SET "])
def test_a_line_has_so_many_segments_and_no_more(segment: bytes) -> None:
    """What follows is thrown away, glued commands included, and the last command says so."""
    commands = parse_line(b"SET " + segment * MOST_SEGMENTS)
    assert not any(command.cut for command in commands)
    commands = parse_line(b"SET " + segment * 20_000)
    assert [command.cut for command in commands if command.cut] == [True]
    assert commands[-1].cut
    assert len(commands) <= MOST_SEGMENTS + 1
    assert sum(len(command.segments) for command in commands) <= MOST_SEGMENTS


HEAVY = st.sampled_from([b"{", b"}", b"A", b"{a}", b"{\xe9 \xe9}", b" ", b"{}ACT", b"\xff" * 70])


@settings(max_examples=50, deadline=None)
@given(st.lists(HEAVY, min_size=1, max_size=40), st.integers(1, 500))
def test_the_weight_of_a_command_bounds_its_memory(parts: list[bytes], times: int) -> None:
    """Whatever the line: what its commands take is at most their weight, a fifth at the most more.

    Python keeps tables of texts beside them, which are left out by doing it twice.
    """
    line = (b"".join(parts) * times)[:65_000]
    keep = [parse_line(line)]
    tracemalloc.start()
    try:
        keep.append(parse_line(line))
        taken = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    weight = sum(command.weight for command in keep[-1])
    assert taken <= 1.2 * WEIGHT_BYTES * weight + 4096


def test_commands_of_known_clients_weigh_little() -> None:
    """A driver that is a second behind does not fill the mailbox."""
    assert [one.weight for one in parse_line(b"DRIVE {Left 1.000000} {Right -1.000000}")] == [1]
    (command,) = parse_line(b"ACT {Name Arm} " + b"{Link 1} {Value 0.5000} {Order 0} " * 6)
    assert command.weight <= 5


def test_commands_are_values() -> None:
    """Commands compare by content and cannot be changed."""
    (one,), (two,) = parse_line(b"SET {A 1}"), parse_line(b"SET {A 1}")
    assert one == two == Command("SET", (("A", "1"),), "SET {A 1}")
    with pytest.raises(AttributeError):
        one.word = "DRIVE"  # type: ignore[misc]


@pytest.mark.parametrize(
    "line",
    [
        b"{" * 65536,
        b"}" * 65536,
        b"{a" * 32768,
        b"{}" * 32768,
        b"}DRIVE " * 9362,
        b"{a}" * 21845,
        b"{" + b"a" * 65535,
        b"{" + b" " * 65534 + b"}",
        b"{a" + b" " * 65532 + b"b}",
        b"A" * 65536,
        b" " * 65535 + b"a",
        bytes(range(256)) * 256,
    ],
    ids=lambda line: repr(line[:6]),
)
def test_the_longest_line_takes_linear_time(line: bytes) -> None:
    """No line of 64 KiB costs more than a fraction of a second, whatever its shape."""
    started = time.thread_time()
    parse_line(line)
    assert time.thread_time() - started < 1.0
