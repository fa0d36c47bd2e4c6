"""How kinds of robots are told to move: bytes for the wire of what an operator's hands say."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from usarsim_client import commands
from usarsim_client.commands import say
from usarsim_client.reports import VehicleConfiguration

_BY_CLASS = {
    "aerial": ("airrobot", "ardrone", "quadrotor", "passarola"),
    "car": ("hummer", "sedan", "snowstorm", "frontackerman", "basicackermanrobot", "cooper"),
    "underwater": ("submarine",),
    "legged": ("nao", "qrio", "ers"),
    "fixed": ("kr60", "kr3", "kr5", "kr6", "comstation", "fanucm16", "twolink", "kuka_lwr_bot"),
}
"""Kinds of well-known classes, for robots of which no description can be asked."""

_BY_STEERING = {
    "ackermansteered": "car",
    "rotarywing": "aerial",
    "aerial": "aerial",
    "nautic": "underwater",
}
_STEER = math.radians(35.0)  # of a car that tells no greatest steering angle


@dataclass(frozen=True, slots=True)
class Motion:
    """How one robot is moved.

    Attributes:
        kind: ground, car, aerial, underwater, legged or fixed.
        steer: greatest steering angle of a car, rad.
    """

    kind: str
    steer: float = _STEER

    @property
    def stop(self) -> bytes:
        """Stand, or hover."""
        match self.kind:
            case "car":
                return commands.drive(None, None, 0.0, 0.0, 0.0, False)
            case "aerial":
                return self.fly(0.0, 0.0, 0.0, 0.0)
            case "underwater":
                return say("DRIVE", Propeller=0.0, Rudder=0.0, SternPlane=0.0)
            case _:
                return self.drive(0.0, 0.0)

    def drive(self, left: float, right: float) -> bytes:
        """Wheel powers, -1 to 1; cars turn them into speed and steering."""
        if self.kind == "car":
            return self.turn((left + right) / 2.0, (left - right) / 2.0)
        return commands.drive(left, right, None, None, None, True)

    def turn(self, speed: float, steer: float) -> bytes:
        """Speed and steering, -1 to 1, right positive; others than cars turn by their wheels."""
        if self.kind != "car":
            left, right = speed + steer, speed - steer
            most = max(1.0, abs(left), abs(right))
            return self.drive(left / most, right / most)
        return commands.drive(None, None, speed, steer * self.steer, 0.0, True)

    def spin(self, power: float) -> bytes:
        """Turn on the spot, -1 to 1, clockwise positive."""
        if self.kind == "aerial":
            return self.fly(0.0, 0.0, 0.0, power)
        return self.drive(power, -power)

    def ahead(self, power: float) -> bytes:
        """Move straight on, -1 to 1."""
        if self.kind == "aerial":
            return self.fly(0.0, power, 0.0, 0.0)
        return self.turn(power, 0.0)

    def fly(self, altitude: float, linear: float, lateral: float, rotational: float) -> bytes:
        """Parts of the greatest velocities, -1 to 1: up, forward, right, clockwise."""
        return say(
            "DRIVE",
            AltitudeVelocity=altitude * 100.0,
            LinearVelocity=linear * 100.0,
            LateralVelocity=lateral * 100.0,
            RotationalVelocity=rotational * 100.0,
            Normalized=True,
        )


def by_class(class_name: str) -> Motion:
    """How a robot of a class is moved of which nothing else is known."""
    name = class_name.rpartition(".")[2].lower()
    return Motion(next((kind for kind, names in _BY_CLASS.items() if name in names), "ground"))


def by_description(class_name: str, vehicle: VehicleConfiguration) -> Motion:
    """How a robot is moved that has told what it is."""
    told = vehicle.steering.replace(" ", "").lower()
    guess = by_class(class_name)
    kind = _BY_STEERING.get(told, guess.kind)
    if vehicle.type.lower().startswith("aerial"):
        kind = "aerial"
    steer = vehicle.max_front_steer
    found = replace(guess, kind=kind)
    if math.isfinite(steer) and steer > 0.0:
        found = replace(found, steer=steer)
    return found
