"""Lights of T3D actors, of all generations of the engine."""

from __future__ import annotations

from usarsim_maps.scene import Light
from usarsim_maps.unreal.level import light
from usarsim_maps.unreal.t3d_text import Block, value_of
from usarsim_server.simulation.frames import Pose

__all__ = ["light_of"]

UE1_RADIUS, UE1_BRIGHTNESS = 25.0, 64.0
"""UU per step of LightRadius; LightBrightness of an ordinary lamp."""


def light_of(name: str, kind: str, pose: Pose, owners: list[Block], scale: float) -> Light:
    """A light from an actor and its components: UE3's values, or UE1's hue and brightness."""
    radius = brightness = 0.0
    color = (1.0, 1.0, 1.0)
    for owner in owners:
        radius = owner.number("radius", owner.number("lightradius", 0.0) * UE1_RADIUS) or radius
        brightness = owner.number(
            "brightness", owner.number("lightbrightness", 0.0) / UE1_BRIGHTNESS
        ) or (brightness)
        color = _color(owner) or color
    cone = next((o.number("outerconeangle", 0.0) for o in reversed(owners)), 0.0)
    return light(
        name, kind, pose, scale, radius=radius, brightness=brightness, color=color, cone=cone
    )


def _color(owner: Block) -> tuple[float, float, float] | None:
    value = value_of(owner.properties.get("lightcolor", ""))
    if isinstance(value, str) or not value:
        return None
    parts = []
    for key in "rgb":
        member = value.get(key, "0")
        text = member.strip() if isinstance(member, str) else "0"
        parts.append(min(255.0, max(0.0, float(text) if text.isdigit() else 0.0)) / 255.0)
    return parts[0], parts[1], parts[2]
