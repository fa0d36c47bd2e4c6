"""Attacks on the web pages: the operator's console, and the desk of a study.

Both stand beside the server then (`web_servers`). They have no robots of their own, and the console
records.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from hostile.attack import HOLD_LEAST, HOLD_WAIT, Attack
from hostile.links import Link, Site

TOKENS: Mapping[str, str] = {
    who: f"token-of-the-{who.replace(' ', '-')}"
    for who in ("operator", "instructor", "viewer", "operator 1", "operator 2", "experimenter")
}
"""Of both, by who has them; attackers have a viewer's at most."""
PORTS = ("console", "desk")
HALVES = 1100
"""More than a process usually may have descriptors."""
_TEXTS = 190
"""Texts that a page says a second, less than it may."""


def head(port: int, path: str = "/") -> bytes:
    """A request of a browser, but for the empty line that ends it."""
    return b"GET %s HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n" % (path.encode(), port)


def socket_opened(port: int) -> bytes:
    """The request that opens a page's WebSocket."""
    return head(port, "/socket") + (
        b"Origin: http://127.0.0.1:%d\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n" % port
    )


def said(type: str, **fields: Any) -> bytes:
    """A text of a page, masked with zeros."""
    text = json.dumps({"type": type, **fields}, separators=(",", ":")).encode()
    size = len(text)
    length = bytes([0x80 | size]) if size < 126 else b"\xfe" + size.to_bytes(2, "big")
    return b"\x81" + length + b"\0\0\0\0" + text


def reloaded(who: str) -> Callable[[int], bytes]:
    """What a browser says that loads the page of somebody, by the port: files, then hello."""

    def words(port: int) -> bytes:
        hello = said("hello", token=TOKENS[who], name=who)
        return head(port) + b"\r\n" + socket_opened(port) + hello

    return words


def _everywhere(count: int, first: Callable[[int], bytes], **how: Any) -> Callable[..., Any]:
    """So many links to each of the pages; they come back when they are thrown out."""

    def links(site: Site) -> Sequence[Link]:
        ports = [site.ports[name] for name in PORTS]
        return [Link(port, first(port), reads=True, **how) for port in ports for _ in range(count)]

    return links


def _junk(site: Site) -> Sequence[Link]:
    dice = random.Random(0)
    links = []
    for port in (site.ports[name] for name in PORTS):
        firsts = (
            b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + dice.randbytes(600),
            dice.randbytes(4096) + b"\r\n\r\n",
            head(port) + b"X: " + b"y" * 100_000,
            head(port) + b"X: y\r\n" * 5000 + b"\r\n",
            head(port, "/" + "n" * 6000) + b"\r\n",
            head(port, "/%00/%ff/..%2f..%2f") + b"\r\n",
            head(port) + b"Content-Length: 999999999999\r\n\r\n" + b"z" * 60_000,
            head(port) + b"Transfer-Encoding: chunked\r\n\r\nffffffff\r\n" + b"z" * 60_000,
            socket_opened(port) + dice.randbytes(4096),
            socket_opened(port) + said("hello", token="wrong", name="x" * 40),
        )
        links += [Link(port, first, lives=0.2, reads=True) for first in firsts]
    return links


def _requests(site: Site) -> Sequence[Link]:
    links = []
    for name, file in (("console", "/page.js"), ("desk", "/study.js")):
        port = site.ports[name]
        asked = head(port, file) + b"\r\n"
        links += [Link(port, again=asked, reads=number % 2 == 0) for number in range(30)]
    return links


def _with_token(*texts: bytes, every: float = 0.0) -> Callable[[int], Callable[[Site], Any]]:
    """Pages of viewers that say something again and again."""

    def counted(count: int) -> Callable[[Site], Any]:
        def links(site: Site) -> Sequence[Link]:
            port = site.ports["console"]
            return [
                Link(
                    port,
                    socket_opened(port) + said("hello", token=TOKENS["viewer"], name=f"V{number}"),
                    texts[number % len(texts)],
                    every=every,
                    reads=True,
                )
                for number in range(count)
            ]

        return links

    return counted


_FORBIDDEN = said("mark", robot="R1", place=[0, 0, 0], note="x" * 900) * (_TEXTS // 10)
_LOOKING = said("select", robot="R1", more="x" * 1500) * (_TEXTS // 10)
_PINGING = said("ping", clock=0.0, ages={f"R{n}": 0.1 for n in range(200)}) * (_TEXTS // 10)

WEB_ATTACKS = (
    Attack(
        "web-halves",
        f"{HALVES} half-sent requests at the console, and as many at the desk of a study",
        _everywhere(HALVES, lambda port: head(port) + b"X-Half: "),
        PORTS,
        wait=HOLD_WAIT,
        least=HOLD_LEAST,
        web=True,
    ),
    Attack(
        "web-drip",
        "100 requests each that go on, a byte a second",
        _everywhere(100, lambda port: head(port) + b"X-Drip: ", again=b"x", every=1.0),
        PORTS,
        wait=5.0,
        least=HOLD_LEAST,
        web=True,
    ),
    Attack(
        "web-mute",
        "90 pages each that never say hello",
        _everywhere(90, socket_opened),
        PORTS,
        wait=5.0,
        least=HOLD_LEAST,
        web=True,
    ),
    Attack("web-junk", "20 clients send what is no HTTP, come and go", _junk, PORTS, web=True),
    Attack(
        "web-requests",
        "30 clients each ask for scripts at full speed, half of them never read",
        _requests,
        PORTS,
        wait=5.0,
        web=True,
    ),
    Attack(
        "web-texts",
        f"16 pages with a viewer's token say {_TEXTS} texts a second each, most of them forbidden",
        _with_token(_FORBIDDEN, _LOOKING, _PINGING, every=0.1)(16),
        PORTS,
        web=True,
    ),
    Attack(
        "web-full",
        "90 pages with a viewer's token hold the places of the console",
        _with_token(said("ping", clock=0.0), every=1.0)(90),
        PORTS,
        wait=HOLD_WAIT,
        web=True,
    ),
)
