"""Requests and replies of the two wireless simulations (side channels reference 4.1, 4.2, 5)."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol import comserver, wireless
from usarsim_server.protocol.comserver import (
    GetStrength,
    LinkReader,
    Listen,
    MessageFramer,
    Open,
    Register,
    parse_message,
)
from usarsim_server.protocol.wireless import Reason, Request, parse_request


@pytest.mark.parametrize(
    ("line", "request_"),
    [
        (b"INIT {Robot A} {Port 3333,2323}", Request("INIT", "A", (3333, 2323))),
        (b"INIT {Robot A} {Port 3333}", Request("INIT", "A", (3333,))),
        (b"INIT {Robot A}", Request("INIT", "A")),
        (b"INIT {Robot A} {Port }", Request("INIT", "A")),
        (b"INIT {Robot A} {Port x}", Request("INIT", "A", error=Reason.PORTS)),
        (b"INIT {Robot A} {Port 1,-2}", Request("INIT", "A", error=Reason.PORTS)),
        (b"INIT {Robot A} {Port 65536}", Request("INIT", "A", error=Reason.PORTS)),
        (b"INIT {Robot A} {Port 0,, 65535}", Request("INIT", "A", (0, 65535))),
        (b"INIT {Robot A} {Port 100000}", Request("INIT", "A", error=Reason.PORTS)),
        (b"INIT {Robot A} {Port %s}" % b",".join([b"7"] * 256), Request("INIT", "A", (7,) * 256)),
        (
            b"INIT {Robot A} {Port %s}" % b",".join([b"7"] * 257),
            Request("INIT", "A", error=Reason.PORTS),
        ),
        (b"INIT {Port 1}", Request("INIT", "", (1,), error=Reason.NO_NAME)),
        (b"GETSS {Robot %s}" % (b"n" * 64), Request("GETSS", "n" * 64)),
        (b"GETSS {Robot %s}" % (b"n" * 65), Request("GETSS", error=Reason.NO_NAME)),
        (b"DNS {Robot Base} {Port 65536}", Request("DNS", "Base", error=Reason.PORT)),
        (b"DNS {Robot Base} {Port }", Request("DNS", "Base", error=Reason.PORT)),
        (b"GETSS {Robot Base}", Request("GETSS", "Base")),
        (b"DNS {Robot Base}", Request("DNS", "Base")),
        (b"DNS {Robot Base} {Port 7}", Request("DNS", "Base", port=7)),
        (b"DNS {Robot Base} {Port seven}", Request("DNS", "Base", error=Reason.PORT)),
        (b"REVERSEDNS {Port 49740}", Request("REVERSEDNS", port=49740)),
        (b"REVERSEDNS", Request("REVERSEDNS", error=Reason.PORT)),
        (b"  GETSS{Robot Base}{Robot Other}", Request("GETSS", "Base")),
        (b"\xef\xbb\xbfGETSS {Robot B\xe4r}", Request("GETSS", "Bär")),
        (b"getss {Robot Base}", Request("getss", "Base")),
        (b"GETSS {robot Base}", Request("GETSS", "")),
        (b"{Robot Base}", Request("", "Base")),
        (b"NOBLANK", Request("NOBLANK")),
    ],
)
def test_requests_are_read(line: bytes, request_: Request) -> None:
    """Verbs and keys in their case, the first of equal keys, ports checked (side channels 4.1, 4.2,
    77)."""
    assert parse_request(line) == request_


@given(st.binary(max_size=300))
def test_no_line_is_too_odd(line: bytes) -> None:
    """Whatever comes gives a request whose ports are ports (side channels 4.6)."""
    request = parse_request(line)
    assert all(0 <= port <= 65535 for port in request.ports)
    assert wireless.encode(wireless.strength_reply(request.robot, -1.0)).count(b"\r\n") == 1


@pytest.mark.parametrize(
    ("strength", "text"),
    [
        (-56.6597, "{Strength -56.6597}"),
        (-49.67 - 10 * math.log10(5), "{Strength -56.6597}"),
        (-63.649400, "{Strength -63.6494}"),
        (-100.0, "{Strength -100}"),
        (-1234567.0, "{Strength -1.23457e+06}"),
        (0.0, "{Strength 0}"),
        (1e-9, "{Strength NaN} {Error Model.Returned.NaN}"),
        (-0.0, "{Strength 0}"),
        (math.inf, "{Strength INF} {Error Model.Returned.INF}"),
        (math.nan, "{Strength NaN} {Error Model.Returned.NaN}"),
        (-math.inf, "{Strength NaN} {Error Model.Returned.NaN}"),
        (3.5, "{Strength NaN} {Error Model.Returned.NaN}"),
    ],
)
def test_strengths_have_six_digits(strength: float, text: str) -> None:
    """Six significant digits, and the words for what is no strength (side channels 4.2)."""
    assert wireless.strength_reply("Base", strength) == f"SS {{Robot Base}} {text}"


def test_replies_are_spelt_as_in_the_original() -> None:
    """All other replies, mistakes of spelling included (side channels 4.2, section 12)."""
    assert wireless.MAX_LINE == 102400
    assert wireless.INIT_OK == "INITREPLY {Status OK}"
    assert wireless.error_reply(Reason.NAME_TAKEN) == "ERROR {Reason Robot.Alread.Exists}"
    assert wireless.strength_reply("A", -1.0, oneself=True) == (
        "SS {Robot A} {Strength INF} {Error SS.To.Self}"
    )
    assert wireless.unknown_robot_reply("A") == (
        "SS {Robot A} {Strength NaN} {Error Robot.Does.Not.Exist}"
    )
    assert wireless.port_reply("A", 49731) == "DNSREPLY {Robot A} {Port 49731}"
    assert wireless.no_port_reply("A", known=False) == (
        "DNSREPLY {Robot A} {Port -1} {Error NoSuchRobot}"
    )
    assert wireless.no_port_reply("A", known=True) == (
        "DNSREPLY {Robot A} {Port -1} {Error RobotDoesNotListenOnThisPort}"
    )
    assert wireless.owner_reply(49740, "A") == "REVERSEDNSREPLY {Port 49740} {Robot A}"
    assert wireless.no_owner_reply(49740) == (
        "REVERSEDNSREPLY {Port 49740} {Error UnknownOrIllegalPort}"
    )
    assert wireless.encode("ERROR {Reason X}") == b"ERROR {Reason X}\r\n"


@pytest.mark.parametrize(
    ("line", "wanted"),
    [(b"GETPOS", True), (b"getobs {From A}", True), (b"INIT {Robot GETPOS}", False), (b"", False)],
)
def test_questions_about_ground_truth_are_told_by_the_verb(line: bytes, wanted: bool) -> None:
    """GETPOS and GETOBS in any case, nothing else (section 1, consequence 3)."""
    assert wireless.asks_for_ground_truth(line) is wanted


@pytest.mark.parametrize(
    ("message", "meaning"),
    [
        (b"REGISTER Robot1 192.168.0.11", Register("Robot1", "192.168.0.11")),
        (b"register  Robot1   192.168.0.11", Register("Robot1", "192.168.0.11")),
        (b"LISTEN Base 7000", Listen("Base", "7000")),
        (b"OPEN Robot1 7001 Base 7000", Open("Robot1", "7001", "Base", "7000")),
        (b"GETSS Robot1 Base", GetStrength("Robot1", "Base")),
        (b"REGISTER Robot1", b"Fail: Incorrect Message;"),
        (b"GETSS a b c", b"Fail: Incorrect Message;"),
        (b"SEND 5 hello", b"Fail: Unknown Message;"),
        (b"CLOSE", b"Fail: Unknown Message;"),
        (b"", b"Fail: Unknown Message;"),
        (None, b"Fail: Incorrect Message;"),
    ],
)
def test_messages_are_read(message: bytes | None, meaning: object) -> None:
    """Verbs in any case, runs of blanks, and the two refusals (side channels 5.2, 87)."""
    assert parse_message(message) == meaning


def test_replies_are_spelt_as_in_the_original_comserver() -> None:
    """Every answer of side channels 5.2, with its semicolon and without line end (side channels 79,
    80, 85, 86)."""
    assert comserver.OK == b"OK;"
    assert comserver.not_registered("A") == b"Fail: Robot A not registered;"
    assert comserver.already_registered("A") == b"Fail: Robot with name A already registered;"
    assert comserver.already_listening("A", "7") == (
        b"Fail: Robot with name A already listening at port 7;"
    )
    assert comserver.not_listening("B", "7") == b"Fail: B not listening on port 7;"
    assert comserver.cannot_connect("B") == b"Fail: Cannot connect to B;"
    assert comserver.THIRD_PARTY == b"Fail: Server does not accept third party requests;"
    assert comserver.NO_LINK == b"Fail: Could not establish connection;"


@pytest.mark.parametrize(
    ("strength", "answer"),
    [
        (-56.65970, b"OK:-56.6597;"),
        (0.0, b"OK:0;"),
        (1.0, b"Fail: Could not calculate signal strength;"),
        (math.nan, b"Fail: Could not calculate signal strength;"),
        (math.inf, b"Fail: Could not calculate signal strength;"),
    ],
)
def test_positive_strengths_are_errors(strength: float, answer: bytes) -> None:
    """Valid values are not above zero (side channels 5.3)."""
    assert comserver.strength_reply(strength) == answer


def test_messages_need_no_waiting() -> None:
    """Several messages in one chunk, with line ends between them, are all found
    (side channels 5.1)."""
    framer = MessageFramer()
    assert framer.feed(b"\r\nREGISTER A 1.2.3.4;\r\n LISTEN A ") == [b"REGISTER A 1.2.3.4"]
    assert framer.feed(b"7;;") == [b"LISTEN A 7", b""]


def test_a_long_message_is_given_up_and_the_next_is_found() -> None:
    """A message beyond the limit costs no memory and does not hide its successor."""
    framer = MessageFramer()
    for _ in range(10):
        assert framer.feed(b"x" * comserver.MAX_MESSAGE) == []
    assert framer.feed(b"x;GETSS A B;") == [None, b"GETSS A B"]


def send(payload: bytes) -> bytes:
    """A SEND block as robots write it."""
    return b"SEND %d %s;" % (len(payload), payload)


def test_payload_is_told_by_its_length() -> None:
    """Only the payload of `SEND 5 hello;` is delivered (side channels 82)."""
    assert LinkReader().feed(b"SEND 5 hello;") == b"hello"


def test_close_ends_a_link() -> None:
    """Nothing behind `CLOSE;` is delivered (side channels 84)."""
    reader = LinkReader()
    assert reader.feed(b"SEND 2 ok;CLOSE now;SEND 2 no;") == b"ok"
    assert reader.closed


@pytest.mark.parametrize(
    "junk", [b"HELLO there;", b"SEND x;", b"SEND 12x4 ;", b"SEND  ;", b"ab;", b";", b"\r\n"]
)
def test_junk_is_skipped_to_the_next_semicolon(junk: bytes) -> None:
    """Other words and lengths that are no numbers cost nothing but themselves
    (side channels 5.4)."""
    reader = LinkReader()
    assert reader.feed(junk + send(b"fine")) == b"fine"
    assert not reader.closed


@given(st.lists(st.binary(max_size=40), max_size=8), st.integers(1, 20))
def test_binary_payload_arrives_in_any_chunking(payloads: list[bytes], size: int) -> None:
    """Semicolons and zero bytes in the payload are payload, however it is cut
    (side channels 83)."""
    data = b"".join(map(send, payloads))
    reader = LinkReader()
    got = b"".join(reader.feed(data[at : at + size]) for at in range(0, len(data), size))
    assert got == b"".join(payloads)


@given(st.binary(max_size=200))
def test_no_bytes_are_too_odd(data: bytes) -> None:
    """Whatever a robot sends, no more comes out than went in, in one piece or byte by byte."""
    whole = LinkReader().feed(data)
    reader = LinkReader()
    assert b"".join(reader.feed(data[at : at + 1]) for at in range(len(data))) == whole
    assert len(whole) <= len(data)
    MessageFramer().feed(data)
