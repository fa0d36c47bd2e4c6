"""Faults in what a server of the control port understands: commands, INIT, SET, robust reading."""

from __future__ import annotations

import re

from mutants.fault_proxy import Link
from mutants.wire_faults import (
    DiesOfHangup,
    IgnoresHalfClose,
    KeepsLeavers,
    answers,
    axis,
    deaf,
    dies,
    hangs_up,
    heard,
    said,
    tires,
    wire_fault,
)

UDK = "udk"
_FAR = "{Location 30,%d,-0.3}"
"""Where misread locations lead; a place of its own for each, that nobody stands in the way."""

# Line ends and packets.

heard("control.input.before-greeting", (r"^GETSTARTPOSES\r\n(?=GETSTARTPOSES)", ""))
heard("control.input.bytes", (r"^[^\n]$", ""))
said("control.input.crlf", (r"(NFO \{StartPoses.*\r\n)", r"\1\1"))
heard("control.input.crlf-lf", (r"\r\n\n", "\r\nGETSTARTPOSES\r\n"))
heard("control.input.glued-requests", (r"\}GETGEO[^\r]*", "}"))
heard("control.input.init-packet", (r"(GETCONF[^\r]*\r\n)(GETGEO[^\r]*\r\n)", r"\2\1"))
heard("control.input.lfcr", (r"\n\r$", "\r\nGETSTARTPOSES\r\n"))
heard("control.input.split-end", (r"^\n(?=GETSTARTPOSES)", "GETSTARTPOSES\r\n"))
heard("control.input.unended", (r"GETSTARTPOSES$", "GETSTARTPOSES\r\n"))

heard("control.input.lf", (r"POSES\n$", "POSES"))
heard("control.input.cr", (r"POSES\r$", "POSES"))
heard("control.input.split", (r"^GETSTART$", "GETSTART\r\n"))
heard("control.input.packet", (r"\r\nGETGEO[^\r]*", ""))
answers("control.input.blank-lines", r"^\r\n\r\n", "ERROR")
heard("control.input.glued", (r"\}DRIVE[^\r]*", "}"))
deaf("control.input.outer-blanks", r" \t ")

# The grammar of commands.

deaf("control.grammar.case", r"\{TYPE")
answers("control.grammar.unknown-command", "HELLO", "ERROR {Reason unknown command}")
heard("control.grammar.bare-name", (r"\{Bad\}[^\r]*", "{Bad}"))
heard("control.grammar.first-wins", (r"\{Type Robot\} (\{Type NoSuch)", r"\1"))
deaf("control.grammar.open-brace", r" \{Name(?=\r)")
heard("control.grammar.booleans", (r"\{Light (?:True|TRUE|1)\}", "{Light maybe}"))
heard("control.grammar.numbers", (r"((?:Left|Right) \d+),\d+", r"\1"))
heard("control.grammar.number-junk", (r"(Left|Right) [\d.]+abc", r"\1 0"))
said(
    "control.grammar.not-finite",
    (r"(\{Type GroundTruth\}.*\{Location )[-\d.]+", r"\1nan"),
    since="(?i)nan",
)
heard("control.grammar.vector-blanks", (r"\{Location [-\d.]+ [-\d. ]*\}", _FAR % 12))
heard("control.grammar.vector-zeros", (r"\{Location -?0\d[^}]*\}", _FAR % 15))

answers("control.grammar.before-init", "^DRIVE", "ERROR {No robot}")
deaf("control.grammar.inner-blanks", r"\{  Type")
deaf("control.grammar.junk", r"\} junk \{")
deaf("control.grammar.no-blanks", r"GETCONF\{")
heard("control.grammar.no-open-brace", (r"GETCONF Type", "GETCONF {Type"))
deaf("control.grammar.non-ascii", r"\xe9")
hangs_up("control.grammar.nul", r"\x00")
hangs_up("control.grammar.old-commands", "TRACE")
heard("control.grammar.short-numbers", (r"(Left|Right) \.9", r"\1 9"))
deaf("control.grammar.stray-brace", r"GETCONF \}")
deaf("control.grammar.tabs", r"\t")
deaf("control.grammar.unknown-segment", "Colour")
deaf("control.grammar.value-case", "rObOt")
heard("control.grammar.vector-comma-blank", (r"\{Location  [^}]*\}", _FAR % 0))
heard("control.grammar.vector-commas", (r"\{Location [^}]*\}", _FAR % 3))
heard("control.grammar.vector-decimal-comma", (r"\{Location [^}]*\}", _FAR % 6))
deaf("control.grammar.vector-six", "0,0000, 0,0000")
heard("control.grammar.vector-two", (r"\{Location [^}]*\}", _FAR % 9))

# INIT.

deaf("control.init.case", "Init ")
deaf("control.init.spawns", "INIT")
answers("control.init.silent", "INIT", "RES {Time 0.00} {Type Robot} {Status OK}")
said("control.init.quiet-period", axis("Time", 0, lambda time: time - 5.0))
said("control.init.prompt", axis("Time", 0, lambda time: time + 3.0))
hangs_up("control.init.unknown-class", "NoSuchRobotAtAll")
deaf("control.init.no-package", r"ClassName (?!USARBot\.)")
deaf("control.init.class-case", "usarBOT")
deaf("control.init.no-name", r"INIT (?![^\r]*\{Name)")
heard("control.init.start", (r"\{Start rOBOT[^}]*\} ", ""))
heard("control.init.battery", (r" \{Battery 300\}", ""))
said("control.init.start-poses-count", (r"StartPoses \d+", "StartPoses 3"))
heard("control.init.location", axis("Location", 0, lambda x: x + 0.3))

deaf("control.init.classname", r"\{Classname")
answers("control.init.closest-node", "GETCLOSESTPATHNODE", "NFO {PathNode N 0,0,0}", dialect=UDK)
deaf("control.init.extras", "Team 255")
deaf("control.init.glued", r"INIT\{")
deaf("control.init.name-with-blanks", "the first")
deaf("control.init.no-place", r"INIT (?![^\r]*(?:Location|Start))")
deaf("control.init.order", r"INIT \{(?!ClassName)")
deaf("control.init.package", r"ClassName USARBot\.")
said("control.init.path-nodes", (r"PathNodes \d+", "PathNodes 99"), dialect=UDK)
deaf("control.init.start-poses", "GETSTARTPOSES")
said("control.init.start-poses-form", (r"(StartPoses \d+\} \{\S+ [-\d.]+),", r"\1, "))
deaf("control.init.unknown-start", "NoSuchStart")


@wire_fault("control.init.same-name")
class NamesOnce(Link):
    """Passes over an INIT with a name that was taken."""

    def heard(self, data: bytes) -> bytes:
        found = re.search(rb"INIT.*\{Name ([^}]*)\}", data)
        if found is None:
            return data
        taken = self.memory.setdefault("taken", set())
        if found[1] in taken:
            return b""
        taken.add(found[1])
        return data


wire_fault("control.connection.again")(NamesOnce)


@wire_fault("control.init.second")
class SecondRobot(Link):
    """Who sends INIT again is told of a robot elsewhere."""

    inits = 0

    def heard(self, data: bytes) -> bytes:
        self.inits += data.startswith(b"INIT")
        return data

    def said(self, unit: bytes) -> bytes:
        return unit if self.inits < 2 else re.sub(rb"(\{Location )-?\d+", rb"\g<1>77", unit)


# How a dialect is chosen.

heard("control.dialect.classname", ("Classname", "ClassName"))
deaf("control.dialect.actuator", "Type Actuator")

heard("control.dialect.default", (r"(INIT [^\r]*)", r"\1 {Dialect udk}"))
heard("control.dialect.forced", (r" \{Dialect \w+\}", ""))
heard("control.dialect.side-by-side", (r"\{Dialect udk\}", "{Dialect ut2004}"))

# Requests.

said("control.conf.robot", (r"(CONF .*SteeringType.*\r\n)", r"\1\1"))
said("control.geo.robot", (r"(GEO .*WheelRadius.*\r\n)", r"\1\1"))
said("control.conf.both-names", (r"CONF \{Type Actuator\}.*\r\n", ""))
said("control.conf.next-line", (r"(CONF \{Type Actuator\})", "NFO {Status Ready}\r\n" r"\1"))

answers("control.conf.no-match", "NoSuchType", "CONF {Type NoSuchType}")
heard("control.conf.named-item", (r"(GETCONF \{Type \w+\}) \{Name [^}]*\}", r"\1"))

# SET and CONTROL.

deaf("control.set.odometry-reset", "Opcode RESET")
deaf("control.set.ins-pose", "Opcode POSE")
said("control.set.result", (r"^RES .*\r\n", ""))
_RESULT = "RES {Time 1.00} {Type Odometry} {Name Odometry} {Status OK}"
answers("control.set.no-result-udk", "Opcode", _RESULT, dialect=UDK)

said("control.set.releaser", (r"\{status OK\}", "{Status OK}"))
said("control.set.rfid", ("Mem two words", "Mem two"))
deaf("control.set.scan", "Opcode SCAN")
deaf("control.set.trailing-blank", r"RESET\} \r")
hangs_up("control.set.unknown", "Opcode Explode")
hangs_up("control.set.viewports", "Viewports")
deaf("control.set.zoom", r"\{0\.5\}")
said("control.set.zoom-limits", (r"CameraFov [\d.]+", "CameraFov 1.0000"))
said("control.world.form", (r" \{Memory red\}", ""))
deaf("control.world.kill-all", "KillAll")
deaf("control.world.moves", "RelMove")
answers("control.world.no-controller", "GetSTA", "STA {Name x} {Size 1.0,1.0,1.0}")
heard(
    "control.world.same-name",
    (r"\{Type Create\} \{ClassName Box\} (\{Name \S+\} \{Location 9)", r"{Type AbsMove} \1"),
)
answers("control.world.silent", "Type Kill", "STA {Killed 1}")

# Coming, leaving, and what is too much.


wire_fault("control.connection.leaves")(KeepsLeavers)
wire_fault("control.world.cleans-up")(KeepsLeavers)
wire_fault("control.connection.half-close")(IgnoresHalfClose)


@wire_fault("control.connection.crowd")
class FewConnections(Link):
    """Hangs up on the seventeenth."""

    most = 16


wire_fault("control.connection.come-and-go")(DiesOfHangup)
wire_fault("control.robust.reset-reader")(DiesOfHangup)
wire_fault("control.robust.torn-command")(DiesOfHangup)

hangs_up("control.robust.endless-line", r"^(?:DRIVE \{Left 9){1000}")
dies("control.robust.far-away", "1e30")
hangs_up("control.robust.flood", r"(?:DRIVE[^\n]*\n){50}")
hangs_up("control.robust.init-flood", r"(?:INIT[^\n]*\n){50}")
said(
    "control.robust.late-reader", (r"(\{Type RangeScanner\}.*) \{Range .*\r\n", r"\1")
)  # lines without their end, glued to the next
hangs_up("control.robust.long-names", "n{2000}")
deaf("control.robust.many-segments", r"(?:\{A 1\}){500}")
hangs_up("control.robust.near-misses", r"(?:[^\n]*\n){350}")
hangs_up("control.robust.garbage", r"[\x80-\xff]")
deaf("control.robust.long-line", "x{4096}")
tires("control.robust.request-flood", b"GETGEO {Type Robot}")


@wire_fault("control.robust.slow-reader")
class WaitsForReaders(Link):
    """While somebody does not read, nobody else is heard."""

    def heard(self, data: bytes) -> bytes:
        if b"GETGEO {Type Sonar}" in data:
            self.memory["awaited"] = self
        return data if self.memory.get("awaited", self) is self else b""


@wire_fault("control.robust.isolated")
class TellsEverybody(Link):
    """Everybody gets the CONF that one has asked for."""

    def begin(self) -> None:
        self.memory.setdefault("all", []).append(self)

    def said(self, unit: bytes) -> bytes:
        if unit.startswith(b"CONF"):
            for one in self.memory["all"]:
                if one is not self:
                    one.say(unit)
        return unit
