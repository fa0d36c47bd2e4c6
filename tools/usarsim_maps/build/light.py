"""Light: what MuJoCo and the cameras can make of the lamps of a map.

OpenGL as MuJoCo uses it computes light at the corners of triangles, and in between goes from one
to the other. A floor of two triangles has its corners far from the lamp above its middle: it would
stay dark. So large faces are cut small where lamps shine on them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from usarsim_maps.build.sheet import NameBook
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Array, Light, LightKind
from usarsim_server.simulation.frames import Vector

STEPS = 6
"""Pieces from a lamp to its reach."""

SHORTEST_LIGHT, LONGEST = 0.25, 2.0
"""m: size of a piece."""

THIN = 1e-3
"""m: a cut this near to a corner is not made."""


MAX_LAMPS = 7
"""OpenGL's fixed lights are eight, and the headlight is one of them."""

SHORTEST = 0.1
"""m that a lamp shines at least."""

FADING = 5.0
"""Lamps fade as 1 / (1 + FADING (d / reach)^2). Unreal's own law is about (1 - (d / reach)^2)^2,
which has no such form; this one stays within 0.18 of it, and no other does better."""

STRENGTH = 0.8
"""Of a lamp of brightness 1, in MuJoCo's measure: the server's headlight adds to it."""

BRIGHTEST = 1.2
"""What all lamps may add up to at the place of one of them; screens know no more than white."""

ALL_AROUND: dict[str, object] = {"type": "spot", "cutoff": 180.0, "exponent": 0.0}
"""A lamp that shines everywhere: MuJoCo knows point lights, but its OpenGL leaves them dark."""

PARALLEL = 0.9999
"""Cosine between suns that are one."""


@dataclass(frozen=True, slots=True)
class Glow:
    """Where a lamp is, and how far (m) it shines."""

    position: Vector
    reach: float


def cut_for_light(points: Array, glows: Sequence[Glow]) -> list[Array]:
    """Convex pieces of a flat convex face: small ones where a lamp lights it, else the face itself.

    Cuts lie on a grid of the world for each lamp that fades, so that faces that meet are cut at the
    same places. The points (k, 3), m, run counter-clockwise as seen from outside.
    """
    pieces = [points]
    low, high = points.min(axis=0), points.max(axis=0)
    for glow in glows:
        if not _lit(points, low, high, glow):
            continue
        step = min(LONGEST, max(SHORTEST_LIGHT, glow.reach / STEPS))
        for axis in range(3):
            first = max(low[axis], glow.position[axis] - glow.reach)
            last = min(high[axis], glow.position[axis] + glow.reach)
            for number in range(math.ceil(first / step), math.floor(last / step) + 1):
                pieces = [part for piece in pieces for part in _halves(piece, axis, number * step)]
    return pieces


def _lit(points: Array, low: Array, high: Array, glow: Glow) -> bool:
    """Whether a lamp is before a face and within reach of it."""
    place = np.array(glow.position)
    if float(np.linalg.norm(place - np.clip(place, low, high))) > glow.reach:
        return False
    normal = np.zeros(3)
    for p, q in itertools.pairwise(points[1:]):
        normal += np.cross(p - points[0], q - points[0])
    return bool(normal @ (place - points[0]) > 0.0)


def _halves(points: Array, axis: int, at: float) -> list[Array]:
    """The two parts of a convex polygon on either side of a plane, or the whole one."""
    heights = points[:, axis] - at
    if heights.min() > -THIN or heights.max() < THIN:
        return [points]
    below: list[Array] = []
    above: list[Array] = []
    following = np.roll(points, -1, axis=0)
    for p, q, here, there in zip(points, following, heights, np.roll(heights, -1), strict=True):
        if here <= 0.0:
            below.append(p)
        if here >= 0.0:
            above.append(p)
        if (here < 0.0 < there) or (there < 0.0 < here):
            # Always from below to above: neighbours get the same corner, bit for bit.
            a, b, u, v = (p, q, here, there) if here < there else (q, p, there, here)
            middle = a + (b - a) * (u / (u - v))
            middle[axis] = at
            below.append(middle)
            above.append(middle)
    return [np.array(part) for part in (below, above) if len(part) >= 3]


def chosen_lights(lights: Sequence[Light], findings: Findings) -> list[Light]:
    """Those that shine: the brightest and widest ones if there are too many (worlds 76)."""
    shining = [light for light in lights if light.kind is not LightKind.AMBIENT]
    if len(shining) > MAX_LAMPS:
        shining = _with_one_sun_each_way(shining, findings)
    if len(shining) > MAX_LAMPS:
        order = sorted(
            range(len(shining)),
            key=lambda i: (
                shining[i].kind is not LightKind.DIRECTIONAL,
                -shining[i].brightness * (shining[i].reach or 1e6),
                i,
            ),
        )
        kept = sorted(order[:MAX_LAMPS])
        findings.warn(
            "lights",
            f"{len(shining) - MAX_LAMPS} of {len(shining)} lights were left out: cameras know "
            f"{MAX_LAMPS}",
        )
        shining = [shining[i] for i in kept]
    return shining


def lamps(lights: Sequence[Light]) -> list[dict[str, object]]:
    """Attributes of MuJoCo lights for those that `chosen_lights` has left."""
    dim = _dimming(lights)
    book = NameBook()
    return [_lamp(light, book.take(light.name), dim) for light in lights]


def glows(lights: Sequence[Light]) -> list[Glow]:
    """Lamps that fade, near which large faces have to be cut."""
    return [
        Glow(light.position, light.reach)
        for light in lights
        if light.kind is not LightKind.DIRECTIONAL and light.reach > 0.0
    ]


def _with_one_sun_each_way(lights: Sequence[Light], findings: Findings) -> list[Light]:
    """Lights with parallel suns of one colour made one that is as bright as they are together."""
    answer: list[Light] = []
    for light in lights:
        for number, other in enumerate(answer):
            if _same_sun(light, other):
                answer[number] = replace(other, brightness=other.brightness + light.brightness)
                break
        else:
            answer.append(light)
    if len(answer) < len(lights):
        findings.warn(
            "lights", f"{len(lights) - len(answer)} suns were added to others that shine their way"
        )
    return answer


def _same_sun(light: Light, other: Light) -> bool:
    if not light.kind is other.kind is LightKind.DIRECTIONAL or light.color != other.color:
        return False
    pairs = zip(_unit(light.direction), _unit(other.direction), strict=True)
    return sum(a * b for a, b in pairs) > PARALLEL


def _strength(light: Light) -> float:
    return min(1.0, max(0.0, light.brightness)) * STRENGTH


def _dimming(lights: Sequence[Light]) -> float:
    """Factor for all lamps that have a place, so that no place of one is brighter than white."""
    placed = [light for light in lights if light.kind is not LightKind.DIRECTIONAL]
    most = 0.0
    for here in placed:
        sums = [
            _strength(light) / _fading(light, math.dist(light.position, here.position))
            for light in placed
        ]
        most = max(most, sum(sums))
    return min(1.0, BRIGHTEST / most) if most > 0.0 else 1.0


def _fading(light: Light, distance: float) -> float:
    if light.reach <= 0.0:
        return 1.0
    return 1.0 + FADING * (distance / max(light.reach, SHORTEST)) ** 2


def _lamp(light: Light, name: str, dim: float) -> dict[str, object]:
    strength = _strength(light)
    if light.kind is not LightKind.DIRECTIONAL:
        strength *= dim
    values: dict[str, object] = {
        "name": name,
        "pos": light.position,
        "diffuse": tuple(min(1.0, max(0.0, c)) * strength for c in light.color),
        "specular": (0.1, 0.1, 0.1),
        "castshadow": light.shadows,
    }
    if light.kind is LightKind.DIRECTIONAL:
        return {**values, "type": "directional", "dir": _unit(light.direction)}
    if light.reach > 0.0:
        values["attenuation"] = (1.0, 0.0, FADING / max(light.reach, SHORTEST) ** 2)
    if light.kind is LightKind.SPOT:
        cutoff = min(90.0, max(1.0, light.cone))
        return {**values, "type": "spot", "dir": _unit(light.direction), "cutoff": cutoff}
    return {**values, **ALL_AROUND}


def _unit(direction: Vector) -> Vector:
    x, y, z = direction
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length) if length > 1e-9 else (0.0, 0.0, -1.0)
