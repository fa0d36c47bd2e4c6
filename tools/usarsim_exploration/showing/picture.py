"""The one picture of a scene: the same in files, films and the page."""

from __future__ import annotations

from collections.abc import Collection

import cv2
import numpy as np

from usarsim_exploration.errors import ExplorationError
from usarsim_exploration.showing.canvas import Canvas, Picture
from usarsim_exploration.showing.overlays import DEFAULT, OVERLAYS, UNKNOWN
from usarsim_exploration.showing.scene import Scene

_STRIP = 18
"""Pixels below a map, for words."""


def draw(scene: Scene, overlays: Collection[str] = DEFAULT, robot: int | None = None) -> Picture:
    """A picture of a scene; below the map a strip that says which step it is.

    Args:
        overlays: names of what is drawn. robot: whose map and plans; None: the team's.

    Returns:
        Even numbers of rows and columns, as films want them.
    """
    canvas = Canvas(scene, robot, UNKNOWN)
    wanted = [one for name, one in OVERLAYS.items() if name in overlays]
    for one in wanted:
        if one.by_cell:
            one.paint(canvas)
    canvas.enlarge()
    for one in wanted:
        if not one.by_cell:
            one.paint(canvas)
    rows, columns = canvas.picture.shape[:2]
    picture = np.full((rows + _STRIP + rows % 2, columns + columns % 2, 3), 255, np.uint8)
    picture[:rows, :columns] = canvas.picture
    words = (
        f"step {scene.step}   team {scene.team:.1f} %   base {scene.base:.1f} %   "
        + (f"{scene.figures[robot].name}   " if robot is not None else "")
        + scene.title
    )
    place = 4, rows + rows % 2 + _STRIP - 4
    cv2.putText(picture, words, place, cv2.FONT_HERSHEY_PLAIN, 1.0, (0, 0, 0), 1, cv2.LINE_8)
    return picture


def png(picture: Picture) -> bytes:
    """As a file."""
    _, data = cv2.imencode(".png", np.ascontiguousarray(picture[..., ::-1]))
    return data.tobytes()


def overlays_of(text: str) -> frozenset[str]:
    """Names with commas between, which are drawn beside the usual ones; with `-` before: not.

    `none` and `all` first begin with nothing or everything.

    Raises:
        ExplorationError: there is no such overlay.
    """
    found = set(DEFAULT)
    for index, word in enumerate(part.strip() for part in text.split(",") if part.strip()):
        name = word.lstrip("-")
        if index == 0 and word in ("none", "all"):
            found = set(OVERLAYS) if word == "all" else set()
        elif name not in OVERLAYS:
            cure = f"choose among {', '.join(OVERLAYS)}; begin with none or all"
            raise ExplorationError(f"--overlays: there is no {name!r} ({cure})")
        elif word.startswith("-"):
            found.discard(name)
        else:
            found.add(name)
    return frozenset(found)
