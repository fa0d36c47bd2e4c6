"""What a client says, as bytes; nothing is sent here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral, Real

from usarsim_client.inbox import command
from usarsim_server.protocol.values import Vector


def say(word: str, *more: str, **segments: object) -> bytes:
    """A command as bytes, line end included.

    Args:
        word: of the command.
        more: segments behind the others, as `segment` writes them.
        segments: key and value; those whose value is None are left out.

    Raises:
        ValueError: if a value cannot be said: a number that is not finite, a text with braces,
            line ends or characters beyond Latin-1.
    """
    parts = [segment(key, value) for key, value in segments.items() if value is not None]
    return command(" ".join((word, *parts, *more)))


def segment(key: str, value: object) -> str:
    """`{Key value}`; numbers without exponent, vectors with commas, booleans in lower case, which
    is the only spelling that UDK takes for true."""
    text = f"{key} {_text(value)}".rstrip(" ")
    if any(one in text for one in "{}\r\n"):
        raise ValueError(f"a segment holds no braces and no line ends: {text!r}")
    return f"{{{text}}}"


def _text(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return value
        case Integral():
            return str(int(value))
        case Real():  # also those of numpy
            if not math.isfinite(value):
                raise ValueError(f"a command holds finite numbers only, not {value}")
            return f"{float(value):.6f}"
        case Iterable():
            return ",".join(_text(float(part)) for part in value)
        case _:
            raise TypeError(f"cannot be said: {value!r}")


def init(
    class_name: str,
    name: str | None,
    start: str | None,
    location: Vector | None,
    rotation: Vector | None,
    more: Mapping[str, object],
) -> bytes:
    """INIT of a robot, a world controller, an avatar.

    It says `ExactName`: a server that knows the segment alters no name, and tells why it refuses.

    Args:
        class_name: `USARBot.` is put before one without a package.
        name: of the robot; the server invents one without.
        start: tag of a start pose; without one location (m) and rotation (rad) count.
        location, rotation: see there; the origin without any.
        more: further segments, as Battery or Team.

    Raises:
        ValueError: as `say`; if both a start pose and a location are given.
    """
    if start is not None and (location is not None or rotation is not None):
        raise ValueError("a robot begins at a start pose or at a location, not at both")
    qualified = class_name if "." in class_name else f"USARBot.{class_name}"
    if start is None and location is None:
        location = (0.0, 0.0, 0.0)
    places = {"Name": name, "Start": start, "Location": location, "Rotation": rotation}
    return say("INIT", ClassName=qualified, **places, **{**more, "ExactName": True})


def drive(
    left: float | None,
    right: float | None,
    speed: float | None,
    front_steer: float | None,
    rear_steer: float | None,
    normalized: bool,
) -> bytes:
    """DRIVE of ground robots: all members of a form, since UDK ignores an incomplete one.

    Raises:
        ValueError: if the members are of no form, or of both.
    """
    sides = left is not None or right is not None
    axles = speed is not None or front_steer is not None or rear_steer is not None
    if sides == axles:
        raise ValueError("drive with left and right, or with speed, front_steer and rear_steer")
    unit = 100.0 if normalized else 1.0
    if sides:
        if left is None or right is None:
            raise ValueError("drive with both left and right; UDK ignores one alone")
        return say("DRIVE", Left=left * unit, Right=right * unit, Normalized=normalized)
    if speed is None:
        raise ValueError("drive with a speed beside front_steer and rear_steer")
    steering = {"FrontSteer": float(front_steer or 0.0), "RearSteer": float(rear_steer or 0.0)}
    return say("DRIVE", Speed=speed * unit, **steering, Normalized=normalized)


def wheels(targets: Mapping[int, tuple[float | None, float | None]], normalized: bool) -> bytes:
    """DRIVE wheel by wheel: speed and steering angle, either may be None, by wheel from 0."""
    groups = []
    for wheel, (speed, steer) in targets.items():
        groups.append(segment("WheelNumber", wheel))
        if speed is not None:
            groups.append(segment("WheelSpeed", speed * (100.0 if normalized else 1.0)))
        if steer is not None:
            groups.append(segment("WheelSteer", float(steer)))
    return say("DRIVE", *groups, segment("Normalized", normalized))


def links(package: str, targets: Mapping[int, float], order: int) -> bytes:
    """MISPKG with Link, Value and Order in a row, the form that all generations obey."""
    groups = []
    for link, value in targets.items():
        groups += [segment("Link", link), segment("Value", float(value)), segment("Order", order)]
    return say("MISPKG", *groups, Name=package)


def way_points(name: str, points: Sequence[Vector]) -> bytes:
    """CONTROL AddWP."""
    return say("CONTROL", Type="AddWP", Name=name, WP=";".join(map(_text, points)))
