"""Faults of the side channels that talk in lines and messages: ground truth, wireless simulation,
USARTruth, ComServer."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from mutants.fault_proxy import Link
from mutants.wire_faults import (
    DiesOfHangup,
    FewClients,
    FirstForEver,
    Found,
    Greets,
    KeepsGhosts,
    KeepsLeavers,
    NoHalves,
    OneAtATime,
    answers,
    deaf,
    dies,
    hangs_up,
    heard,
    in_pieces,
    odd,
    said,
    tires,
    wire_fault,
)

CONTROL = ("control",)


for _service in ("groundtruth", "wireless", "truth"):
    wire_fault(f"{_service}.connect.silent")(Greets)

# Ground truth.

wire_fault("groundtruth.clients.slow-reader")(OneAtATime)
wire_fault("groundtruth.clients.vanishes")(DiesOfHangup)
wire_fault("groundtruth.request.half-close")(NoHalves)
wire_fault("groundtruth.getpos.follows")(FirstForEver)
said("groundtruth.getobs.digits", (r"(ObstCount -?\d+)\.\d+", r"\1"))
said("groundtruth.getobs.form", (r"NUMOBS \{From \S+\} ", "NUMOBS "))
said("groundtruth.getobs.free-air", (r"ObstCount 0", "ObstCount 1"))
said("groundtruth.getobs.ground", (r"ObstCount \d", "ObstCount 0"))
deaf("groundtruth.getobs.keys", r"GETOBS\{")
hangs_up("groundtruth.getobs.nonsense", "nan,inf")
heard("groundtruth.getobs.precedence", (r" \{From A\?\} \{To B\?\}", ""))
wire_fault("groundtruth.getobs.symmetric")(odd("ObstCount 0", "ObstCount 1"))
said("groundtruth.getobs.unknown-robot", ("ObstCount -1", "ObstCount 0"))
said("groundtruth.getpos.battery", ("BatteryEmpty False", "BatteryEmpty True"))
said("groundtruth.getpos.digits", (r"(Location -?\d+\.\d)\d+", r"\1"))
said("groundtruth.getpos.none", (r"\{Robots 0\}", "{Robots 0} "))
said("groundtruth.getpos.place", (r"Location -?\d+", "Location 77"))
said("groundtruth.getpos.station", ("BatteryEmpty False", "BatteryEmpty True"))
deaf("groundtruth.request.case", "getpos")
answers("groundtruth.request.blank-lines", r"^\r\n\r\n", "")
answers("groundtruth.request.unknown", "HELLO", "ERROR")
heard("groundtruth.request.pipelined", (r"(?s)^([^\r]*\r\n).+", r"\1"))
said("groundtruth.getpos.form", (r"\r\n", "\n"))
said("groundtruth.getpos.form", (r"\} \{Name", "}  {Name"))
said("groundtruth.getpos.names", (r"(?<=\{Name )\S+", lambda found: found[0].lower()))
said("groundtruth.getpos.splitter", (" (Location|BatteryEmpty) ", r"} {\1 "))
wire_fault("groundtruth.getpos.leaves", services=CONTROL)(KeepsLeavers)
wire_fault("groundtruth.getobs.bodies")(odd(r"ObstCount \d", "ObstCount 7"))
said("groundtruth.getobs.any-case", (r"ObstCount \d", "ObstCount -1"))
said("groundtruth.getobs.echo", (r"\{Start [^}]*\}", "{Start 0.0000,0.0000,0.0000}"))
deaf("groundtruth.getobs.missing", "GETOBS")


def _backwards(found: Found) -> bytes:
    return found[1] + b" ".join(re.findall(rb"\{[^}]*\}", found[2])[::-1])


def _rounded(found: Found) -> bytes:
    return b"%.4f" % (float(found[0]) + (-0.0001 if found[0].startswith(b"-") else 0.0001))


said("groundtruth.getpos.order", (r"^(POSITIONS \{Robots \d+\} )([^\r]*)", _backwards))
said("groundtruth.getpos.truncated", (r"(?<=[ ,])-?\d+\.\d{4}", _rounded))
hangs_up("groundtruth.request.garbage", r"\xff")
heard("groundtruth.request.line-ends", (r"GETPOS\r$", ""))
dies("groundtruth.request.long-line", "A{10000}")
heard("groundtruth.request.split", (r"^GET$", "GETPOS\r\nGET"))


wire_fault("groundtruth.connect.several")(FewClients)


@wire_fault("groundtruth.getobs.floor")
class FloorTooLow(Link):
    """What stands between two points is looked for 6 cm above them."""

    def heard(self, data: bytes) -> bytes:
        return re.sub(rb"(\{(?:Start|End) [-\d.]+,[-\d.]+,)([-\d.]+)", self._lifted, data)

    @staticmethod
    def _lifted(found: re.Match[bytes]) -> bytes:
        return found[1] + b"%.4f" % (float(found[2]) - 0.06)


@wire_fault("groundtruth.connect.stays-open")
class ShortPatience(Link):
    """Who says nothing is hung up."""

    def begin(self) -> None:
        self.leave(after=0.3)


@wire_fault("groundtruth.getpos.in-time")
class Slow(Link):
    """The first answer takes long."""

    told = False

    def pieces(self, data: bytes) -> list[bytes]:
        first, self.told = not self.told, True
        return [b""] * 50 * first + [data]


# Wireless simulation.

wire_fault("wireless.kick.leaver")(KeepsGhosts)
wire_fault("wireless.dns.stable")(odd(r"(\{Port \d+)(\d)\}", r"\1}"))
said("wireless.getss.self", (r"Strength INF\} \{Error SS\.To\.Self", "Strength 0"))
said("wireless.getss.known", ("Strength -", "Strength "))
said("wireless.init.once", (r"ERROR \{Reason Method\.[^}]*\}", "INITREPLY {Status OK}"))
said("wireless.init.first", (r"ERROR \{Reason Must\.[^}]*\}", "SS {Robot A} {Strength -50}"))
said("wireless.init.duplicate", (r"Alread\.", "Already."))
said("wireless.reversedns.owner", (r"(REVERSEDNSREPLY .*\{Robot )[^}]*", r"\1Nobody"))

wire_fault("wireless.init.free-again")(KeepsLeavers)
wire_fault("wireless.request.slow-reader")(OneAtATime)
wire_fault("wireless.dns.first-port")(odd(r"(\{Port \d+)(\d)\}", r"\1}"))
wire_fault("wireless.getss.symmetric")(odd(r"Strength -\d", "Strength -9"))
said("wireless.dns.form", (r"DNSREPLY \{Robot ", "DNSREPLY {Name "))
said("wireless.dns.no-number", ("Port.Must.Be.Integer", "Port.Must.Be.A.Number"))
said("wireless.dns.nobody", ("NoSuchRobot", "No.Such.Robot"))
said("wireless.dns.wrong-port", ("RobotDoesNotListenOnThisPort", "NoSuchRobot"))
said("wireless.getss.digits", (r"(Strength -?\d+\.\d+)", r"\g<1>123456"))
said("wireless.getss.stranger", ("Strength NaN", "Strength -200"))
said("wireless.init.bad-ports", ("Ports.List.Must.Be.Integer", "Port.Must.Be.Integer"))
said("wireless.init.no-name", ("Robot.Name.Must.Not.Be.Empty", "Robot.Name.Is.Empty"))
said("wireless.init.ok", ("Status OK", "Status Ok"))
heard("wireless.init.several-ports", (r",2323", ",x"))
heard("wireless.request.case", (r"^init", "INIT"))
hangs_up("wireless.request.crashers", r"\x00")
dies("wireless.request.long-line", "A{10000}")
deaf("wireless.request.no-arguments", r"^GETSS\r")
heard("wireless.request.pipelined", (r"(?s)(GETSS[^\r]*\r\n)DNS.*", r"\1"))
heard("wireless.request.split", (r"^GETSS \{Rob$", "GETSS {Robot A}\r\nGETSS {Rob"))
said("wireless.request.unknown", (r"INIT\.only\.once", "INIT.Only.Once"))
said("wireless.reversedns.unknown", ("UnknownOrIllegalPort", "UnknownPort"))


wire_fault("wireless.kick.ghost")(KeepsGhosts)


class Roads(Link):
    """Roads of the wireless simulation lead over links of another kind."""

    kind: type[Link]

    def said(self, unit: bytes) -> bytes:
        return re.sub(rb"(?<=\{Port )[1-9]\d*(?=\})", self._led, unit)

    def _led(self, port: re.Match[bytes]) -> bytes:
        return b"%d" % self.proxy.road(int(port[0]), self.kind)


def _over(check: str, road: type[Link], kind: type[Link]) -> None:
    """A fault of what is carried between robots: `road` leads it over links of another kind."""
    wire_fault(check)(type("Over", (road,), {"kind": kind}))


def _changed(method: str, change: Callable[[bytes], bytes]) -> type[Link]:
    return type("Changed", (Link,), {method: lambda _, data: change(data)})


def _cut(most: int, left: Callable[[bytes], bytes]) -> type[Link]:
    """A link that carries so many bytes, and something else in the place of further ones."""

    def heard(self: Any, data: bytes) -> bytes:
        self.carried = getattr(self, "carried", 0) + len(data)
        return data if self.carried < most else left(data)

    return type("Cut", (Link,), {"heard": heard})


_over("wireless.relay.several", Roads, OneAtATime)
_over("wireless.relay.hangup", Roads, KeepsLeavers)
_over("wireless.relay.refused", Roads, KeepsGhosts)
_over("wireless.relay.leaver", Roads, KeepsGhosts)
_over("wireless.relay.back", Roads, _changed("said", lambda data: data.replace(b"\0", b"")))
_over("wireless.relay.there", Roads, _changed("heard", lambda data: data.replace(b"\0", b"")))
_over("wireless.relay.half-close", Roads, _changed("heard", lambda data: data[:-1]))
_over("wireless.relay.much", Roads, _cut(200_000, lambda data: b""))

# USARTruth.

heard("truth.query.unknown-class", (r"\{class [^}]*\}", "{Actors}"))
said("truth.query.unknown-class", (r"^\{End\}\r\n", ""))
said("truth.query.class", (r"\{Class ", "{Class USARBot."))
heard("truth.query.empty-line", (r"^\r\n$", ""))
heard("truth.query.keys", (r"\{name p2at", "{name P2AT"))
said("truth.listing.form", (r"(\{Rotation [^,]*),", r"\1, "))
said("truth.listing.names", (r"\{Name [^}]*\}", "{Name Kit}"))
said("truth.listing.digits", (r"(\{Location -?\d+\.\d\d)", r"\g<1>0"))
wire_fault("truth.listing.one-read")(in_pieces(-7))

wire_fault("truth.clients.slow-reader")(OneAtATime)
wire_fault("truth.clients.vanishes")(DiesOfHangup)
wire_fault("truth.listing.leaves", services=CONTROL)(KeepsLeavers)
said("truth.listing.class", (r"\{Class ", "{Class USARBot."))
said("truth.listing.getpos", (r"(\{Location -?\d+\.)\d", r"\g<1>4"))
said("truth.listing.time", (r"\{Time (?=\d)", "{Time 9"))
heard("truth.query.actors", (r"^\{Actors\}", "{class No.Such}"))
hangs_up("truth.query.garbage", r"\xff")
heard("truth.query.line-ends", (r"\}\n$", "}"))
dies("truth.query.long-line", "A{10000}")
heard("truth.query.name", (r"\{name [^}]*\}", ""))
heard("truth.query.pipelined", (r"^\r\n\{Actors\}", "{Actors}"))
heard("truth.query.split", (r"^\{class USARBot\.$", "{class USARBot.}\r\n{class USARBot."))


tires("truth.clients.ten-per-second", b"\n")


# ComServer.

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


_over("comserver.link.close", Dialled, KeepsLeavers)
_over("comserver.link.hangup", Dialled, KeepsGhosts)
_over("comserver.link.unanswered", Dialled, KeepsLeavers)
_over("comserver.link.payload", Dialled, _changed("heard", lambda data: data + b";"))
_over("comserver.link.binary", Dialled, _changed("heard", lambda data: data.replace(b"\0", b" ")))
_over("comserver.link.joined", Dialled, _changed("heard", lambda data: data.replace(b";", b",")))
_over("comserver.link.much", Dialled, _cut(50_000, lambda data: bytes(len(data))))
_over(
    "comserver.link.pieces",
    Dialled,
    _changed("said", lambda data: data[::-1] if data == b"56789" else data),
)
_over(
    "comserver.link.junk",
    Dialled,
    _changed("said", lambda data: data.replace(b"HELLO there;", b"SEND 11 HELLO there;")),
)
