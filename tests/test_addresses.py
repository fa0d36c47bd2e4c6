"""Addresses as people write them: what READY prints is understood wherever a host is taken."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

import pytest

from usarsim_client.link import Address
from usarsim_exploration.opening import _place
from usarsim_operator.command import _address as console_address
from usarsim_operator.watch import _address as watch_address
from usarsim_record.recording import Link
from usarsim_server.base.addresses import bare_host, format_address, split_address
from usarsim_server.cli import build_parser
from usarsim_server.options import load_settings
from usarsim_server.services.listener import Endpoint
from usarsim_server.services.port import _advise


@pytest.mark.parametrize(
    ("text", "host"),
    [
        ("[::1]", "::1"),
        (" ::1 ", "::1"),
        ("[fe80::1%eth0]", "fe80::1%eth0"),
        ("127.0.0.1", "127.0.0.1"),
        ("localhost", "localhost"),
        ("[::1", "[::1"),
        ("[lab]", "[lab]"),
    ],
)
def test_brackets_of_a_host(text: str, host: str) -> None:
    """Those of an IPv6 address are left out, others are not."""
    assert bare_host(text) == host


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "lab"])
def test_what_is_printed_is_understood(host: str) -> None:
    """By every command that takes `HOST:PORT`."""
    text = format_address(host, 3000)
    assert split_address(text) == (host, "3000")
    assert console_address(text) == (host, 3000)
    assert watch_address(text) == (host, 3000)
    assert str(Address(host, 3000, 1.0)) == text
    link = Link.parse(1, text)
    assert (link.host, link.port) == (host, 3000)
    place = _place(text)
    assert (place.host, place.control, place.wireless) == (host, 3000, 50000)
    place = _place(f"{text}:50001")
    assert (place.host, place.control, place.wireless) == (host, 3000, 50001)


def test_a_host_alone() -> None:
    """Exploration takes one without a port, too."""
    assert (_place("[::1]").host, _place("lab").host) == ("::1", "lab")


@pytest.mark.parametrize("words", [["--host", "[::1]"], ["--host=::1"]])
def test_hosts_of_settings(words: list[str], tmp_path: Path) -> None:
    """On the command line and in the file."""
    given = build_parser(["serve"]).parse_args(["serve", *words])
    assert load_settings({"host": given.host}, None).host == "::1"
    path = tmp_path / "lab.toml"
    path.write_text('host = "[::1]"\n')
    assert load_settings({}, path).host == "::1"


@pytest.mark.parametrize(
    "words",
    [
        ["console", "--console-host", "[::1]"],
        ["record", "--listen", "0", "--to", "h:1", "FILE", "--host", "[::1]"],
        ["replay", "FILE", "--host", "[::1]"],
        ["conformance", "--host", "[::1]"],
        ["study", "run", "DIR", "--host", "[::1]"],
    ],
)
def test_hosts_of_other_commands(words: list[str]) -> None:
    """All that listen or connect."""
    given: argparse.Namespace = build_parser([words[0]]).parse_args(words)
    assert "::1" in (getattr(given, "host", ""), getattr(given, "console_host", ""))


@pytest.mark.parametrize(
    ("host", "alone"),
    [
        ("127.0.0.1", True),
        ("::1", True),
        ("::ffff:127.0.0.1", True),
        ("::", False),
        ("0.0.0.0", False),
    ],
)
def test_who_is_told_that_only_this_machine_connects(
    host: str, alone: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Loopback is the same by IPv6; the advice names the address that is listened at."""
    caplog.set_level(logging.INFO)
    logging.getLogger("usarsim").propagate = True
    _advise([Endpoint("control", host, 3000)])
    told = [one.getMessage() for one in caplog.records]
    assert bool(told) == alone
    for text in told:
        assert f"only programs on this machine can connect, at {host};" in text
        assert "opens" not in text
