"""Faults in what a server of the control port tells: CONF, GEO, STA, SEN, digits, frames."""

from __future__ import annotations

import re

from usarsim_conformance.mutants.fault_proxy import Link
from usarsim_conformance.mutants.wire_faults import heard, said, wire_fault

UDK, GAZEBO = "udk", "gazebo"
_GLUED = (r"\} \{", "}{")
"""Makes the form of the Gazebo prototype, as far as its checks look, out of another."""
_LONG = "x" * 2000

# CONF and GEO.

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
heard("control.frames.up", (r"\{Location ([^,]*,[^,]*),(?=\d)", r"{Location \1,-"), dialect=GAZEBO)
said("control.numbers.triples", (r"(Orientation [-\d.]+,[-\d.]+),[-\d.]+", r"\1"))
said("control.time.advances", (r"SEN \{Time ", "SEN {Time 9"))

# STA.

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

said(
    "control.sensors.camera-silent",
    (r"(STA .*\r\n)", r"\1" "SEN {Type Camera} {Name Camera}\r\n"),
)
said("control.sensors.climb", ("relativeAltitude ", "relativeAltitude -"))
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


@wire_fault("control.sensors.scan-left-first", dialect=GAZEBO)
class RightFirst(Link):
    """Scans that begin on the other side; robots below the ground are put above it."""

    def said(self, unit: bytes) -> bytes:
        return re.sub(rb"\{Range ([^}]*)\}", self._reversed, unit)

    @staticmethod
    def _reversed(found: re.Match[bytes]) -> bytes:
        return b"{Range " + b",".join(found[1].split(b",")[::-1]) + b"}"

    def heard(self, data: bytes) -> bytes:
        return re.sub(rb"\{Location ([^,]*,[^,]*),(?=\d)", rb"{Location \1,-", data)
