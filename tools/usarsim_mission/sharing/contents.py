"""Makes the contents and arrays of a shared run out of its story, with more or less detail."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usarsim_mission.grid import LARGEST, UNKNOWN, Grid
from usarsim_mission.model import Mission, World
from usarsim_mission.sharing.packing import pack
from usarsim_mission.sharing.story import Row, Story, sampled

PLACE, TURN, POWER, TIME = 1e-3, 1e-4, 1e-2, 1e-3
"""What one is of places (m), parts of quaternions, power of wheels (1 is full), times (s)."""
_FULL = 10.0  # Hz of the truth
_ICON = 4096  # bytes of a picture that is kept however little room there is


@dataclass(frozen=True, slots=True)
class Detail:
    """How much of a run is packed.

    Attributes:
        rate: rows of poses and of driving a second of simulated time, Hz.
        maps: how many maps of the team.
        pictures: whether textures are drawn.
        mesh: bytes of the largest mesh that is drawn as it is; others are boxes.
        scenery: whether the world is drawn by its shapes, else by its floor.
    """

    rate: float = _FULL
    maps: int = 200
    pictures: bool = True
    mesh: int = 1 << 30
    scenery: bool = True


LEVELS = (
    Detail(),
    Detail(rate=5.0, maps=60),
    Detail(rate=5.0, maps=60, pictures=False),
    Detail(rate=5.0, maps=30, pictures=False, mesh=200_000),
    Detail(rate=2.0, maps=30, pictures=False, mesh=20_000),
    Detail(rate=1.0, maps=10, scenery=False),
    Detail(rate=0.2, maps=2, scenery=False),
)
"""From all to the least, for as much as fits."""


@dataclass(frozen=True, slots=True)
class Shown:
    """All that can be shown of a run.

    Attributes:
        result: as `score.json` tells.
        scenery: see `scenery.read_scenery`.
        damage: what is missing, in words.
        blind: names no condition.
    """

    mission: Mission
    world: World
    story: Story
    result: Mapping[str, Any]
    scenery: Mapping[str, Any] | None
    damage: Sequence[str]
    blind: bool

    @property
    def title(self) -> str:
        """What it is called; that of a mission may tell the condition."""
        named = self.world.title or self.mission.name
        return named if named and not self.blind else "A run"

    def packed(self, detail: Detail) -> bytes:
        """As `packing.pack` makes it."""
        notes: list[str] = []
        arrays: dict[str, NDArray[Any]] = {}
        contents = {
            **self._head(),
            "robots": self._motion(detail, arrays, notes),
            "victims": self._victims(),
            "maps": self._maps(detail, arrays, notes),
            "floor": self._floor(arrays),
            "scenery": self._scenery(detail, notes),
            **self._events(),
        }
        contents["notes"] = [*self.damage, *notes, *self._left_out()]
        return pack(contents, arrays)

    def _head(self) -> dict[str, Any]:
        story, result, ended = self.story, self.result, self.result["ended"]
        began = ended["began"]
        head = {
            "title": self.title,
            "about": "of a blind study" if self.blind else "",
            "began": story.times[0] if began is None else began,
            "why": ended["why"] or "broken off",
            "limit": result.get("time_limit"),
            "total": result["total"],
            "values": result["values"],
            "units": {"place": PLACE, "turn": TURN, "power": POWER, "time": TIME},
        }
        if not self.blind:
            facts = [
                ("mission", self.mission.name),
                ("team", story.session.get("team")),
                ("seed", self.mission.seed),
                ("rules", result["rules"]),
                ("software", story.session.get("software")),
            ]
            head["about"] = ", ".join(f"{name} {one}" for name, one in facts if one is not None)
        return head

    def _motion(
        self, detail: Detail, arrays: dict[str, NDArray[Any]], notes: list[str]
    ) -> list[dict[str, Any]]:
        story = self.story
        times = np.array(story.times)
        rows = _thinned(times, detail.rate)
        if detail.rate < _FULL:
            notes.append(f"Poses and driving are kept {detail.rate:g} times a second, not 10.")
        arrays["time"] = _whole(times[rows], TIME)
        told = []
        for number, (name, robot) in enumerate(story.robots.items()):
            there = np.zeros(len(times), np.uint8)
            there[[row for row, _ in robot.poses]] = 1
            arrays[f"{number}.there"] = there[rows]
            poses = sampled(robot.poses or [(0, (0.0,) * 3 + (1.0, 0, 0, 0))], rows, 7)
            poses[:, 3:] = _continuous(poses[:, 3:])
            for column, part in enumerate(("x", "y", "z", "qw", "qx", "qy", "qz")):
                arrays[f"{number}.{part}"] = _whole(poses[:, column], PLACE if column < 3 else TURN)
            driven = [(at, (left, right, float(who))) for at, left, right, who in robot.driven]
            power = _held(driven, times[rows], (0.0, 0.0, 0.0))
            arrays[f"{number}.left"] = _whole(power[:, 0], POWER)
            arrays[f"{number}.right"] = _whole(power[:, 1], POWER)
            arrays[f"{number}.source"] = power[:, 2].astype(np.uint8)
            told.append({"name": name, "class": robot.kind, "modes": robot.modes})
            told[-1]["told"] = robot.told
        for number, victim in enumerate(self.world.victims):
            walk: list[Row] = story.victims.get(victim.name, [])
            if len(walk) > 1:
                ways = sampled(walk, rows, 3)
                for column, part in enumerate("xyz"):
                    arrays[f"v{number}.{part}"] = _whole(ways[:, column], PLACE)
        return told

    def _victims(self) -> list[dict[str, Any]]:
        found = {one["name"]: one for one in self.result["victims"]}
        told = []
        for victim in self.world.victims:
            walk = self.story.victims.get(victim.name)
            row = found.get(victim.name, {})
            one = {"name": victim.name, "pos": walk[0][1] if walk else victim.pos}
            one |= {key: row.get(key) for key in ("robot", "why", "credited")}
            told.append({**one, "found": row.get("t_sim") if row.get("found") else None})
        return told

    def _maps(
        self, detail: Detail, arrays: dict[str, NDArray[Any]], notes: list[str]
    ) -> dict[str, Any] | None:
        """Each map as what it changes of the one before, on a raster that holds all of them."""
        maps = self.story.maps
        if not maps:
            return None
        every = -(-len(maps) // detail.maps)
        kept = maps[:: -every or None][::-1]  # the last one is always there
        if every > 1:
            notes.append(f"Of the {len(maps)} maps of the team {len(kept)} are kept.")
        newest = kept[-1][1]
        fitting = [(time, one) for time, one in kept if _fits(one, newest)]
        if len(fitting) < len(kept):
            notes.append(f"{len(kept) - len(fitting)} maps on another raster are left out.")
        kept, cell = fitting, newest.cell
        x, y = (min(getattr(one, axis) for _, one in kept) for axis in "xy")
        corners = [_corner(one, x, y) for _, one in kept]
        sizes = [one.cells.shape for _, one in kept]
        ends = np.add(corners, sizes).max(axis=0)
        rows, columns = int(ends[0]), int(ends[1])
        before = np.zeros((rows, columns), np.uint8)
        indices, values, steps = [], [], []
        for (time, one), (row, column) in zip(kept, corners, strict=True):
            now = np.full_like(before, UNKNOWN)
            now[row : row + one.cells.shape[0], column : column + one.cells.shape[1]] = one.cells
            changed = np.flatnonzero(now != before)
            indices.append(changed.astype(np.int32))
            values.append(now.reshape(-1)[changed])
            steps.append([round(time, 3), len(changed)])
            before = now
        arrays["map.index"], arrays["map.value"] = np.concatenate(indices), np.concatenate(values)
        return {"x": x, "y": y, "cell": cell, "rows": rows, "columns": columns, "steps": steps}

    def _floor(self, arrays: dict[str, NDArray[Any]]) -> dict[str, Any] | None:
        floor = self.world.floor
        if floor is None:
            return None
        arrays["floor"] = floor.cells.reshape(-1)
        rows, columns = floor.cells.shape
        return {"x": floor.x, "y": floor.y, "cell": floor.cell, "rows": rows, "columns": columns}

    def _scenery(self, detail: Detail, notes: list[str]) -> dict[str, Any] | None:
        scenery = self.scenery
        if scenery is None or not detail.scenery:
            why = "was not kept in the run" if scenery is None else "is too large for one file"
            notes.append(f"The scenery {why}: walls are those of the floor, robots plain bodies.")
            return None
        found = dict(scenery)
        if not detail.pictures and scenery["textures"]:
            found["textures"] = {
                key: one
                if len(one.get("data", "")) <= _ICON
                else {name: value for name, value in one.items() if name != "data"}
                for key, one in scenery["textures"].items()
            }
            notes.append("Pictures on walls and floors are left out: they have their mean colour.")
        large = {
            key: one
            for key, one in scenery["meshes"].items()
            if sum(len(str(part)) for part in one.values()) > detail.mesh
        }
        if large:
            boxes = {key: _box(one) for key, one in large.items()}
            found["meshes"] = {**scenery["meshes"], **boxes}
            notes.append(f"{len(large)} large shapes are drawn as boxes.")
        notes.append(
            "Wheels, arms and doors stand as they did when the trial began; people who walk glide."
        )
        return found

    def _events(self) -> dict[str, Any]:
        story = self.story
        return {
            "zones": [
                {"name": one.name, "colour": one.colour, "points": one.points}
                for one in self.world.zones
            ],
            "marks": [
                [one.name, one.begin, one.end, round(one.x, 3), round(one.y, 3), one.verdict]
                for one in story.marks
            ],
            "scores": [[round(time, 3), round(total, 4)] for time, total in story.scores],
            "selected": story.selected,
            "events": [[round(time, 3), *rest] for time, *rest in story.events],
        }

    def _left_out(self) -> list[str]:
        looks = f"{self.story.looks} times that a victim was in a camera's view, " * bool(
            self.story.looks
        )
        return [
            f"Left out: camera pictures, scans, {looks}names of people, their notes and answers.",
            "Places are rounded to 1 mm, between two rows they are interpolated.",
        ]


def _thinned(times: NDArray[np.float64], rate: float) -> NDArray[np.int64]:
    """Numbers of the rows that are kept, the last one among them."""
    if rate >= _FULL:
        return np.arange(len(times))
    slots = np.floor((times - times[0]) * rate + 1e-6)
    first = np.flatnonzero(np.diff(slots, prepend=-1.0) > 0)
    return np.unique(np.append(first, len(times) - 1))


def _whole(values: NDArray[np.float64], unit: float) -> NDArray[np.int32]:
    return np.clip(np.round(values / unit), -(2**30), 2**30).astype(np.int32)


def _continuous(quats: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same turns, each with the sign that is nearer to the one before."""
    flips = np.sign(np.sum(quats[1:] * quats[:-1], axis=1))
    flips[flips == 0] = 1
    signs = np.cumprod(np.concatenate(([1.0], flips)))
    return quats * signs[:, None]


def _held(
    changes: list[tuple[float, tuple[float, float, float]]],
    times: NDArray[np.float64],
    first: tuple[float, float, float],
) -> NDArray[np.float64]:
    """What holds at each time, of values that change."""
    known = np.array([-np.inf, *(time for time, _ in changes)])
    values = np.array([first, *(one for _, one in changes)])
    found: NDArray[np.float64] = values[np.searchsorted(known, times, "right") - 1]
    return found


def _fits(grid: Grid, other: Grid) -> bool:
    """Whether both can stand on one raster of a size that can be."""
    apart = max(abs(grid.x - other.x), abs(grid.y - other.y))
    return grid.cell == other.cell and apart <= LARGEST * grid.cell


def _corner(grid: Grid, x: float, y: float) -> tuple[int, int]:
    """Row and column of a grid's first cell in a raster that begins at x, y."""
    return round((grid.y - y) / grid.cell), round((grid.x - x) / grid.cell)


def _box(mesh: Mapping[str, Any]) -> dict[str, Any]:
    """The box around a mesh, as a mesh."""
    vertices = np.frombuffer(base64.b64decode(mesh["vertices"]), "<f4").reshape(-1, 3)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = np.array(
        [[(low, high)[bit >> axis & 1][axis] for axis in range(3)] for bit in range(8)], "<f4"
    )
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = np.array([(a, b, c, a, c, d) for a, b, c, d in sides], "<u2")
    return {
        "vertices": base64.b64encode(corners.tobytes()).decode(),
        "faces": base64.b64encode(faces.tobytes()).decode(),
    }
