"""Requests and replies of the wireless simulation server (side channels reference 4.1, 4.2)."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.protocol import wireless
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
        (b"INIT {Port 1}", Request("INIT", "", (1,), error=Reason.NO_NAME)),
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
    """Verbs and keys in their case, the first of equal keys, ports checked (4.1, 4.2, check 77)."""
    assert parse_request(line) == request_


@given(st.binary(max_size=300))
def test_no_line_is_too_odd(line: bytes) -> None:
    """Whatever comes gives a request whose ports are ports (4.6)."""
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
        (-0.0, "{Strength 0}"),
        (math.inf, "{Strength INF} {Error Model.Returned.INF}"),
        (math.nan, "{Strength NaN} {Error Model.Returned.NaN}"),
        (-math.inf, "{Strength NaN} {Error Model.Returned.NaN}"),
        (3.5, "{Strength NaN} {Error Model.Returned.NaN}"),
    ],
)
def test_strengths_have_six_digits(strength: float, text: str) -> None:
    """Six significant digits, and the words for what is no strength (4.2)."""
    assert wireless.strength_reply("Base", strength) == f"SS {{Robot Base}} {text}"


def test_replies_are_spelt_as_in_the_original() -> None:
    """All other replies, mistakes of spelling included (4.2, section 12)."""
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
