"""A run seen from above, as one SVG in metres: floor, walls, zones, ways, marks and victims."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

import numpy as np
from PIL import Image

from usarsim_mission.grid import FREE, UNKNOWN, WALL, Grid
from usarsim_mission.look import COLOURS, ZONES
from usarsim_mission.match.drawn import Drawn
from usarsim_mission.model import World

GOOD, HALF, NONE = "#0a7d5a", "#e69f00", "#ffffff"
_FLOOR, _WALL, _SEEN, _MAPPED = (240, 242, 244), (150, 157, 165), (213, 232, 243), (38, 44, 51)
_INK, _WRONG = "#1f2328", "#b3261e"
_SCALES = (1, 2, 5, 10, 20, 50, 100)
Box = tuple[float, float, float, float]


def floor_plan(world: World, drawn: Drawn, victims: Mapping[str, Mapping[str, Any]]) -> str:
    """The picture: x to the right, y up.

    Args:
        world: what is true. drawn: what happened. victims: rows of `score.json` by name.
    """
    box = _box(world, drawn)
    wide, tall = box[2] - box[0], box[3] - box[1]
    unit = max(wide, tall) / 100.0  # m; so lines and letters are as large in all worlds
    parts = [
        f'<svg viewBox="0 0 {wide:.2f} {tall + 4 * unit:.2f}" role="img" style="max-height:44rem" '
        f'aria-label="map with the ways of robots and the victims">'
        f'<g transform="translate({-box[0]:.2f},{box[3]:.2f}) scale(1,-1)">',
        *_ground(world, drawn),
        *_zones(world, unit),
        *_ways(drawn, unit),
        *_zone_names(world, unit),
        *_ends(drawn, unit),
        *_marks(drawn, unit),
        *_victims(world, victims, unit),
        "</g>",
        *_scale(tall, wide, unit),
        "</svg>",
    ]
    return "".join(parts)


def legend(drawn: Drawn) -> str:
    """What the picture shows, in words with their signs."""
    told = [
        _key(f'<path d="M1 8h14" stroke="{_colour(number)}" stroke-width="3"/>', name)
        for number, name in enumerate(drawn.robots)
    ]
    told += [
        _key(_ring(GOOD), "victim, credited"),
        _key(_ring(HALF), "found, not credited"),
        _key(_ring(NONE), "not found"),
    ]
    cross = '<path d="M4 4l8 8M12 4l-8 8" stroke="{}" stroke-width="2"/>'
    if drawn.marks.keys() - drawn.wrong:
        told.append(_key(cross.format(_INK), "mark"))
    if drawn.marks.keys() & drawn.wrong:
        told.append(_key(cross.format(_WRONG), "wrong mark"))
    if drawn.map is not None:
        told.append(_key(f'<path d="M1 3h14v10H1z" fill="rgb{_SEEN}"/>', "mapped by the team"))
        wall = f'<path d="M1 6h14v4H1z" fill="rgb{_MAPPED}"/>'
        told.append(_key(wall, "wall on its map"))
        told.append(_key(wall.replace(str(_MAPPED), str(_WALL)), "true wall that it lacks"))
    return "".join(told)


def _colour(number: int) -> str:
    return COLOURS[number % len(COLOURS)]


def _key(sign: str, words: str) -> str:
    return f'<span class="key"><svg viewBox="0 0 16 16">{sign}</svg>{escape(words)}</span>'


def _ring(fill: str) -> str:
    return f'<circle cx="8" cy="8" r="6" fill="{fill}" stroke="#1f2328" stroke-width="1.5"/>'


def _box(world: World, drawn: Drawn) -> Box:
    """All that is drawn, x and y, m."""
    places = [place for robot in drawn.robots.values() for place in robot.path]
    places += [(one.pos[0], one.pos[1]) for one in world.victims]
    places += [corner for zone in world.zones for corner in zone.points]
    if world.floor is not None:
        rows, columns = np.nonzero(world.floor.cells != UNKNOWN)
        x, y, cell = world.floor.x, world.floor.y, world.floor.cell
        if len(rows):
            places.append((x + columns.min() * cell, y + rows.min() * cell))
            places.append((x + (columns.max() + 1) * cell, y + (rows.max() + 1) * cell))
    low = [min((one[axis] for one in places), default=0.0) - 0.5 for axis in (0, 1)]
    high = [max((one[axis] for one in places), default=1.0) + 0.5 for axis in (0, 1)]
    return low[0], low[1], high[0], high[1]


def _ground(world: World, drawn: Drawn) -> Iterator[str]:
    """What the team has mapped lies below true walls, so that these show where it missed them."""
    if world.floor is not None:
        yield _picture(world.floor, {FREE: _FLOOR})
    if drawn.map is not None:
        yield _picture(drawn.map, {FREE: _SEEN})
    if world.floor is not None:
        yield _picture(world.floor, {WALL: _WALL})
    if drawn.map is not None:
        yield _picture(drawn.map, {WALL: _MAPPED})


def _picture(grid: Grid, colours: Mapping[int, tuple[int, int, int]]) -> str:
    """A grid as a picture that lies where it belongs; what has no colour is clear."""
    pixels = np.zeros((*grid.cells.shape, 4), np.uint8)
    for kind, colour in colours.items():
        pixels[grid.cells == kind] = (*colour, 255)
    file = io.BytesIO()
    Image.fromarray(pixels[::-1]).save(file, "PNG", optimize=True)
    data = base64.b64encode(file.getvalue()).decode()
    rows, columns = grid.cells.shape
    wide, tall = columns * grid.cell, rows * grid.cell
    return (
        f'<image href="data:image/png;base64,{data}" width="{wide:.3f}" height="{tall:.3f}" '
        f'transform="translate({grid.x:.3f},{grid.y + tall:.3f}) scale(1,-1)" '
        'style="image-rendering:pixelated" preserveAspectRatio="none"/>'
    )


def _zones(world: World, unit: float) -> Iterator[str]:
    for zone in world.zones:
        corners = " ".join(f"{x:.2f},{y:.2f}" for x, y in zone.points)
        colour = ZONES[zone.colour]
        yield (
            f'<polygon points="{corners}" fill="{colour}" fill-opacity=".09" stroke="{colour}" '
            f'stroke-width="{0.35 * unit:.3f}"><title>{zone.colour} zone {escape(zone.name)}'
            "</title></polygon>"
        )


def _zone_names(world: World, unit: float) -> Iterator[str]:
    for zone in world.zones:
        if zone.colour == "blue":
            continue
        x = min(one[0] for one in zone.points) + unit
        y = max(one[1] for one in zone.points) - 2.4 * unit
        yield _text(x, y, f"{zone.colour}: {zone.name}", unit, anchor="start", size=1.7, quiet=True)


def _ways(drawn: Drawn, unit: float) -> Iterator[str]:
    """Each way with a light border, so that crossings can be told apart."""
    ends = 'fill="none" stroke-linejoin="round" stroke-linecap="round"'
    for number, robot in enumerate(drawn.robots.values()):
        way = " ".join(f"{x:.2f},{y:.2f}" for x, y in robot.path)
        for colour, width in (("#fff", 0.85), (_colour(number), 0.45)):
            yield (
                f'<polyline points="{way}" {ends} stroke="{colour}" stroke-opacity=".9" '
                f'stroke-width="{width * unit:.3f}"/>'
            )


def _ends(drawn: Drawn, unit: float) -> Iterator[str]:
    """Where robots began, and where they are in the end, with their names."""
    for number, (name, robot) in enumerate(drawn.robots.items()):
        if not robot.path:
            continue
        (x0, y0), (x, y) = robot.path[0], robot.path[-1]
        colour = _colour(number)
        yield (
            f'<circle cx="{x0:.2f}" cy="{y0:.2f}" r="{0.7 * unit:.3f}" fill="#fff" '
            f'stroke="{colour}" stroke-width="{0.4 * unit:.3f}"><title>start of {escape(name)}'
            f'</title></circle><circle cx="{x:.2f}" cy="{y:.2f}" r="{1.1 * unit:.3f}" '
            f'fill="{colour}" stroke="#fff" stroke-width="{0.3 * unit:.3f}"/>'
        )
        yield _text(x + 1.6 * unit, y - 0.7 * unit, name, unit, anchor="start", colour=colour)


def _marks(drawn: Drawn, unit: float) -> Iterator[str]:
    for number, (x, y) in drawn.marks.items():
        colour = _WRONG if number in drawn.wrong else _INK
        arm = 0.9 * unit
        yield (
            f'<path d="M{x - arm:.2f} {y - arm:.2f}l{2 * arm:.2f} {2 * arm:.2f}m0 {-2 * arm:.2f}'
            f'l{-2 * arm:.2f} {2 * arm:.2f}" stroke="{colour}" stroke-width="{0.35 * unit:.3f}">'
            f"<title>mark {escape(number)}</title></path>"
        )


def _victims(world: World, rows: Mapping[str, Mapping[str, Any]], unit: float) -> Iterator[str]:
    """Rings with the numbers that the table has."""
    for number, victim in enumerate(world.victims, start=1):
        row = rows.get(victim.name, {})
        fill = GOOD if row.get("credited") else HALF if row.get("found") else NONE
        ink = "#fff" if fill == GOOD else "#1f2328"
        x, y, _ = victim.pos
        yield (
            f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{1.5 * unit:.3f}" fill="{fill}" '
            f'stroke="#1f2328" stroke-width="{0.3 * unit:.3f}"><title>{escape(victim.name)}'
            "</title></circle>"
        )
        yield _text(x, y - 0.65 * unit, str(number), unit, colour=ink, halo=False)


def _text(
    x: float,
    y: float,
    words: str,
    unit: float,
    *,
    anchor: str = "middle",
    size: float = 1.9,
    colour: str = "#1f2328",
    quiet: bool = False,
    halo: bool = True,
) -> str:
    """Letters, upright though y goes up."""
    border = "paint-order:stroke;stroke:#fff;stroke-width:.35em;stroke-linejoin:round;"
    weight = 400 if quiet else 700
    colour = "#4a525a" if quiet else colour
    return (
        f'<text transform="translate({x:.2f},{y:.2f}) scale(1,-1)" text-anchor="{anchor}" '
        f'font-size="{size * unit:.3f}" style="fill:{colour};font-weight:{weight};'
        f'{border if halo else ""}">{escape(words)}</text>'
    )


def _scale(tall: float, wide: float, unit: float) -> Iterator[str]:
    """A bar that is so many metres long."""
    length = max((one for one in _SCALES if one <= wide / 5.0), default=1)
    y = tall + 1.6 * unit
    yield (
        f'<path d="M{unit:.2f} {y - 0.6 * unit:.2f}v{1.2 * unit:.2f}m0 {-0.6 * unit:.2f}h{length}'
        f'm0 {-0.6 * unit:.2f}v{1.2 * unit:.2f}" fill="none" stroke="#1f2328" '
        f'stroke-width="{0.25 * unit:.3f}"/><text x="{length + 2 * unit:.2f}" '
        f'y="{y + 0.65 * unit:.2f}" font-size="{1.9 * unit:.3f}">{length} m</text>'
    )
