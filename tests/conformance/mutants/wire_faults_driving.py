"""Faults in what robots do when they are told to: wheels, cars, aircraft, arms, legs."""

from __future__ import annotations

import re

from mutants.fault_proxy import Link
from mutants.wire_faults import deaf, heard, said, wire_fault

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

heard("control.motion.forward", (r"(Left|Right) (?=[\d.])", r"\1 -"))
heard("control.motion.clockwise", (r"\{Left ([^}]*)\} \{Right ([^}]*)\}", r"{Left \2} {Right \1}"))
deaf("control.motion.stops", r"\{Left -?0\.0000\} \{Right -?0\.0000\}")
said("control.motion.speed", (r"WheelRadius [\d.]+", "WheelRadius 0.1950"))
said("control.motion.clamped", (r"MaxSpeed [\d.]+", "MaxSpeed 2.0000"))
heard("control.motion.normalized", (r" \{Normalized \w+\}", ""))
heard("control.motion.normalized-once", (r"(\{Right [\d.]+\})\r", r"\1 {Normalized true}" "\r"))
heard("control.motion.one-side", (r"DRIVE \{(?:Left|Right) [\d.]+\}\r", "DRIVE {Light true}\r"))
deaf("control.motion.flip-over", "Flip")


@wire_fault("control.motion.persists")
class Watchdog(Link):
    """A robot stops some time after its last command."""

    told = 0

    def heard(self, data: bytes) -> bytes:
        self.told = 0 if b"DRIVE" in data else self.told
        return data

    def said(self, unit: bytes) -> bytes:
        self.told += unit.startswith(b"STA")
        if self.told == 13:
            self.ask(b"DRIVE {Left 0} {Right 0}\r\n")
        return unit


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


class Creeps(Link):
    """Every GroundTruth is a little further ahead than the one before."""

    axes = rb""
    told = 0

    def said(self, unit: bytes) -> bytes:
        pattern = rb"(\{Type GroundTruth\}.*\{Location " + self.axes + rb")([-\d.]+)"
        return re.sub(pattern, self._further, unit)

    def _further(self, found: re.Match[bytes]) -> bytes:
        self.told += 1
        return found[1] + b"%.2f" % (float(found[2]) + 0.05 * self.told)


@wire_fault("control.underwater.depth")
class Sinks(Creeps):
    """Every GroundTruth is a little deeper than the one before."""

    axes = rb"[-\d.]+,[-\d.]+,"


wire_fault("control.motion.rests")(Creeps)
for _check in ("control.legged.no-drive", "control.underwater.stays"):
    said(_check, (r"(\{Location )-?\d+", r"\g<1>20"), since="DRIVE")
