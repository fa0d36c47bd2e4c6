"""A picture of how a run ended: what was found, where everybody drove, and who is where."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.cycle import BASE
from usarsim_exploration.known_map import FREE, KNOWN, WALL
from usarsim_exploration.running import Result

UNKNOWN, EXPLORED, AT_BASE, BLACK = (205, 205, 205), (255, 255, 255), (255, 240, 170), (0, 0, 0)
"""Colours, red green blue (exploration reference 14)."""
TRAILS = (
    (31, 119, 180), (214, 39, 40), (44, 160, 44), (148, 103, 189), (255, 127, 14), (23, 190, 207),
    (140, 86, 75), (227, 119, 194),
)  # fmt: skip
"""Of robots, over and over."""
_FINE = 2
"""Pixels per cell."""


def draw(result: Result) -> NDArray[np.uint8]:
    """(rows, columns, 3) red green blue."""
    maps = [body.view.known.bits for body in result.cycle.bodies]
    union = np.bitwise_or.reduce(maps)
    picture = np.full((*union.shape, 3), UNKNOWN, np.uint8)
    picture[union & FREE != 0] = EXPLORED
    picture[(maps[BASE] & KNOWN != 0) & (union & FREE != 0)] = AT_BASE
    picture[(union & WALL != 0) & (union & FREE == 0)] = BLACK
    picture = picture.repeat(_FINE, axis=0).repeat(_FINE, axis=1)
    history = result.history
    places = history.cell * _FINE + _FINE // 2
    for number in range(1, len(history.names)):
        colour = TRAILS[(number - 1) % len(TRAILS)]
        cv2.polylines(picture, [places[:, number].astype(np.int32)], False, colour, 1, cv2.LINE_8)
    for number, (column, row) in enumerate(places[-1].tolist()):
        colour = BLACK if number == BASE else TRAILS[(number - 1) % len(TRAILS)]
        cv2.circle(picture, (column, row), 3 * _FINE, colour, -1)
        if not history.works[-1, number]:
            cv2.circle(picture, (column, row), 3 * _FINE, BLACK, 1)
    return picture


def png(picture: NDArray[np.uint8]) -> bytes:
    """As a file."""
    _, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    return data.tobytes()
