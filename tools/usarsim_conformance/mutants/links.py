"""Kinds of links that make the same fault of several services."""

from __future__ import annotations

import re

from usarsim_conformance.mutants.fault_proxy import Link


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
