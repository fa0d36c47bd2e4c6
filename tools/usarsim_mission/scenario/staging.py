"""A scenario in its world: zones and bands laid out, the floor that robots reach.

From it follow the world folder that the server serves, what the referee knows, and the mission as
it was run. `resolving.py` makes it, `check.py` says what of it cannot be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.floor import EYE, Ground, Reached
from usarsim_mission import model
from usarsim_mission.errors import MissionError
from usarsim_mission.grid import FREE, WALL, Grid
from usarsim_mission.model import Point
from usarsim_mission.scenario import fleet
from usarsim_mission.scenario.borders import Area, derived_bands
from usarsim_mission.scenario.description import (
    PURPOSES,
    Event,
    RobotEntry,
    Scenario,
    VictimEntry,
    beside,
)
from usarsim_mission.scoring import Rules
from usarsim_server.base.errors import at
from usarsim_server.base.files import is_regular, write_text
from usarsim_server.base.toml import toml_text
from usarsim_server.robots.description import RobotDescription
from usarsim_server.simulation.frames import Pose, rpy_from_quaternion
from usarsim_server.worlds.description import StartPose, Victim, WorldDescription, Zone
from usarsim_server.worlds.loader import SHEET
from usarsim_server.worlds.surroundings import LiveVictim

_BODY = 0.35
"""m around the middle of a robot that are its."""


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot of a mission, its class and its place."""

    entry: RobotEntry
    description: RobotDescription
    start: StartPose


@dataclass(frozen=True)
class Staged:
    """A scenario in its world.

    Attributes:
        scenario: with all seeds, and all victims at their places.
        base: the world without the mission. rules: of the scoring file.
        victims: all, those of the world that stay first.
        robots: all, in the order of the file.
    """

    scenario: Scenario
    base: WorldDescription
    rules: Rules
    victims: tuple[Victim, ...]
    robots: tuple[Robot, ...]
    allow_outside: bool = False

    @cached_property
    def ground(self) -> Ground:
        """What is solid in the world."""
        places = replace(self.base, starts=self.starts, victims=self.victims)
        return Ground(places, allow_outside=self.allow_outside)

    @cached_property
    def reached(self) -> Reached:
        """Where the robots get; where several sizes do, the smallest one counts."""
        sizes = [fleet.size_of(one) for one in fleet.drivers(r.description for r in self.robots)]
        smallest = min(sizes, key=lambda size: size.half_width, default=None)
        starts = [robot.start.pose.position for robot in self.robots]
        return self.ground.reach(starts, smallest or fleet.size_of(self.robots[0].description))

    @property
    def starts(self) -> tuple[StartPose, ...]:
        """Those of the world, and those that the mission adds."""
        known = {start.tag.lower() for start in self.base.starts}
        added = (one.start for one in self.robots if one.start.tag.lower() not in known)
        return (*self.base.starts, *added)

    @cached_property
    def zones(self) -> tuple[model.Zone, ...]:
        """Those that the referee judges by: without derived bands."""
        kept = self.base.zones if self.scenario.keep_zones else ()
        own = [(one.name, one.colour, one.corners) for one in self.scenario.zones]
        areas = [*own, *((one.name, one.kind, one.corners) for one in kept)]
        return tuple(
            model.Zone(name, colour, tuple(corners))  # type: ignore[arg-type]
            for name, colour, corners in areas
            if colour in model.COLOURS
        )

    @property
    def band(self) -> float:
        """m that derived bands reach to either side of a border; 0: there are none."""
        given = any(zone.colour == "blue" for zone in self.zones)
        return 0.0 if given else self.scenario.band

    @cached_property
    def painted(self) -> tuple[Zone, ...]:
        """All zones of the world that is served; blue ones come first, as they lie on others."""
        areas: list[Area] = [(one.name, one.colour, one.points) for one in self.zones]
        if self.band:
            bands = derived_bands(areas, self.rules.zones, self.band, self._passes)
            blue = [(f"band {n}", "blue", corners) for n, corners in enumerate(bands, start=1)]
            areas = [*blue, *areas]
        areas.sort(key=lambda area: area[1] != "blue")
        return tuple(self._zone(*area) for area in areas)

    def _zone(self, name: str, colour: str, corners: Any) -> Zone:
        x, y = ((min(axis), max(axis)) for axis in zip(*corners, strict=True))
        middle = [(a + b) / 2.0 for a, b in (x, y)]
        near = self.reached.near(middle, math.hypot(x[1] - x[0], y[1] - y[0]) / 2.0)
        floor = round(float(np.median(near[:, 2])), 3) if len(near) else 0.0
        return Zone(name, colour, x, y, tuple(corners), floor, self.scenario.strips)

    @cached_property
    def _near(self) -> NDArray[np.bool_]:
        """Cells to which a robot, or at least its side, gets."""
        reached = np.isfinite(self.reached.way).astype(np.uint8)
        width = 2 * round(_BODY / self.reached.cell) + 1
        found: NDArray[np.bool_] = cv2.dilate(reached, np.ones((width, width), np.uint8)) > 0
        return found

    def _passes(self, one: Point, other: Point) -> bool:
        """Whether robots get from a place to one beside it."""
        rows, columns = self._near.shape
        eyes = []
        for x, y in (one, other):
            row = math.floor((y - self.reached.y) / self.reached.cell)
            column = math.floor((x - self.reached.x) / self.reached.cell)
            if not (0 <= row < rows and 0 <= column < columns and self._near[row, column]):
                return False
            near = self.reached.near((x, y), 2.0 * _BODY)
            eyes.append([x, y, (near[0, 2] if len(near) else 0.0) + EYE])
        return bool(self.ground.sees(np.array(eyes[:1]), eyes[1])[0])

    # -- what follows ---------------------------------------------------------------------------

    def write_world(self, folder: Path) -> Path:
        """Write the world folder that the server serves; returns it.

        Raises:
            MissionError: it cannot be written.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_text(folder / SHEET, self.sheet())
        except OSError as error:
            cure = "name a folder that can be written"
            raise MissionError(at(folder, f"cannot be written: {error.strerror}", cure)) from error
        return folder

    def sheet(self) -> str:
        """The text of its `world.toml`."""
        content: dict[str, object] = {
            "extends": str(self.base.folder),
            "level": self.base.level,
            "title": self.scenario.title,
            "time_limit": max(1, math.ceil(self.scenario.time_limit / 60.0)),
        }
        if not self.victims:
            content["victim"] = []
        if not self.painted:
            content["zone"] = []
        content["start"] = [
            {"tag": start.tag, **_placed(start.pose), "turns": start.turns} for start in self.starts
        ]
        if self.victims:
            content["victim"] = [
                {
                    "name": one.name,
                    **_placed(one.pose),
                    "posture": one.posture,
                    "status": one.status,
                    "scale": one.scale,
                    "properties": one.properties,
                }
                for one in self.victims
            ]
        if self.painted:
            content["zone"] = [
                {
                    "name": one.name,
                    "kind": one.kind,
                    "polygon": [list(corner) for corner in one.corners],
                    "floor": one.floor,
                    "strip": one.strip,
                }
                for one in self.painted
            ]
        return "# The world of a mission: made by `usarsim mission`.\n\n" + toml_text(content)

    def server_settings(self, world: str) -> dict[str, object]:
        """What a settings file of the server says for this mission.

        world: its folder, with a slash; as seen from the settings file.
        """
        seeds = self.scenario.seeds
        settings: dict[str, object] = {"world": world, "seed": seeds.server}
        settings["max_robots"] = max(16, len(self.robots))
        if self.scenario.radio:
            settings["wireless"] = {**self.scenario.radio}
            settings["wireless"].setdefault("seed", seeds.radio)  # type: ignore[attr-defined]
        return settings

    def impairment(self) -> str:
        """The text of a file for `usarsim console --impair`; empty if nothing is impaired."""
        video = self.scenario.video
        if video.plain:
            return ""
        link = {key: getattr(video, key) for key in ("delay_ms", "jitter_ms", "loss_percent")}
        link |= {"bandwidth_kbit": video.bandwidth_kbit, "seed": self.scenario.seeds.video}
        return toml_text({"link": link})

    def mission_text(self) -> str:
        """The scenario file of this run: seeds and places of victims as they were."""
        content = {**(self.scenario.content or {})}
        content.pop("place", None)
        seeds = self.scenario.seeds
        content["seed"] = self.scenario.seed
        content["seeds"] = {purpose: getattr(seeds, purpose) for purpose in PURPOSES}
        content["world"] = self.scenario.world
        if "/" in self.scenario.world:
            content["world"] = str(beside(self.scenario, self.scenario.world).absolute())
        if is_regular(beside(self.scenario, self.scenario.scoring)):
            content["scoring"] = str(beside(self.scenario, self.scenario.scoring).absolute())
        written = content.get("victim", [])
        pairs = zip(written, self.scenario.victims, strict=True)
        content["victim"] = [{**one, **_entry_place(victim)} for one, victim in pairs]
        names = {event.name for event in self.events}
        content["event"] = [one for one in content.get("event", []) if one["name"] in names]
        return toml_text({key: value for key, value in content.items() if value != []})

    @property
    def events(self) -> tuple[Event, ...]:
        """Those that can happen; not all can in a trial made shorter, or with fewer robots."""
        names = {None, *(robot.entry.name for robot in self.robots)}
        return tuple(
            one
            for one in self.scenario.events
            if (one.at or 0.0) < self.scenario.time_limit
            and {one.robot, one.of if one.when in ("collision", "lost") else None} <= names
        )

    def referee_mission(self) -> model.Mission:
        """What is agreed for the run."""
        told = self.scenario
        return model.Mission(
            told.name,
            told.seed,
            told.time_limit,
            self.band,
            told.ends_when_all_credited,
            told.operators,
        )

    def referee_world(self) -> model.World:
        """What the referee knows of the world: `world.json` of a run."""
        reached = self.reached
        cells = np.zeros(reached.way.shape, dtype=np.uint8)
        cells[np.isfinite(reached.way)] = FREE
        cells[reached.walls] = WALL
        return model.World(
            self.scenario.title,
            self.base.lower,
            self.base.upper,
            tuple(
                model.Victim(one.name, _rounded(LiveVictim(one, 0).position(0.0)), one.status)
                for one in self.victims
            ),
            self.zones,
            tuple(
                model.Start(
                    robot.entry.name,
                    robot.description.name,
                    robot.start.pose.position,
                    rpy_from_quaternion(robot.start.pose.quaternion)[2],
                    fleet.fans_of(robot.description),
                )
                for robot in self.robots
            ),
            Grid(reached.x, reached.y, reached.cell, cells),
        )


def _placed(pose: Pose) -> dict[str, object]:
    turn = [math.degrees(angle) for angle in rpy_from_quaternion(pose.quaternion)]
    return {
        "position": list(map(float, pose.position)),
        "rotation_degrees": [round(angle, 9) + 0.0 for angle in turn],
    }


def _entry_place(victim: VictimEntry) -> Mapping[str, object]:
    assert victim.position is not None
    return {
        "position": list(victim.position),
        "yaw_degrees": victim.yaw_degrees,
        "posture": victim.posture,
    }


def _rounded(place: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = (round(part, 4) for part in place)
    return x, y, z
