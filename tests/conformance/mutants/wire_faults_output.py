"""Faults in what a server of the control port tells: CONF, GEO, STA, SEN, digits, frames."""

from __future__ import annotations

import math
import re

from mutants.fault_proxy import Link
from mutants.wire_faults import (
    Found,
    axis,
    heard,
    in_pieces,
    odd,
    said,
    wire_fault,
)

UDK, GAZEBO = "udk", "gazebo"
_GLUED = (r"\} \{", "}{")
"""Makes the form of the Gazebo prototype, as far as its checks look, out of another."""
_LONG = "x" * 2000
_ABOVE = (r"\{Location ([^,]*,[^,]*),(?=\d)", r"{Location \1,-")
"""Robots below the ground are put above it."""

_MOMENT = r"\{Time \d*[05]\.[01]\d*\}"
"""One moment in five seconds."""

# The shape of lines.

said("control.connection.crlf", (r"\r\n", "\n"))
said("control.connection.no-empty-lines", (r"\r\n", "\r\n\r\n"))
said("control.connection.separation", (r"^GEO .*", lambda found: found[0].replace(b"} {", b"}{")))
said("control.connection.blanks", (r"\r\n", " \r\n"))
said("control.connection.braces", (r"^(STA .*)\}", r"\1"))
said("control.connection.heads", ("^SEN", "sen"))
said("control.connection.greeting", (r"^NFO \{Gametype.*\r\n", ""))
said("control.connection.greeting", (r"^NFO \{Gametype[^\r]*", "NFO {StartPoses 0}"))
said("control.connection.greeting-segments", (r" \{TimeLimit [^}]*\}", ""))
said("control.connection.greeting-level", (r"(\{Level [^}]*)", r"\1.LevelInfo0"))
wire_fault("control.connection.whole-lines")(in_pieces(20))


@wire_fault("control.connection.quiet")
class KeepsAlive(Link):
    """Who says nothing is told something."""

    def begin(self) -> None:
        self.say(b"PING\r\n", after=0.05)


# CONF and GEO.

said("control.conf.ground", (r"^CONF (\{Type GroundV\w+\}) (\{Name \w+\})", r"CONF \2 \1"))
said("control.geo.ground", (r" \{WheelRadius[^\r]*", ""))
said("control.conf.class-name", (r"(\{Type GroundVehicle\}) \{Name \w+\}", r"\1 {Name Kit}"))
said("control.conf.every-item", (r"^(?:CONF|GEO) \{Type Touch\}.*\r\n", ""))
said("control.conf.by-type", (r"^(CONF \{Type Sonar\} )(.*?) (\{Name F2\})", "\\1\\2\r\n\\1\\3"))
said(
    "control.conf.canonical",
    (r"^CONF \{Type (?!Gr)(\w+)", lambda found: b"CONF {Type " + found[1].lower()),
)
said(
    "control.geo.sensors-ut2004",
    (
        r"Name (\S+) Location (\S+) Orientation (\S+) Mo",
        r"Name \1} {Location \2} {Orientation \3} {Mo",
    ),
)
said("control.geo.body-frame", (r"^(GEO .*?Location )[-\d.]+", r"\g<1>9.0000"), since=r"1\.57")
said("control.conf.scanner", (r"\{Fov ", "{FOV "))

said(
    "control.conf.actuator", (r"(CONF \{Type Actuator\}.*?)\{Link 1\}", r"\1{Link 0}"), dialect=UDK
)
said("control.conf.aerial", ("Type AerialVehicle", "Type GroundVehicle"))
said("control.conf.camera", (r"CameraDefFov [\d.]+", "CameraDefFov 45.0000"))
said("control.conf.ground-gazebo", _GLUED, ("SteeringType", "Steering"), dialect=GAZEBO)
said("control.conf.numbers", (r"(Mass \d+\.\d)\d+", r"\1"))
said("control.conf.panning", ("Paning", "Panning"))
said("control.conf.plausible", (r"MaxSpeed [\d.]+", "MaxSpeed 0.0000"))
said("control.conf.scanner-agrees", (r"(SEN .*\{Resolution) [\d.]+", r"\1 0.5000"))
said("control.conf.sonar", ("MinRange", "Minrange"))
said("control.conf.steering", ("SkidSteered", "Skid"))
said("control.geo.actuator", ("ParentLink -1", "ParentLink 0"))
said("control.geo.numbers", (r"(WheelRadius \d+\.\d\d)\d\d", r"\1"))
said(
    "control.geo.sensors-udk",
    (r"(\{Location [^}]*\}) (\{Orientation [^}]*\}) (\{Mount)", r"\2 \1 \3"),
    dialect=UDK,
)

# Digits and frames.

said("control.digits.groundtruth", (r"(\{Type GroundTruth\}.*\{Location -?\d+\.\d\d)", r"\g<1>00"))
said("control.numbers.plain", (r"Range 5\.0000", "Range 5.0e+00"))
said("control.numbers.vectors", (r"(\{Pose [-\d.]+),", r"\1, "))
said("control.numbers.booleans", ("Touch False", "Touch false"))
said("control.frames.down", axis("Location", 2, lambda z: -z))
said("control.frames.clockwise", axis("Orientation", 2, lambda yaw: -yaw % math.tau))
said("control.frames.right", axis("Location", 1, lambda y: -y))
said("control.frames.pitch", axis("Orientation", 1, lambda pitch: -pitch % math.tau))
said("control.frames.roll", axis("Orientation", 0, lambda roll: -roll % math.tau))
heard("control.frames.facing", (r"1\.5708", "0.0274"))
said(
    "control.frames.ins-angles",
    axis("Orientation", 2, lambda yaw: math.remainder(yaw, math.tau)),
)
said("control.time.monotonic", (r"^(SEN \{Time \d+\.)[5-9]", r"\g<1>0"))


@wire_fault("control.time.shared")
class OwnClock(Link):
    """Time begins when it is first told on a connection."""

    zero = math.nan

    def said(self, unit: bytes) -> bytes:
        return re.sub(rb"(\{Time )([\d.]+)", self._since, unit)

    def _since(self, found: Found) -> bytes:
        now = float(found[2])
        self.zero = now if math.isnan(self.zero) else self.zero
        return found[1] + b"%.2f" % max(0.0, now - self.zero)


said("control.digits.ins", (r"(\{Type INS\}.*\{Location -?\d+\.\d\d)", r"\g<1>0"))
said("control.digits.odometry", (r"(\{Pose -?\d+\.\d\d)\d\d", r"\1"))
said("control.digits.rangescanner", (r"(\{Range \d+\.\d\d)\d\d", r"\1"))
said("control.digits.sonar", (r"(\{Name F1 Range \d+\.\d)\d+", r"\1"))
said("control.digits.time", (r"(SEN \{Time \d+\.\d\d)\d\d\}", r"\1}"))
said("control.frames.floor", (r"(GEO .*Location [-\d.]+,[-\d.]+),-", r"\1,"))
said("control.frames.truth-angles", (r"(\{Type GroundTruth\}.*,)5\.2\d\}", r"\1-1.00}"))
said(
    "control.frames.truth-angles-udk",
    (r"(\{Type GroundTruth\}.*,)-1\.0\d+\}", r"\g<1>5.283}"),
    dialect=UDK,
)
heard("control.frames.up", _ABOVE, dialect=GAZEBO)
said("control.numbers.triples", (r"(Orientation [-\d.]+,[-\d.]+),[-\d.]+", r"\1"))
said("control.time.advances", (r"SEN \{Time ", "SEN {Time 9"))

# STA.

said("control.status.ground-ut2004", (r"^STA (\{Type \w+\}) (\{Time [^}]*\})", r"STA \2 \1"))
said("control.status.integers", (r"\{Battery (\d+)\}", r"{Battery \1.00}"))
said("control.status.time", (r"^(STA .*)\{Time \d+\.[5-9]\d*\} ", r"\1"))
wire_fault("control.status.rate")(odd(r"^STA .*\r\n", ""))
said("control.status.rate", axis("Time", 0, lambda time: 0.95 * time))
said("control.status.steady", (rf"^STA .*{_MOMENT}.*\r\n", ""))
said("control.status.steady", (rf"^(STA .*{_MOMENT}.*\r\n)", r"\1\1"), dialect=UDK)
heard("control.status.light", (r"\{Light \w+\}", "{Lamp 1}"))
heard("control.status.light-moves-nothing", (r"\{Light true\}", r"\g<0> {Left 2} {Right 2}"))
said(
    "control.status.battery-dead",
    (r"^(STA .*\{Battery 0\}.*\r\n)", "\\1SEN {Type Touch} {Name Touch Touch False}\r\n"),
)

said("control.dialect.steady", (r"(STA .*\{Time \d+\.[0-4].*) \{View -?\d+\}", r"\1"))
said(
    "control.status.aerial",
    (r"STA (\{Type AerialVehicle\}) (\{Time [^}]*\})", r"STA \2 \1"),
)
said("control.status.battery", (r"\{Battery (\d+)\}", r"{Battery -\1}"))
said("control.status.flippers", ("FRFlipper (.*)FLFlipper", r"FLFlipper \1FRFlipper"))
said(
    "control.status.ground-gazebo",
    _GLUED,
    hearing=((r"(INIT [^\r]*)", r"\1 {Dialect udk}"),),
    dialect=GAZEBO,
)
said("control.status.ground-udk", (r"(STA .*\{Time \d+\.\d\d)\d\d", r"\1"), dialect=UDK)
said("control.status.legged", ("LeggedVehicle", "GroundVehicle"), dialect=UDK)
said("control.status.type", (r"STA \{Type GroundVehicle\} ", "STA "))

# SEN.

said("control.sensors.timed", (r"SEN \{Time [^}]*\} (\{Type Sonar)", r"SEN \1"))
said("control.sensors.untimed", (r"^SEN \{Type", "SEN {Time 1.0000} {Type"))
said("control.sensors.timed-udk", (r"^SEN \{Time [^}]*\}", "SEN"), dialect=UDK)
said("control.sensors.order", (r"^SEN (\{Type Odometry\}) (\{Name \w+\})", r"SEN \2 \1"))
said("control.sensors.named", (r"(\{Type INS\}) \{Name \w+\}", r"\1"))
said(
    "control.sensors.batched", (r"^(SEN .*\{Type Sonar\}) (\{Name F1 \S+ \S+) ", "\\1 \\2\r\n\\1 ")
)
said(
    "control.sensors.single",
    (
        r"(\{Type Sonar\}) \{Name (\w+)\} \{Range (\S+)\}",
        r"\1 {Name \2 Range \3} {Name Z Range \3}",
    ),
    dialect=UDK,
)
said("control.sensors.scan-count", (r"(\{Type RangeScanner\}.*\{Range )([^}]*)", r"\1\2,\2"))
said("control.sensors.scan-order", (r"\{FOV ", "{Fov "))
said("control.sensors.scan-numbers", (r"\{Range .*", lambda found: found[0].replace(b",", b" ")))
said("control.sensors.scan-miss", (r",20\.0000", ",99.0000"))
said("control.sensors.encoder-forward", (r"Tick (\d)", r"Tick -\1"))
said("control.sensors.odometry-clockwise", axis("Pose", 2, lambda theta: -theta))
said("control.sensors.odometry-start", axis("Pose", 0, lambda x: x + 7.0))
said("control.sensors.interval", (rf"^SEN {_MOMENT} \{{Type RangeScanner\}}.*\r\n", ""))
wire_fault("control.sensors.interval")(odd(r"^SEN \{Type Odometry\}.*\r\n", "", 31))

said(
    "control.sensors.camera-silent",
    (r"(STA .*\r\n)", r"\1" "SEN {Type Camera} {Name Camera}\r\n"),
)
said("control.sensors.climb", ("relativeAltitude ", "relativeAltitude -"), dialect=UDK)
said("control.sensors.encoder-integers", (r"(Tick -?\d+)", r"\1.0"))
said("control.sensors.encoder-names-udk", (r"\{Name W(\d)", r"{Name EC\1"), dialect=UDK)
said("control.sensors.gps", (r"(Latitude \d+,\d+\.\d\d)\d\d", r"\1"))
_SWAPPED = r"(\{Location [^}]*\}) (\{Orientation [^}]*\})"
said("control.sensors.ground-truth", (rf"(\{{Type GroundTruth\}}.*){_SWAPPED}", r"\1\3 \2"))
said("control.sensors.ins", (rf"(\{{Type INS\}}.*){_SWAPPED}", r"\1\3 \2"))
said("control.sensors.ins-agrees", (r"(\{Type INS\}.*\{Location )-?\d+", r"\g<1>99"))
said("control.sensors.ins-untimed", (r"SEN \{Type INS\}", "SEN {Time 1.0000} {Type INS}"))
said("control.sensors.keys", (r"\{Name F1 Range", "{Name F1 Distance"))
said("control.sensors.odometry-forward", (r"\{Pose (?=\d)", "{Pose -"))
said("control.sensors.scan-length", (r"\{Range ", f"{{Comment {_LONG}}} {{Range "))
said("control.sensors.short", (r"(SEN \{Type Odometry\}.*)\r\n", rf"\1 {{Comment {_LONG}}}" "\r\n"))
said("control.sensors.sixteen", (r" \{Name R8 [^}]*\}", ""))
said("control.sensors.sonar-range", (r"\{Name F1 Range [\d.]+", "{Name F1 Range 99.0000"))
said("control.sensors.tachometer", (r"(\{Vel [^}]*\}) (\{Pos [^}]*\})", r"\2 \1"), robot="P3AT")
said("control.sensors.touch", ("Touch False", "Touch 0"))
said("control.sensors.victims", ("Status NoVictims", "Status None"), robot="RescueP2AT")


def _from_behind(found: Found) -> bytes:
    return b"{Range " + b",".join(found[1].split(b",")[::-1]) + b"}"


_REVERSED = r"\{Range ([^}]*)\}", _from_behind
said("control.sensors.scan-right-first", _REVERSED)
said("control.sensors.scan-left-first", _REVERSED, hearing=(_ABOVE,), dialect=GAZEBO)
