"""Faults in what robots do when they are told to: wheels, cars, aircraft, arms, legs."""

from __future__ import annotations

import re

from usarsim_conformance.mutants.fault_proxy import Link
from usarsim_conformance.mutants.wire_faults import deaf, heard, said, wire_fault

UDK = "udk"

# Wheels.

_LEFT_BACK = r"\{Left -([\d.]+)\} \{Right ([\d.]+)\}"
heard("control.motion.anticlockwise", (_LEFT_BACK, r"{Left \1} {Right -\2}"))
heard("control.motion.back", (r"\{Left -([\d.]+)\} \{Right -", r"{Left \1} {Right "))
heard("control.motion.flip", (r"\{Flip True\}", "{Left 3} {Right 3}"))
heard("control.motion.in-place", (r"(\{Left [\d.]+\} \{Right )-", r"\1"))
heard("control.motion.normalized-sticky", (r" \{Normalized true\}", ""), dialect=UDK)
heard(
    "control.motion.one-side-udk", (r"(DRIVE \{Left [\d.]+\})\r", r"\1 {Right 0}" "\r"), dialect=UDK
)
heard("control.motion.order", (r"DRIVE \{Left 0\} \{Right 0\}\r\n", ""))
deaf("control.motion.segments-of-all", "RotationalVelocity")
said(
    "control.motion.turn-rate", (r"WheelSeparation [\d.]+", "WheelSeparation 0.1000"), robot="P2DX"
)
deaf("control.motion.unknown-name", "Name robot_0")
deaf("control.motion.wheel-by-wheel", "WheelNumber")

# Cars and aircraft.

heard(
    "control.ackerman.all-three",
    (r"(DRIVE \{Speed 2\})\r", r"\1 {FrontSteer 0} {RearSteer 0}" "\r"),
    dialect=UDK,
)
heard("control.ackerman.drives", (r"Speed 2", "Speed 0"))
deaf("control.ackerman.speed-alone", r"DRIVE \{Speed 2\}\r")
said("control.ackerman.steer-limits", (r"FrontSteer -?[\d.]+", "FrontSteer 9.0000"))
heard("control.aerial.climbs", (r"AltitudeVelocity 1", "AltitudeVelocity 0"))
heard("control.aerial.forward", (r"LinearVelocity 0\.6", "LinearVelocity -0.6"))
heard("control.aerial.hovers", (r"AltitudeVelocity 0\.0", "AltitudeVelocity 0.5"))
heard("control.aerial.right", (r"LateralVelocity 0\.6", "LateralVelocity -0.6"))
heard("control.aerial.turns", (r"RotationalVelocity 0\.8", "RotationalVelocity -0.8"))

# Arms, flippers, legs.

heard("control.arm.act", (r"\{Link 0\}", "{Link 1}"), dialect=UDK)
heard("control.arm.gripper", ("Opcode OPEN", "Opcode CLOSE"), dialect=UDK)
said("control.arm.limits", (r"MaxValue [-\d.]+", "MaxValue 0.1000"))
said("control.arm.links", (r"(MISSTA .*?)\{Link 1\}", r"\1{Link 0}"))
heard("control.arm.mispkg", (r"\{Link 1\}", "{Link 2}"))
deaf("control.arm.out-of-range", r"\{Link 99\}")
deaf("control.flippers.multidrive", "FLflipper")
deaf("control.legged.joints", r"\{Type Joint\}")


# Trips and walks.

heard("control.avatar.appends", ("Action Append", "Action New"))
said(
    "control.motion.upright",
    (r"(\{Type GroundTruth\}.*\{Orientation )[-\d.]+,", r"\g<1>0.20,"),
)


@wire_fault("control.underwater.depth")
class Sinks(Link):
    """Every GroundTruth is a little deeper than the one before."""

    told = 0

    def said(self, unit: bytes) -> bytes:
        return re.sub(
            rb"(\{Type GroundTruth\}.*\{Location [-\d.]+,[-\d.]+,)([-\d.]+)", self._deeper, unit
        )

    def _deeper(self, found: re.Match[bytes]) -> bytes:
        self.told += 1
        return found[1] + b"%.2f" % (float(found[2]) + 0.05 * self.told)


class Slides(Link):
    """A robot that should stay is somewhere else after a DRIVE."""

    def heard(self, data: bytes) -> bytes:
        self.memory["driven"] = self.memory.get("driven") or data.startswith(b"DRIVE")
        return data

    def said(self, unit: bytes) -> bytes:
        if not self.memory.get("driven"):
            return unit
        return re.sub(rb"(\{Location )-?\d+", rb"\g<1>20", unit)


wire_fault("control.legged.no-drive")(Slides)
wire_fault("control.underwater.stays")(Slides)
