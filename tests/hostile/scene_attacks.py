"""Attacks on the port that shows the live world, and lets supervisors drive."""

from __future__ import annotations

import random
from collections.abc import Sequence

from hostile.attack import HOLD_LEAST, HOLD_WAIT, Attack
from hostile.links import Link, Site
from usarsim_server.protocol.scene import message

TOKEN = "secret"
"""What everybody has to know who may look."""
SUPERVISED = ("--scene-port", "0", "--scene-token", TOKEN, "--supervise", "on")
LOOKED_AT = SUPERVISED[:4]

_ALL = ["scene", "poses", "lines", "clock"]


def hello(token: str = TOKEN, channels: Sequence[str] = _ALL) -> bytes:
    """The first words of a client that wants these channels, as often as possible."""
    return message({"hello": 1, "token": token, "channels": list(channels), "rate_hz": 30})


def _ask(request: str, **fields: object) -> bytes:
    return message({"request": request, "id": 1, **fields})


INTERVENTIONS = b"".join(
    [
        _ask("pace", action="pause"),
        _ask("pace", action="speed", factor=0.05),
        *(_ask("take", robot=f"R{number}", by="Eve") for number in range(16)),
        *(
            _ask("drive", robot=f"R{number}", line="DRIVE {Left 9} {Right -9}")
            for number in range(16)
        ),
    ]
)
"""What would stop the world and take everybody's robot."""

QUESTIONS = b"".join(
    [
        *(_ask("rate", rate_hz=rate) for rate in (0.1, 30, -1, "x")),
        _ask("take", robot="Nobody at all"),
        _ask("drive", robot="Nobody at all", line="DRIVE {" * 4000),
        _ask("pace", action="step", seconds=-1),
        _ask("x" * 60_000),
        _ask("hand_back", session=["?"]),
    ]
)
"""Requests that are refused, or change nothing for others."""


def _unread(site: Site) -> Sequence[Link]:
    return [Link(site.ports["scene"], hello()) for _ in range(16)]


def _half_frames(site: Site) -> Sequence[Link]:
    port, whole = site.ports["scene"], hello()
    cuts = (b"", whole[:1], whole[:3], whole[:5], whole[:-1], whole + whole[:7])
    slow = [Link(port, whole[:6], again=b" ", every=0.3, reads=True) for _ in range(10)]
    return slow + [Link(port, cuts[n % len(cuts)], reads=True) for n in range(40)]


def _flood(site: Site) -> Sequence[Link]:
    port = site.ports["scene"]
    return [Link(port, hello(), again=QUESTIONS, reads=number % 2 == 0) for number in range(15)]


def _wrong_tokens(site: Site) -> Sequence[Link]:
    port = site.ports["scene"]
    tokens = ("", "Secret", TOKEN + "\0", "s" * 50_000, "\u2603")
    first = [hello(tokens[n % len(tokens)]) + INTERVENTIONS for n in range(30)]
    return [Link(port, one, again=INTERVENTIONS, lives=0.3, reads=True) for one in first]


def _junk(site: Site) -> Sequence[Link]:
    port, dice = site.ports["scene"], random.Random(0)
    firsts = (
        *(dice.randbytes(4096) for _ in range(4)),
        b"\xff\xff\xff\xff",
        b"\x00\x00\x00\x00",
        b"\x00\x01\x00\x00J" + b"[" * 65_535,
        b"\x00\x00\x00\x05P1234",
        b"GET / HTTP/1.1\r\n\r\n",
        hello() + dice.randbytes(4096),
    )
    return [Link(port, firsts[n % len(firsts)], lives=0.2, reads=True) for n in range(20)]


def _crowd(site: Site) -> Sequence[Link]:
    return [Link(site.ports["scene"], reads=True) for _ in range(200)]


def _unauthorised(site: Site) -> Sequence[Link]:
    port = site.ports["scene"]
    return [Link(port, hello(), again=INTERVENTIONS, reads=True) for _ in range(15)]


def _deaf_truth(site: Site) -> Sequence[Link]:
    port, first, sign = site.ports["scene"], hello(channels=["truth"]), _ask("rate", rate_hz=30)
    # A request now and then, by which it notices that it was cut off, and comes again.
    return [Link(port, first, again=sign, every=0.3, buffer=4096) for _ in range(8)]


SCENE_ATTACKS = (
    Attack(
        "scene-truth-unread",
        "8 clients want every row of the truth, never read, and come again",
        _deaf_truth,
        options=SUPERVISED,
    ),
    Attack(
        "scene-unread",
        "16 clients look at everything and never read",
        _unread,
        options=SUPERVISED,
    ),
    Attack(
        "scene-halves",
        "50 clients send half frames, some byte by byte",
        _half_frames,
        ("scene",),
        options=SUPERVISED,
        wait=HOLD_WAIT,
        least=HOLD_LEAST,
    ),
    Attack(
        "scene-requests",
        "15 clients send requests that make no sense at full speed, half of them never read",
        _flood,
        ("scene",),
        options=SUPERVISED,
    ),
    Attack(
        "scene-tokens",
        "30 clients with wrong tokens come and go, want to pause the world and take all robots",
        _wrong_tokens,
        ("scene",),
        options=SUPERVISED,
    ),
    Attack(
        "scene-junk",
        "20 clients send random bytes, come and go",
        _junk,
        ("scene",),
        options=SUPERVISED,
    ),
    Attack(
        "scene-held",
        "200 connections that say nothing hold the port",
        _crowd,
        ("scene",),
        options=SUPERVISED,
        wait=HOLD_WAIT,
        least=HOLD_LEAST,
    ),
    Attack(
        "scene-unauthorised",
        "15 who may only look want to pause the world and take all robots, at full speed",
        _unauthorised,
        ("scene",),
        options=LOOKED_AT,
    ),
)
