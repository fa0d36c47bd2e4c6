"""Attacks on all other ports: ground truth, truth, images, both wireless servers."""

from __future__ import annotations

import random
import socket
from collections.abc import Callable, Sequence
from typing import Any

from hostile.attack import MIB, Answers, Attack, Links, holding
from hostile.links import HOST, Link, Site

NO_RADIO = ("--wireless-model", "none")
"""Every link is up, and who registers need not be in the world."""
POSITIONS = b"GETPOS\r\n" + b"".join(
    b"GETOBS {From R%d} {To R%d}\r\n" % (one, other) for one in range(1, 5) for other in range(5, 9)
)
PICTURE = b"OK"
TILES = b"".join(
    b"U" + b"".join(part.to_bytes(4, "big") for part in (320 * tile, 0, 320, 240))
    for tile in range(4)
)
RELAY_PORTS = 256
THROUGH_ONE = 32
PAUSE = 0.01
"""s between two relay ports, so that the attackers stay within their share."""


def _asking(count: int, port: str, question: bytes) -> Callable[[bool], Links]:
    """Clients that ask at full speed, given whether they read."""
    return lambda reads: (
        lambda site: [Link(site.ports[port], again=question, reads=reads) for _ in range(count)]
    )


# -- wireless ---------------------------------------------------------------------


def _register(site: Site, name: bytes, ports: Sequence[int]) -> socket.socket:
    """The connection of a robot that has registered."""
    client = site.dial(site.ports["wireless"])
    listed = b",".join(b"%d" % port for port in ports)
    site.ask(client, b"INIT {Robot %s} {Port %s}\r\n" % (name, listed))
    return client


def _road(site: Site, client: socket.socket, name: bytes, port: int) -> int:
    """The relay port that leads to a robot; 0 if there is none."""
    reply = site.ask(client, b"DNS {Robot %s} {Port %d}\r\n" % (name, port))
    found = reply.rpartition(b"{Port ")[2].partition(b"}")[0]
    return int(found) if found.isdigit() else 0


def _relays(reads: bool) -> Links:
    """Sixteen links between two robots, full speed both ways."""

    def links(site: Site) -> Sequence[Link]:
        listening, port = site.listen()
        source = _register(site, b"Source", [port])
        _register(site, b"Sink", [port])
        road = _road(site, source, b"Sink", port)
        ends = []
        for _ in range(16):
            ends += [site.dial(road), listening.accept()[0]]
        return [Link(0, again=b"\x55" * 65_536, reads=reads, client=end) for end in ends]

    return links


def _many_relays(site: Site) -> Sequence[Link]:
    """As many connections through as many relay ports as two names get."""
    listening = [site.listen()[1] for _ in range(RELAY_PORTS)]
    pair = [(name, _register(site, name, listening)) for name in (b"One", b"Two")]
    for (_, client), (other, _) in (pair, pair[::-1]):
        for port in listening:
            road = _road(site, client, other, port)
            if not road or site.ended.wait(PAUSE):
                break
            for _ in range(THROUGH_ONE):
                # Not waited for: what the server does not take shall not hold up the rest.
                one = socket.socket()
                one.setblocking(False)
                one.connect_ex((HOST, road))
                site.kept.append(one)
    return []


def _junk_registrations(site: Site) -> Sequence[Link]:
    port = site.ports["wireless"]
    first = b"INIT {Robot %s} {Port 1}\r\n"
    names = (b"R1", b"r2", b"x" * 60_000, b"Bell\x07", b"Evil} {Name R3")
    return [
        *(Link(port, first % name, b"GETSS {Robot R1}\r\n", reads=True) for name in names),
        *(Link(port, again=first % b"" + b"DNS {Robot x}\r\n", reads=True) for _ in range(5)),
        *(Link(port, first % b"Come%d" % n, lives=0.1, reads=True) for n in range(5)),
        *(Link(port, again=b"GETSS " + b"{" * 90_000 + b"\r\n", reads=True) for _ in range(5)),
    ]


# -- the older wireless server ---------------------------------------------------------------------


def _open_links(site: Site, count: int) -> list[tuple[socket.socket, socket.socket]]:
    """Links that the server has dialled at both ends."""
    client = site.dial(site.ports["comserver"])
    (one, one_port), (other, other_port) = site.listen(), site.listen()
    for name in (b"Source", b"Sink"):
        site.ask(client, b"REGISTER %s 127.0.0.1;" % name, b";")
    pairs = []
    for _ in range(count):
        site.ask(client, b"LISTEN Sink %d;" % other_port, b";")
        site.ask(client, b"OPEN Source %d Sink %d;" % (one_port, other_port), b";")
        pairs.append((one.accept()[0], other.accept()[0]))
    return pairs


def _junk_links(reads: bool) -> Links:
    """What no message begins with; nothing leaves at the other end."""

    def links(site: Site) -> Sequence[Link]:
        dice = random.Random(0)
        junk = (b"JUNK;", b"\x00", b";", dice.randbytes(65_536), b"SEND 0 ;", b"SENDX")
        pairs = _open_links(site, 16)
        return [
            Link(0, again=junk[number % len(junk)], reads=reads, client=end)
            for number, end in enumerate(end for pair in pairs for end in pair)
        ]

    return links


def _full_links(piece: bytes, reads: bool) -> Links:
    """Messages that are handed on, at full speed both ways."""
    return lambda site: [
        Link(0, again=piece, reads=reads, client=end)
        for pair in _open_links(site, 16)
        for end in pair
    ]


def _registry(site: Site) -> Sequence[Link]:
    port = site.ports["comserver"]
    names = b"".join(b"REGISTER N%d 127.0.0.1;LISTEN N%d 1;" % (n, n) for n in range(1000))
    return [
        *(Link(port, again=names, reads=True) for _ in range(8)),
        *(Link(port, again=b"REGISTER " + b"x" * 9000) for _ in range(8)),
    ]


# -- no ground truth ---------------------------------------------------------------------


def _told(answers: Answers) -> Sequence[str]:
    faults = [
        f"{port}: tells where robots are"
        for port, answer in answers.items()
        if b"Location" in answer
    ]
    if b"GroundTruth" in answers.get("team", b""):
        faults.append("a GroundTruth sensor speaks")
    return faults


def _both(
    name: str, what: str, links: Callable[[bool], Links], port: str, **promised: Any
) -> tuple[Attack, Attack]:
    """An attack whose clients read what they asked for, and the same never read."""
    return (
        Attack(name, what, links(True), (port,), **promised),
        Attack(f"{name}-unread", "the same, never read", links(False), (port,), **promised),
    )


_BLOCKS = b"SEND 16000 " + b"\x55" * 16_000 + b";"

SIDE_ATTACKS = (
    *_both(
        "positions",
        "30 clients ask GETPOS and GETOBS on 50000",
        _asking(30, "wireless", POSITIONS),
        "wireless",
    ),
    *_both(
        "relays",
        "16 links of two names, full speed both ways, read",
        _relays,
        "wireless",
        options=NO_RADIO,
    ),
    Attack(
        "descriptors",
        "two names, 512 relay ports, 16,384 connections",
        _many_relays,
        ("wireless",),
        descriptors=640,
        options=NO_RADIO,
    ),
    Attack(
        "registrations",
        "names that are taken, long, forged; 50 a second come and go",
        _junk_registrations,
        ("wireless",),
    ),
    holding("wireless-held", "wireless"),
    *_both(
        "groundtruth",
        "20 clients ask GETPOS and GETOBS on 7435",
        _asking(20, "groundtruth", POSITIONS),
        "groundtruth",
    ),
    holding("groundtruth-held", "groundtruth"),
    *_both("truth", "30 clients ask on 3989", _asking(30, "truth", b"\r\n"), "truth"),
    holding("truth-held", "truth"),
    *_both(
        "pictures",
        "16 clients ask for pictures and tiles and read",
        _asking(16, "images", PICTURE + TILES),
        "images",
        growth=128 * MIB,
    ),
    Attack(
        "image-junk",
        "16 clients send bytes that are no request",
        _asking(16, "images", b"\x00NOKNO")(True),
        ("images",),
    ),
    holding("image-held", "images"),
    *(
        Attack(name, what, links, ("comserver",), options=NO_RADIO)
        for name, what, links in (
            ("junk-links", "16 links of 5874 carry junk at full speed", _junk_links(True)),
            (
                "full-links",
                "16 links of 5874 carry blocks of 16 kB, read",
                _full_links(_BLOCKS, True),
            ),
            ("small-links", "the same, single bytes", _full_links(b"SEND 1 x;", True)),
            ("links-unread", "the same with 16 kB, never read", _full_links(_BLOCKS, False)),
        )
    ),
    Attack(
        "registry",
        "8 clients register 1,000 names each, 8 send endless messages",
        _registry,
        ("comserver",),
    ),
    holding("comserver-held", "comserver"),
    Attack(
        "truth-off",
        "with --truth off, everything asks where robots are",
        _asking(4, "wireless", POSITIONS)(True),
        ("wireless",),
        options=("--truth", "off"),
        faults=_told,
    ),
)
