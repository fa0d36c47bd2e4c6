"""CONF of cameras (protocol reference 4.8, side channels reference 2.10)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.messages.text import count, line, number, segment
from usarsim_server.protocol.values import Dialect

__all__ = ["CameraItem", "camera_configuration"]

_DIGITS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraItem:
    """A camera and the tile of the full picture that it fills.

    Attributes:
        name: item name.
        offset: x and y of the tile's upper left corner, pixels; zeros if it has none.
        resolution: width and height of the tile, pixels.
        default_fov, min_fov, max_fov, fov: horizontal field of view, rad; the last one is the
            present one.
    """

    name: str
    offset: tuple[int, int] = (0, 0)
    resolution: tuple[int, int] = (320, 240)
    default_fov: float = 1.3963
    min_fov: float = 0.3491
    max_fov: float = 2.0944
    fov: float = 1.3963


def camera_configuration(dialect: Dialect, wire_type: str, cameras: Sequence[CameraItem]) -> str:
    """CONF line of all cameras asked for; nothing gives an empty text.

    In `udk` it tells the tiles too, in degrees, and the segments of a camera stand without blanks
    between them as in the original: the one exception to the rule of single blanks, because that
    is the text that programs of that generation cut their pictures by.

    Args:
        dialect: decides on unit, tiles and blanks.
        wire_type: Type as the client spelled it, which `udk` echoed.
        cameras: in mount order.
    """
    if not cameras:
        return ""
    degrees = FACETS[dialect].camera_in_degrees
    body = [_tiled(camera) if degrees else _plain(camera) for camera in cameras]
    return line("CONF", segment("Type", wire_type), *body)


def _tiled(camera: CameraItem) -> str:
    (x, y), (width, height) = camera.offset, camera.resolution
    return "".join(
        (
            segment("Name", camera.name),
            count("TextureOffsetX", x),
            count("TextureOffsetY", y),
            count("TextureResolutionX", width),
            count("TextureResolutionY", height),
            *_lens(camera, math.degrees(1.0)),
        )
    )


def _plain(camera: CameraItem) -> str:
    return " ".join((segment("Name", camera.name), *_lens(camera, 1.0)))


def _lens(camera: CameraItem, unit: float) -> tuple[str, ...]:
    return (
        number("CameraDefFov", camera.default_fov * unit, _DIGITS),
        number("CameraMinFov", camera.min_fov * unit, _DIGITS),
        number("CameraMaxFov", camera.max_fov * unit, _DIGITS),
        number("CameraFov", camera.fov * unit, _DIGITS),
    )
