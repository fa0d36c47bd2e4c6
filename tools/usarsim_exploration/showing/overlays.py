"""What can be drawn of a scene, each on or off by itself (exploration reference 14).

Overlays of one map (free space, safe space, frontiers, skeleton) show that of the team, or of the
robot that was chosen; those of robots (plans, meetings, beliefs) show all, or the chosen one; true
walls, links and hierarchy are always those of all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.cycle import BASE
from usarsim_exploration.environment import Environment
from usarsim_exploration.frontiers import find_frontiers
from usarsim_exploration.kernels import crossings
from usarsim_exploration.known_map import AT_BASE, FREE, KNOWN, SAFE, WALL, KnownMap
from usarsim_exploration.planning import TopologicalMap, skeleton
from usarsim_exploration.radio.estimate import outline
from usarsim_exploration.showing.canvas import Canvas, Colour

UNKNOWN: Colour = (205, 205, 205)
EXPLORED: Colour = (255, 255, 255)
KNOWN_AT_BASE: Colour = (255, 240, 150)
CERTAIN: Colour = (150, 220, 150)
OBSTACLE: Colour = (0, 0, 0)
TRUE_WALL: Colour = (150, 150, 150)
FRONTIER = HIERARCHY = (255, 0, 255)
LINK: Colour = (0, 170, 0)
RANGE: Colour = (110, 150, 255)
WAY: Colour = (0, 150, 160)
MEETING, CHILD_MEETING, PARENT_MEETING = (220, 0, 0), (255, 140, 0), (0, 130, 0)
SAMPLE: Colour = (120, 110, 190)
PAIR: Colour = (190, 150, 60)
BONE: Colour = (140, 90, 40)
AREA: Colour = (90, 120, 140)
BELIEF: Colour = (130, 0, 160)
ROLES: dict[str, Colour] = {"explorer": (0, 60, 255), "relay": (225, 0, 0), "base": (0, 0, 0)}
TRAILS: tuple[Colour, ...] = (
    (31, 119, 180), (214, 39, 40), (44, 160, 44), (148, 103, 189), (255, 127, 14), (23, 190, 207),
    (140, 86, 75), (227, 119, 194),
)  # fmt: skip
"""Of robots, over and over."""
_DISC = 6
"""Radius of an agent, pixels."""


@dataclass(frozen=True, slots=True)
class Overlay:
    """Something that can be drawn.

    Attributes:
        name: for options. default: whether it is drawn unless somebody says otherwise.
        help: what it is. paint: draws it. by_cell: paints whole cells, below all strokes.
    """

    name: str
    default: bool
    help: str
    paint: Callable[[Canvas], None]
    by_cell: bool = False


def _free(canvas: Canvas) -> None:
    bits = canvas.bits
    free = (bits & FREE != 0) & (bits & WALL == 0)
    canvas.cells[free] = EXPLORED
    at_base = bits & AT_BASE if canvas.robot is not None else canvas.scene.known(BASE) & KNOWN
    canvas.cells[free & (at_base != 0)] = KNOWN_AT_BASE


def _safe(canvas: Canvas) -> None:
    bits = canvas.bits
    canvas.cells[bits & (SAFE | FREE | WALL) == SAFE | FREE] = CERTAIN


def _obstacles(canvas: Canvas) -> None:
    canvas.cells[canvas.bits & WALL != 0] = OBSTACLE


def _walls(canvas: Canvas) -> None:
    canvas.cells[(canvas.scene.walls != 0) & (canvas.bits & KNOWN == 0)] = TRUE_WALL


def _frontiers(canvas: Canvas) -> None:
    known = KnownMap(canvas.bits.shape)
    cells = np.flatnonzero(canvas.bits)
    known.write(0, cells, canvas.bits.reshape(-1)[cells])
    for one in find_frontiers(known):
        canvas.cells[one.outline[:, 1], one.outline[:, 0]] = FRONTIER


def _trail(canvas: Canvas) -> None:
    for number in canvas.numbers:
        if number != BASE:
            colour = TRAILS[(number - 1) % len(TRAILS)]
            canvas.way(canvas.scene.trail(number), colour)


def _path(canvas: Canvas) -> None:
    for one in canvas.figures:
        if len(one.path):
            canvas.way([one.cell, *one.path.tolist()], WAY, 2)


def _range(canvas: Canvas) -> None:
    scene = canvas.scene
    world = Environment("", scene.walls, scene.cell)
    for one in canvas.figures:
        if one.reach > 0:
            canvas.way(outline(scene.radio, world, one.cell, one.reach), RANGE, closed=True)


def _skeleton(canvas: Canvas) -> None:
    rows, columns = np.nonzero(skeleton(_clear(canvas)))
    canvas.dots(np.stack([columns, rows], axis=1), BONE, 0)


def _topology(canvas: Canvas) -> None:
    found = TopologicalMap.build(_clear(canvas), canvas.bits & WALL != 0)
    for (one, other), doors in zip(found.edges, found.doors, strict=True):
        canvas.way(np.array([found.nodes[one], *doors, found.nodes[other]]), AREA)
    canvas.dots(found.nodes, AREA, 4)


def _clear(canvas: Canvas) -> NDArray[np.uint8]:
    found: NDArray[np.uint8] = (canvas.bits & (FREE | WALL) == FREE).astype(np.uint8)
    return found


def _links(canvas: Canvas) -> None:
    figures = canvas.scene.figures
    for one, other in canvas.scene.links.tolist():
        canvas.way([figures[one].cell, figures[other].cell], LINK, 2)


def _hierarchy(canvas: Canvas) -> None:
    figures = canvas.scene.figures
    for one in figures[BASE + 1 :]:
        if one.parent is not None:
            canvas.way([one.cell, figures[one.parent].cell], HIERARCHY)


def _selection(canvas: Canvas) -> None:
    for one in canvas.figures:
        if (found := one.selection) is None:
            continue
        canvas.dots(found.candidates, MEETING)
        canvas.mark(found.goal, MEETING, cv2.MARKER_TILTED_CROSS)
        for cell in found.finalists:
            canvas.ring(cell, MEETING, 7)


def _meetings(canvas: Canvas) -> None:
    for one in canvas.figures:
        if (found := one.meeting) is None:
            continue
        if found.backup is not None:
            canvas.mark(found.backup, MEETING, cv2.MARKER_SQUARE)
        if one.role == "relay":
            canvas.mark(found.relay_place, CHILD_MEETING, cv2.MARKER_SQUARE, 18)
        else:
            canvas.mark(found.place, PARENT_MEETING, cv2.MARKER_SQUARE)


def _samples(canvas: Canvas) -> None:
    for one in canvas.figures:
        if one.selection is not None:
            canvas.dots(one.selection.samples, SAMPLE)


def _pairs(canvas: Canvas) -> None:
    walls = (canvas.scene.walls * 2).astype(np.uint8)
    for one in canvas.figures:
        if one.selection is None or one.meeting is None or not len(one.selection.heard):
            continue
        heard = one.selection.heard
        place = np.broadcast_to(np.array(one.meeting.place), heard.shape)
        between = crossings(walls, np.ascontiguousarray(np.concatenate([place, heard], axis=1)))
        for cell in heard[between[:, 0] > 0].tolist():
            canvas.way([one.meeting.place, cell], PAIR)


def _beliefs(canvas: Canvas) -> None:
    for number, one in zip(canvas.numbers, canvas.figures, strict=True):
        if number == BASE and canvas.robot is None:
            continue
        for mate in one.beliefs:
            if mate.number == BASE:
                continue
            name = canvas.scene.figures[mate.number].name
            told = f"{name}, {canvas.scene.step - mate.heard} ago"
            canvas.way([one.cell, mate.cell], BELIEF)
            canvas.ring(mate.cell, BELIEF, _DISC + 2)
            canvas.text(mate.cell, told if canvas.robot else f"{one.name}: {told}", BELIEF, 12)


def _agents(canvas: Canvas) -> None:
    for one in canvas.figures:
        colour = ROLES[one.role]
        canvas.dots([one.cell], colour, _DISC)
        if not one.works:
            canvas.mark(one.cell, OBSTACLE, cv2.MARKER_TILTED_CROSS, 4 * _DISC)
        elif one.role != "base":
            x, y = canvas.point(one.cell)
            ahead = (
                x + round(_DISC * math.cos(one.heading)),
                y + round(_DISC * math.sin(one.heading)),
            )
            cv2.line(canvas.picture, (x, y), ahead, EXPLORED, 2, cv2.LINE_8)
        canvas.text(one.cell, one.name, colour)


OVERLAYS = {
    one.name: one
    for one in (
        Overlay("free", True, "free space; yellow where the base knows it", _free, True),
        Overlay("safe", False, "space that is certainly free", _safe, True),
        Overlay("walls", False, "true walls that nobody knows", _walls, True),
        Overlay("obstacles", True, "walls that are known", _obstacles, True),
        Overlay("frontiers", True, "outlines of known space, beyond which the unknown is",
                _frontiers, True),
        Overlay("skeleton", False, "skeleton of known free space", _skeleton),
        Overlay("topology", False, "topological map: nodes, and ways between them", _topology),
        Overlay("trail", False, "where robots drove", _trail),
        Overlay("range", True, "how far each radio reaches, in 128 directions", _range),
        Overlay("links", True, "who hears whom directly", _links),
        Overlay("hierarchy", False, "who reports to whom", _hierarchy),
        Overlay("samples", False, "cells that were considered for the relay", _samples),
        Overlay("pairs", True, "of these, from where a meeting point is heard through walls",
                _pairs),
        Overlay("selection", True, "out of what a meeting point was chosen; rings: the last few",
                _selection),
        Overlay("meetings", True, "where explorer (green) and relay (orange) meet; else (red)",
                _meetings),
        Overlay("path", True, "what is left of each plan", _path),
        Overlay("beliefs", False, "where robots think that others are, and since when", _beliefs),
        Overlay("agents", True, "robots and base, by role", _agents),
    )
}  # fmt: skip
"""By name, in the order in which they are drawn."""
DEFAULT = frozenset(name for name, one in OVERLAYS.items() if one.default)
