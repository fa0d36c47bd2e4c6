"""Faults that a proxy makes out of a healthy server, and short ways to write them."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from mutants.fault_proxy import Link, LinkKind, Proxy

Kind = TypeVar("Kind", bound=type[Link])
Found = re.Match[bytes]
Pair = tuple[str, str | Callable[[Found], bytes]]
"""Regular expression and replacement, one character per byte, or what makes it of what was
found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WireFault:
    """A server with one fault."""

    name: str  # of the check, with a number behind it if it has several
    check: str  # identifier of the check that is meant to notice
    kind: LinkKind  # makes the link of a connection
    services: tuple[str, ...]  # that have the fault; the others are healthy
    dialect: str  # to judge in, for checks to which it matters
    robot: str  # class of the robots of most checks
    server: str  # `own` for our own server, `images` for one for pictures, `raw` for raw ones
    says: str  # pattern that the check's message fits: what is wrong, and the right value


_FAULTS: dict[str, WireFault] = {}


def all_wire_faults() -> Mapping[str, WireFault]:
    """Every fault of the files `wire_faults_*.py` beside this one, by name."""
    import mutants as package

    for entry in pkgutil.iter_modules(package.__path__):
        if entry.name.startswith("wire_faults_"):
            importlib.import_module(f"{package.__name__}.{entry.name}")
    return dict(_FAULTS)


def enter(
    check: str,
    kind: LinkKind,
    *,
    services: tuple[str, ...] = (),
    dialect: str = "ut2004",
    robot: str = "P2AT",
    server: str = "",
    says: str = "",
) -> None:
    """Enter a fault; see `WireFault`. By default it is one of the service that the check is of."""
    count = sum(fault.check == check for fault in _FAULTS.values())
    name = check if not count else f"{check}-{count + 1}"
    _FAULTS[name] = WireFault(
        name=name,
        check=check,
        kind=kind,
        services=services or (check.partition(".")[0],),
        dialect=dialect,
        robot=robot,
        server=server or ("images" if check.startswith("images") else "own"),
        says=says,
    )


def wire_fault(check: str, **how: Any) -> Callable[[Kind], Kind]:
    """Make a class a fault; see `enter`."""

    def decorate(kind: Kind) -> Kind:
        enter(check, kind, **how)
        return kind

    return decorate


class _Rewrites(Link):
    """Says or hears by regular expressions."""

    def __init__(
        self,
        saying: tuple[Pair, ...],
        hearing: tuple[Pair, ...],
        since: str,
        service: str,
        proxy: Proxy,
    ) -> None:
        super().__init__(service, proxy)
        self._saying, self._hearing = _compiled(saying), _compiled(hearing)
        self._since, self._begun = _pattern(since), not since

    def said(self, unit: bytes) -> bytes:
        for pattern, text in self._saying if self._begun else ():
            unit = pattern.sub(text, unit)
        return unit

    def heard(self, data: bytes) -> bytes:
        self._begun = self._begun or self._since.search(data) is not None
        for pattern, text in self._hearing:
            data = pattern.sub(text, data)
        return data


def _compiled(
    pairs: tuple[Pair, ...],
) -> list[tuple[re.Pattern[bytes], bytes | Callable[[Found], bytes]]]:
    return [
        (_pattern(pattern), text.encode("latin-1") if isinstance(text, str) else text)
        for pattern, text in pairs
    ]


def _pattern(text: str) -> re.Pattern[bytes]:
    return re.compile(text.encode("latin-1"))


def axis(name: str, number: int, change: Callable[[float], float]) -> Pair:
    """Changes a number of a vector that a segment of a name holds."""

    def other(found: Found) -> bytes:
        digits = len(found[2].partition(b".")[2])
        return found[1] + b"%.*f" % (digits, change(float(found[2])))

    return rf"(\{{{name} (?:[-\d.]+,){{{number}}})([-\d.]+)", other


def said(
    check: str, *pairs: Pair, hearing: tuple[Pair, ...] = (), since: str = "", **how: Any
) -> None:
    """The server says something else: what the patterns fit in each of its lines is replaced.

    Args:
        check: that is meant to notice.
        pairs: pattern and replacement.
        hearing: the same for what it hears.
        since: what a connection must have sent before, as a regular expression.
        how: see `enter`.
    """
    enter(check, partial(_Rewrites, pairs, hearing, since), **how)


def heard(check: str, *pairs: Pair, **how: Any) -> None:
    """The server hears something else: what the patterns fit in what is sent is replaced."""
    enter(check, partial(_Rewrites, (), pairs, ""), **how)


def deaf(check: str, pattern: str, **how: Any) -> None:
    """The server does not obey a line in which the pattern is found."""
    heard(check, (rf"[^\r\n]*{pattern}[^\r\n]*", ""), **how)


class _Minds(Link):
    """Does something if it hears a pattern."""

    def __init__(self, pattern: str, act: Callable[[Link], None], service: str, proxy: Proxy):
        super().__init__(service, proxy)
        self._pattern, self._act = _pattern(pattern), act

    def heard(self, data: bytes) -> bytes:
        if self._pattern.search(data):
            self._act(self)
        return data


def hangs_up(check: str, pattern: str, **how: Any) -> None:
    """The server hangs up on who sends what fits the pattern."""
    enter(check, partial(_Minds, pattern, _hang_up), **how)


def dies(check: str, pattern: str, **how: Any) -> None:
    """The server dies of what fits the pattern."""
    enter(check, partial(_Minds, pattern, Link.die), **how)


def answers(check: str, pattern: str, text: str, **how: Any) -> None:
    """The server answers what fits the pattern by a line that should not come."""
    line = f"{text}\r\n".encode("latin-1")
    enter(check, partial(_Minds, pattern, lambda link: link.say(line)), **how)


class _Tires(Link):
    """From the tenth request on none is answered."""

    def __init__(self, token: bytes, service: str, proxy: Proxy) -> None:
        super().__init__(service, proxy)
        self._token, self._count = token, 0

    def heard(self, data: bytes) -> bytes:
        self._count += data.count(self._token)
        return data if self._count < 10 else b""


def tires(check: str, token: bytes, **how: Any) -> None:
    """The server answers no request of a connection from the tenth on; each has the token once."""
    enter(check, partial(_Tires, token), **how)


def _hang_up(link: Link) -> None:
    link.hangs_up = True


class Greets(Link):
    """Says something to who connects."""

    def begin(self) -> None:
        self.say(b"HELLO\r\n")


class NoHalves(Link):
    """End of file ends the connection."""

    minds_eof = True


class OneAtATime(Link):
    """A second client is turned away."""

    most = 1


class DiesOfHangup(Link):
    """The server dies when a client leaves."""

    def ended(self, reset: bool) -> None:
        self.die()


class KeepsLeavers(Link):
    """The server does not notice that somebody has hung up."""

    keeps_server = True


class IgnoresHalfClose(Link):
    """The server goes on for who has ended its half of the connection."""

    ignores_eof = True


class InPieces(Link):
    """What comes at once is cut behind some bytes, counted from the end if below zero."""

    cut = 20

    def pieces(self, data: bytes) -> list[bytes]:
        return [data[: self.cut], data[self.cut :]]


def in_pieces(cut: int) -> type[Link]:
    """A link that cuts what comes at once there."""
    return type("Cut", (InPieces,), {"cut": cut})


class FirstForEver(Link):
    """The first answer is that to everything."""

    def said(self, unit: bytes) -> bytes:
        return bytes(self.memory.setdefault("first", unit))


class Odd(Link):
    """Every so many answers one is another one."""

    change: tuple[bytes, bytes]
    every = 2

    def said(self, unit: bytes) -> bytes:
        if not re.search(self.change[0], unit):
            return unit
        self.memory["count"] = self.memory.get("count", 0) + 1
        return unit if self.memory["count"] % self.every else re.sub(*self.change, unit)


class FewClients(Link):
    """A fifth client is turned away."""

    most = 4


class KeepsGhosts(Link):
    """Who is hung up does not get to know it."""

    keeps_kit = True


def odd(pattern: str, text: str, every: int = 2) -> type[Link]:
    """A link on which the pattern is replaced in one of so many answers that it fits."""
    change = pattern.encode(), text.encode()
    return type("OddOne", (Odd,), {"change": change, "every": every})
