"""A small writer of MJCF scenes: boxes, wedges, pipes, floors and movable bodies, in metres.

The text is made for reading and for `git diff`: one element per line, a comment per section,
numbers without noise, always the same for the same calls.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from xml.sax.saxutils import quoteattr

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Attributes = dict[str, object]

UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)

PAINT_DEPTH = 0.02
"""Thickness of painted ground below its surface, m."""

_ASSETS = "asset"
_WORLD = "worldbody"
_PLACE = ("mesh", "fromto", "pos")
"""Where a geom is, in the order in which they are written."""


def number(value: float) -> str:
    """Write a number with at most five decimals, without trailing zeros or a negative zero."""
    text = f"{value:.5f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def turned(roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Quaternion:
    """Unit quaternion w x y z of Rz(yaw) Ry(pitch) Rx(roll); angles in degrees, z up."""
    r, p, y = (math.radians(angle) / 2 for angle in (roll, pitch, yaw))
    cr, cp, cy = math.cos(r), math.cos(p), math.cos(y)
    sr, sp, sy = math.sin(r), math.sin(p), math.sin(y)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _text(value: object) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return number(value)
    if isinstance(value, Iterable):
        return " ".join(_text(item) for item in value)
    raise TypeError(f"cannot write {value!r} into MJCF")


def _element(tag: str, attributes: Attributes, *, closed: bool = True) -> str:
    body = "".join(
        f" {name}={quoteattr(_text(value))}"
        for name, value in attributes.items()
        if value is not None
    )
    return f"<{tag}{body}/>" if closed else f"<{tag}{body}>"


@dataclass(slots=True)
class Movable:
    """A body with a free joint, made of primitive pieces given relative to its origin."""

    name: str
    position: Vector
    orientation: Quaternion = UPRIGHT
    geoms: list[str] = field(default_factory=list)

    def box(
        self, center: Vector, size: Vector, material: str, mass: float, quat: Quaternion = UPRIGHT
    ) -> None:
        """Add a box piece: centre, full extents (m) and mass (kg)."""
        self._add("box", center, [edge / 2 for edge in size], material, mass, quat)

    def cylinder(
        self, center: Vector, radius: float, length: float, material: str, mass: float
    ) -> None:
        """Add an upright cylinder piece: centre, radius and full length (m), mass (kg)."""
        self._add("cylinder", center, [radius, length / 2], material, mass, UPRIGHT)

    def _add(
        self,
        kind: str,
        center: Vector,
        size: Sequence[float],
        material: str,
        mass: float,
        quat: Quaternion,
    ) -> None:
        attributes: Attributes = {
            "name": f"{self.name}:{len(self.geoms) + 1}",
            "class": "movable",
            "type": kind,
            "pos": center,
            "quat": None if quat == UPRIGHT else quat,
            "size": size,
            "material": material,
            "mass": mass,
        }
        self.geoms.append(_element("geom", attributes))


class Scene:
    """One MJCF file in the making.

    Args:
        name: model name.
        center: what the overview and the shadows centre on, m.
        extent: radius of the interesting part, m; fixes clip planes and shadow range.
    """

    def __init__(self, name: str, *, center: Vector, extent: float) -> None:
        self.name = name
        self._center = center
        self._extent = extent
        self._lines: dict[str, list[str]] = {_ASSETS: [], _WORLD: []}
        self._used: Counter[str] = Counter()
        self._wedges: set[str] = set()

    # ---- assets ---------------------------------------------------------------------------

    def sky(self, zenith: Vector, horizon: Vector) -> None:
        """Give the scene a sky that fades from the zenith's colour to the horizon's."""
        self._asset(
            "texture",
            name="sky",
            type="skybox",
            builtin="gradient",
            rgb1=zenith,
            rgb2=horizon,
            width=256,
            height=1536,
        )

    def texture(self, name: str, **attributes: object) -> str:
        """Add a built-in texture; returns its name."""
        self._asset("texture", name=name, **attributes)
        return name

    def material(
        self,
        name: str,
        rgba: Sequence[float],
        *,
        texture: str | None = None,
        repeat: tuple[float, float] | None = None,
        uniform: bool = False,
        shine: float = 0.1,
    ) -> str:
        """Add a material named by its substance; returns the name.

        Args:
            name: the substance, which is what radio and sensors judge by.
            rgba: colour and opacity, 0..1; the texture is multiplied by it.
            texture: a texture of this scene.
            repeat: texture repeats, per metre if `uniform`, else per face.
            uniform: scale the texture in metres.
            shine: 0 for dull to 1 for glossy.
        """
        self._asset(
            "material",
            name=name,
            texture=texture,
            texrepeat=repeat,
            texuniform=True if uniform else None,
            rgba=[*rgba, 1.0] if len(rgba) == 3 else rgba,
            specular=shine,
            shininess=shine,
        )
        return name

    def _asset(self, tag: str, **attributes: object) -> None:
        self._lines[_ASSETS].append(_element(tag, attributes))

    # ---- static geometry ------------------------------------------------------------------

    def section(self, title: str) -> None:
        """Start a titled part of the file."""
        self._lines[_WORLD] += ["", f"<!-- {title} -->"]

    def floor(self, material: str, half_x: float = 0.0, half_y: float = 0.0, **at: float) -> None:
        """Add the ground: an endless collision plane, drawn endless or as one rectangle."""
        center = (at.get("x", 0.0), at.get("y", 0.0), 0.0)
        self._geom("floor", "floor", "plane", material, pos=center, size=(half_x, half_y, 1.0))

    def paint(
        self, prefix: str, x: tuple[float, float], y: tuple[float, float], material: str
    ) -> None:
        """Colour a rectangle of the ground: a slab level with it that is never touched."""
        lower, upper = (x[0], y[0], -PAINT_DEPTH), (x[1], y[1], 0.0)
        self.block(prefix, lower, upper, material, role="paint")

    def box(
        self,
        prefix: str,
        center: Vector,
        size: Vector,
        material: str,
        *,
        quat: Quaternion = UPRIGHT,
        role: str = "obstacle",
    ) -> str:
        """Add a static box by centre and full extents; role is `ground` or `obstacle`."""
        half = [edge / 2 for edge in size]
        return self._geom(prefix, role, "box", material, quat, pos=center, size=half)

    def block(
        self, prefix: str, lower: Vector, upper: Vector, material: str, *, role: str = "obstacle"
    ) -> str:
        """Add a static box that is parallel to the axes, by two opposite corners."""
        lo = [min(a, b) for a, b in zip(lower, upper, strict=True)]
        hi = [max(a, b) for a, b in zip(lower, upper, strict=True)]
        x, y, z = ((a + b) / 2 for a, b in zip(lo, hi, strict=True))
        size = tuple(b - a for a, b in zip(lo, hi, strict=True))
        return self.box(prefix, (x, y, z), (size[0], size[1], size[2]), material, role=role)

    def ramp(
        self,
        prefix: str,
        low: tuple[float, float],
        size: tuple[float, float],
        rise: float,
        material: str,
        *,
        yaw: float = 0.0,
    ) -> str:
        """Add a solid wedge that stands on the ground.

        Args:
            prefix: start of the name.
            low: x, y of the middle of the lower edge, m.
            size: length along the slope's horizontal projection, width across it, m.
            rise: height of the upper edge, m.
            material: of all faces.
            yaw: uphill direction, degrees anticlockwise from +x.
        """
        mesh, quat = self._wedge(size[0], size[1], rise), turned(yaw=yaw)
        return self._geom(prefix, "ground", "mesh", material, quat, mesh=mesh, pos=(*low, 0.0))

    def _wedge(self, length: float, width: float, rise: float) -> str:
        name = f"wedge_{number(length)}x{number(width)}x{number(rise)}".replace(".", "p")
        if name not in self._wedges:
            self._wedges.add(name)
            half = width / 2
            corners = [(0.0, 0.0), (length, 0.0), (length, rise)]
            vertices = [c for side in (-half, half) for x, z in corners for c in (x, side, z)]
            self._asset("mesh", name=name, vertex=vertices)
        return name

    def pipe(self, prefix: str, ends: tuple[Vector, Vector], radius: float, material: str) -> str:
        """Add a static cylinder between two points."""
        fromto = (*ends[0], *ends[1])
        return self._geom(prefix, "obstacle", "cylinder", material, fromto=fromto, size=(radius,))

    def _geom(
        self,
        prefix: str,
        role: str,
        kind: str,
        material: str,
        quat: Quaternion = UPRIGHT,
        **place: object,
    ) -> str:
        name = self._name(prefix)
        attributes: Attributes = {"name": name, "class": role, "type": kind}
        for key in _PLACE:
            attributes[key] = place.get(key)
        attributes["quat"] = None if quat == UPRIGHT else quat
        attributes |= {"size": place.get("size"), "material": material}
        self._lines[_WORLD].append(_element("geom", attributes))
        return name

    def _name(self, prefix: str) -> str:
        self._used[prefix] += 1
        return f"{prefix}_{self._used[prefix]}"

    # ---- everything else ------------------------------------------------------------------

    def movable(self, movable: Movable) -> None:
        """Add a body that can be pushed."""
        at: Attributes = {"name": movable.name, "pos": movable.position}
        if movable.orientation != UPRIGHT:
            at["quat"] = movable.orientation
        self._lines[_WORLD] += [
            _element("body", at, closed=False),
            "  " + _element("freejoint", {"name": movable.name}),
            *("  " + geom for geom in movable.geoms),
            "</body>",
        ]

    def sun(self, toward: Vector, strength: float, *, shadow: bool) -> None:
        """Add light from infinitely far away that falls in direction `toward`."""
        self._lines[_WORLD].append(
            _element(
                "light",
                {
                    "name": self._name("light"),
                    "type": "directional",
                    "dir": toward,
                    "pos": tuple(-12.0 * part for part in toward),
                    "castshadow": shadow,
                    "diffuse": (strength, strength, strength),
                    "specular": (0.15 * strength,) * 3,
                },
            )
        )

    def camera(self, name: str, eye: Vector, target: Vector, view_angle: float) -> None:
        """Add a fixed camera that looks from one point to another; angle of view in degrees."""
        forward = [t - e for e, t in zip(eye, target, strict=True)]
        flat = math.hypot(forward[0], forward[1])
        right = (forward[1] / flat, -forward[0] / flat, 0.0)
        length = math.hypot(*forward)
        fx, fy, fz = (part / length for part in forward)
        up = (-fz * fx * length / flat, -fz * fy * length / flat, flat / length)
        self._lines[_WORLD].append(
            _element(
                "camera",
                {"name": name, "pos": eye, "xyaxes": (*right, *up), "fovy": view_angle},
            )
        )

    def xml(self) -> str:
        """The finished MJCF text."""
        head = [
            f"<mujoco model={quoteattr(self.name)}>",
            "  <!-- Made by a generator of worlds; change the generator, not this file. -->",
            "  " + _element("statistic", {"center": self._center, "extent": self._extent}),
            *_VISUAL,
            *_DEFAULTS,
            "",
        ]
        lines = list(head)
        for part in (_ASSETS, _WORLD):
            body = [f"    {line}" if line else "" for line in self._lines[part]]
            while body and not body[0]:
                del body[0]
            lines += [f"  <{part}>", *body, f"  </{part}>", ""]
        return "\n".join([*lines[:-1], "</mujoco>", ""])


_VISUAL = [
    "  <visual>",
    '    <headlight ambient="0.36 0.36 0.36" diffuse="0.12 0.12 0.12" specular="0 0 0"/>',
    '    <map znear="0.002" shadowclip="1.4"/>',
    "  </visual>",
]

# Friction of a contact is the larger of the two geoms' (robots reference 4.10).
_DEFAULTS = [
    "  <default>",
    '    <default class="floor"><geom friction="1"/></default>',
    '    <default class="ground"><geom friction="1"/></default>',
    '    <default class="obstacle"><geom friction="0.5"/></default>',
    '    <default class="movable"><geom friction="0.5"/></default>',
    '    <default class="paint"><geom contype="0" conaffinity="0"/></default>',
    "  </default>",
]
