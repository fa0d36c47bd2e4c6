"""Draws the environments of the exploration benchmark for docs/exploration.md.

``python docs/images/explore_worlds.py``: all on one sheet to one scale, the base blue, starts red.
"""

from pathlib import Path

import cv2
import numpy as np

from usarsim_exploration.worlds import find, names

SCALE = 0.4
TITLE = 22
ACROSS = 4
GAP = 12


def main() -> None:
    """One file."""
    pictures = []
    for name in names():
        world = find(name)
        cells = np.where(world.environment.walls != 0, 60, 255).astype(np.uint8)
        picture = cv2.cvtColor(cells, cv2.COLOR_GRAY2BGR)
        for start in world.starts:
            cv2.circle(picture, start, 3, (40, 40, 220), -1)
        cv2.circle(picture, world.base, 6, (220, 80, 0), -1)
        small = cv2.resize(picture, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA)
        small = cv2.copyMakeBorder(small, TITLE, 0, 0, 0, cv2.BORDER_CONSTANT, value=(240,) * 3)
        rows, columns = world.environment.shape
        text = f"{name} {columns} x {rows}"
        cv2.putText(small, text, (2, 16), 0, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
        pictures.append(small)
    pictures.sort(key=lambda one: (-one.shape[0], -one.shape[1]))
    lines = [pictures[n : n + ACROSS] for n in range(0, len(pictures), ACROSS)]
    wide = max(sum(one.shape[1] + GAP for one in line) for line in lines) + GAP
    deep = sum(max(one.shape[0] for one in line) + GAP for line in lines) + GAP
    sheet = np.full((deep, max(wide, 320), 3), 240, np.uint8)
    y = GAP
    for line in lines:
        x = GAP
        for one in line:
            sheet[y : y + one.shape[0], x : x + one.shape[1]] = one
            x += one.shape[1] + GAP
        y += max(one.shape[0] for one in line) + GAP
    _, found = cv2.imencode(".png", sheet, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    Path(__file__).with_name("explore-worlds.png").write_bytes(found.tobytes())


main()
