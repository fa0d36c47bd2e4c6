"""Faults of the older wireless simulation, ComServer."""

from __future__ import annotations

import re
from collections.abc import Callable

from usarsim_conformance.mutants.fault_proxy import Link
from usarsim_conformance.mutants.links import DiesOfHangup, Greets, KeepsGhosts, KeepsLeavers, odd
from usarsim_conformance.mutants.wire_faults import dies, heard, said, wire_fault

wire_fault("comserver.connect.silent")(Greets)
wire_fault("comserver.clients.vanishes")(DiesOfHangup)
wire_fault("comserver.register.again")(odd("^OK;", "Fail: Robot already registered;"))
said("comserver.register.ok", ("OK;", "OK;\r\n"))
said("comserver.register.other-address", (r"Fail: Robot with name \S+ already registered", "OK"))
said("comserver.listen.unregistered", ("not registered", "is not registered"))
said("comserver.listen.twice", (r"Fail: Robot with name \S+ already listening[^;]*", "OK"))
heard("comserver.open.dials", (r"OPEN (\S+) \d+", r"OPEN \1 9"))
said("comserver.open.consumed", (r"Fail: \S+ not listening[^;]*", "OK"))
said("comserver.open.not-listening", ("not listening on port", "not listening at port"))
said("comserver.getss.known", ("OK:-", "OK:"))
said("comserver.getss.third-party", ("Fail: Server does not accept[^;]*", "OK:-50"))
said("comserver.request.word-count", ("Incorrect Message", "Unknown Message"))
said("comserver.request.unknown", ("Unknown Message", "Unknown Verb"))
heard("comserver.request.case", ("Register", "Enlist"))
heard("comserver.request.blanks", ("REGISTER   ", "REGISTER A B "))
heard("comserver.request.split", (r"^(LISTEN \S+ )$", r"\1;"))
heard("comserver.request.pipelined", (r"(LISTEN NoOne 1;)HELLO.*", r"\1"))
heard("comserver.request.line-ends", (r"\r\n (?=LISTEN)", "\r\n?"))
dies("comserver.request.long-message", "A{10000}")


@wire_fault("comserver.register.outlives")
class Forgets(Link):
    """Everything is forgotten when a client leaves."""

    def ended(self, reset: bool) -> None:
        self.memory["forgotten"] = True

    def said(self, unit: bytes) -> bytes:
        return b"Fail: Robot not registered;" if self.memory.get("forgotten") else unit


class Dialled(Link):
    """Robots are dialled over links of another kind, on which the server is who calls: what it
    says is heard, and what the robot sends is said."""

    kind: type[Link]

    def heard(self, data: bytes) -> bytes:
        data = re.sub(rb"(OPEN \S+ )(\d+)", self._led, data)
        return re.sub(rb"((?:LISTEN|OPEN \S+ \d+) \S+ )(\d+)", self._led, data)

    def _led(self, found: re.Match[bytes]) -> bytes:
        return found[1] + b"%d" % self.proxy.road(int(found[2]), self.kind)


def _dialled(check: str) -> Callable[[type[Link]], type[Link]]:
    def decorate(kind: type[Link]) -> type[Link]:
        wire_fault(check)(type("DialledBy", (Dialled,), {"kind": kind}))
        return kind

    return decorate


_dialled("comserver.link.close")(KeepsLeavers)
_dialled("comserver.link.hangup")(KeepsGhosts)
_dialled("comserver.link.unanswered")(KeepsLeavers)


@_dialled("comserver.link.payload")
class WithSemicolon(Link):
    """The semicolon behind the payload is carried, too."""

    def heard(self, data: bytes) -> bytes:
        return data + b";"


@_dialled("comserver.link.binary")
class NoZeros(Link):
    """Zero bytes become blanks."""

    def heard(self, data: bytes) -> bytes:
        return data.replace(b"\0", b" ")


@_dialled("comserver.link.joined")
class CommasForSemicolons(Link):
    """Semicolons of the payload are not carried as they are."""

    def heard(self, data: bytes) -> bytes:
        return data.replace(b";", b",")


@_dialled("comserver.link.pieces")
class PiecesReversed(Link):
    """A piece that has no header comes backwards."""

    def said(self, unit: bytes) -> bytes:
        return unit[::-1] if unit == b"56789" else unit


@_dialled("comserver.link.much")
class SomeOfMuch(Link):
    """Behind so much, zeros are carried."""

    carried = 0

    def heard(self, data: bytes) -> bytes:
        self.carried += len(data)
        return data if self.carried < 50_000 else bytes(len(data))


@_dialled("comserver.link.junk")
class CarriesJunk(Link):
    """Words that mean nothing are carried."""

    def said(self, unit: bytes) -> bytes:
        return unit.replace(b"HELLO there;", b"SEND 11 HELLO there;")
