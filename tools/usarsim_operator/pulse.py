"""What a station does by itself: watch its drivers, raise alarms, tell pages the state."""

from __future__ import annotations

import asyncio
import json
import math
from typing import Any

from usarsim_operator import packets
from usarsim_operator.robot_link import Driven
from usarsim_operator.signals import grade
from usarsim_operator.station import Station
from usarsim_operator.world_clock import age

WATCH = 0.02
"""s between two looks at the watchdog."""
STATE = 0.1
"""s between two `state`, and two looks for alarms."""
HASTY_STATE = 0.5
"""s between two `state` while simulated time goes as fast as it can."""
MAP = 1.0
"""s between two maps and ways."""


class Pulse:
    """Beats while a station runs; slowly while nobody is there."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._look_due = self._state_due = self._map_due = 0.0
        self._map_told: dict[int, int] = {}
        self._paths_told: dict[tuple[int, str], int] = {}
        self._links: dict[str, str] = {}
        self._rate: tuple[float, float] | None = None
        self.real_time_factor = 1.0

    async def run(self) -> None:
        """Beat until cancelled."""
        while True:
            if self._station.lockstep is not None:
                await self._station.lockstep.run(self)
            self.beat()
            await asyncio.sleep(WATCH if self._station.pages else 0.25)

    def restart(self) -> None:
        """Another clock counts from now on."""
        self._look_due = self._state_due = self._map_due = -math.inf
        self._station.world.restart()
        self._rate = None

    def beat(self) -> None:
        """Do what is due."""
        station, now = self._station, self._station.now
        for name in station.watchdog.overdue(now):
            if (driven := station.robots.get(name)) is not None:
                station.stop(driven, "no drive for too long")
                station.event(name, "wheel", 0.0, why="no drive for too long")
        lockstep = station.lockstep
        for id in station.watchdog.silent(now) if lockstep is None else lockstep.silent():
            if (page := station.pages.get(id)) is not None:
                page.end()
                station.leave(page)
        station.injects.beat()
        for waiting in station.arbiter.expired(now):
            request = station.asked.pop((waiting.robot, waiting.page), None)
            if (page := station.pages.get(waiting.page)) is not None:
                page.answer(request, False, "its holder did not answer")
        if now >= self._look_due:
            self._look_due = now + STATE
            if station.pages:
                self._alarms()
                if now >= self._state_due:
                    self._state_due = now + (HASTY_STATE if station.hasty else 0.0)
                    self._state(now)
        if now >= self._map_due and station.pages:
            self._map_due = now + MAP
            self._maps()

    # -- alarms -------------------------------------------------------------------------------

    def _alarms(self) -> None:
        station, heard = self._station, self._station.world.time
        self._links = {name: self._links.get(name, "good") for name in station.robots}
        present = station.scene.present if station.scene else None
        here = {thing.name: thing for thing in present.things} if present else {}
        for name, one in station.robots.items():
            if not one.own:
                continue
            told, time = one.telemetry, station.time
            battery = told.battery
            silent = told.link(heard) == "lost" and told.last > -math.inf
            signal = self._signal(one)
            lost = "link lost" if silent else f"the radio does not reach it ({signal} dBm)"
            causes = {
                "battery": (battery is not None and battery < 0.2, "battery below 20 %"),
                "tipped": (told.tipped, "it lies on its side"),
                "link": ((silent or grade(signal) == "lost") and not station.paused, lost),
            }
            stale = [] if station.paused or silent else told.stale(heard)
            causes["stale"] = bool(stale), f"no news of {', '.join(stale[:3])}"
            if (thing := here.get(name)) is not None:
                causes["stuck"] = thing.stuck, "it does not move"
            elif told.pose is not None:
                stuck = station.stuck[name].stuck(one.power, told.pose[:2], told.pose_time)
                causes["stuck"] = stuck, "it does not move"
            causes["collision"] = any(told.bumpers.values()), "a bumper is pressed"
            if (link := self._link(one)) != self._links[name]:
                station.event(name, "link", link, signal_dbm=signal)
            self._links[name] = link
            for kind, (on, text) in causes.items():
                station.alarms.see(name, kind, on, text, time)

    # -- what pages are told ------------------------------------------------------------------

    def _state(self, now: float) -> None:
        station = self._station
        self._measure(station.wall)
        if all(page.deaf for page in station.pages.values()):
            return
        alarms, hidden = station.alarms.shown()
        clock = station.scene.clock if station.scene else {}
        stop = station.arbiter.stop
        state = {
            "type": "state",
            "time": station.time,
            "began": station.began,
            "gateway_clock": station.wall,
            "paused": station.paused,
            "speed": clock.get("speed", 1.0),
            "real_time_factor": clock.get("real_time_factor", round(self.real_time_factor, 2)),
            "waits": station.waits,
            "estop": None if stop is None else {"by": stop.by, "time": stop.time},
            "mission": None if station.mission is None else station.mission.shown,
            "robots": [self._row(one, now) for one in station.robots.values()],
            "alarms": alarms,
            "alarms_hidden": hidden,
            "marks": station.marks.rows(),
        }
        texts: dict[bool, str] = {}
        true = state
        if any(page.role.sees_truth for page in station.pages.values()):
            true = self._with_truth(state)
        for page in station.pages.values():
            truth = page.role.sees_truth
            told = true if truth else state
            if page.cameras_off or page.lasers_off:
                page.show("state", "", _text(_own(told, page.cameras_off, page.lasers_off)))
                continue
            if truth not in texts:
                texts[truth] = _text(told)
            page.show("state", "", texts[truth])

    def _with_truth(self, state: dict[str, object]) -> dict[str, object]:
        """The state for those who see the truth: poses of robots that tell us none, and zones."""
        station, scene = self._station, self._station.scene
        if scene is None:
            return state
        rows, zones = [], scene.zones
        assert isinstance(state["robots"], list)
        for row, one in zip(state["robots"], station.robots.values(), strict=True):
            true = None
            if not one.own:
                true = station.truth.row(one.name, scene.present, station.world.time)
            row = {**row, **(true or {})}
            rows.append({**row, "zone": _zone_of(row["pose"], zones)})
        more = {"zones": zones, "victims": scene.victims}
        return {**state, "robots": rows, **{key: one for key, one in more.items() if one}}

    def _measure(self, now: float) -> None:
        time = self._station.time
        if self._rate is not None and now - self._rate[0] >= 1.0:
            self.real_time_factor = max(0.0, (time - self._rate[1]) / (now - self._rate[0]))
            self._rate = now, time
        elif self._rate is None:
            self._rate = now, time

    def _row(self, one: Driven, now: float) -> dict[str, object]:
        station, told = self._station, one.telemetry
        heard = station.world.time
        holder = station.arbiter.holders.get(one.name)
        feed = station.cameras.get(one.name)
        held: dict[str, object] | None = None
        if holder is not None:
            held = {"page": holder.page, "name": holder.name}
        elif not one.own:
            held = {"page": None, "name": one.session or "its controller"}
        scan_age = told.scan_age(heard)
        return {
            "name": one.name,
            "index": one.index,
            "class": one.class_name,
            "kind": one.motion.kind,
            "own": one.own,
            "pose": None if told.pose is None else [round(part, 4) for part in told.pose],
            "pose_source": told.source or None,
            "pose_age": round(told.pose_age(heard), 3),
            "speed": round(told.speed, 3),
            "battery": None if told.battery is None else round(told.battery, 4),
            "light": told.light,
            "joints": {
                name: round(value, 4) for name, value in told.joints.items() if math.isfinite(value)
            },
            "learned": one.learned or not one.own,
            "enabled": one.name not in station.arbiter.disabled,
            "failed": one.name in station.arbiter.failed,
            "mode": station.autonomy.mode(one),
            "policy": station.autonomy.policy(one.name) if one.own else None,
            "zone": None,
            "link": {
                "state": self._link(one),
                "age": round(age(told.last, heard), 3) if one.own else 0.0,
                "signal_dbm": self._signal(one),
            },
            "holder": held,
            "seat": station.settings.allowance.split.get(one.name),
            "sensors": told.sensor_rows(heard),
            "bumpers": told.bumper_rows(),
            "camera": None
            if feed is None
            else {
                "on": True,
                "age": round(age(feed.last, station.wall), 3),
                "rate_hz": feed.rate,
                "dropped": 0,
                **_view(one),
            },
            "laser": None if scan_age is None else {"on": True, "age": scan_age},
            "path": len(told.path),
        }

    def _signal(self, one: Driven) -> float | None:
        signals = self._station.signals
        return None if signals is None else signals.dbm.get(one.name)

    def _link(self, one: Driven) -> str:
        """How a robot is reached, by its silence and by its signal; the worse of both."""
        heard = one.telemetry.link(self._station.world.time) if one.own else "good"
        return max(heard, grade(self._signal(one)), key=("good", "weak", "lost").index)

    def _maps(self) -> None:
        station = self._station
        for name in {page.selected for page in station.pages.values()}:
            if name in station.robots:
                station.robots[name].look()
        packed: bytes | None = None
        version = station.map.version
        self._map_told = {id: one for id, one in self._map_told.items() if id in station.pages}
        self._paths_told = {
            key: one for key, one in self._paths_told.items() if key[0] in station.pages
        }
        paths: dict[str, bytes] = {}
        for page in station.pages.values():
            if page.deaf:
                continue
            if version and self._map_told.get(page.id) != version:
                self._map_told[page.id] = version
                if packed is None:
                    packed = packets.head(packets.MAP, packets.SPECTATOR, version, station.time)
                    packed += station.map.packed()
                page.show("map", "", packed)
            for name, one in station.robots.items():
                told = one.telemetry
                if told.path and self._paths_told.get((page.id, name)) != told.path_version:
                    self._paths_told[page.id, name] = told.path_version
                    if name not in paths:
                        head = packets.head(
                            packets.PATH, one.index, told.path_version, told.pose_time
                        )
                        paths[name] = head + packets.path(told.path)
                    page.show("path", name, paths[name])


def _view(one: Driven) -> dict[str, object]:
    """Where a robot's camera is now, where it looks, how wide it sees, and what turns it."""
    place, (_, _, yaw) = one.mounts.pose(one.camera)
    mount = [round(part, 4) for part in place]
    turned = {key: round(angle, 4) for key, angle in one.mounts.turned(one.camera).items()}
    return {
        "fov": one.fov or None,
        "mount": mount,
        "yaw": round(yaw, 4),
        "turned": turned if one.own else None,
    }


def _text(state: object) -> str:
    return json.dumps(state, separators=(",", ":"), allow_nan=False)


def _zone_of(pose: list[float] | None, zones: list[dict[str, Any]]) -> str | None:
    """Colour of the first zone that holds the centre of a robot."""
    if pose is None:
        return None
    held = (zone for zone in zones if _holds(zone["corners"], pose[0], pose[1]))
    return next((str(zone["colour"]) for zone in held), None)


def _holds(corners: list[list[float]], x: float, y: float) -> bool:
    """Whether a polygon holds a place, by the number of sides that a ray to +x crosses."""
    inside = False
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return inside


def _own(state: dict[str, object], cameras_off: set[str], lasers_off: set[str]) -> object:
    """The state as a page sees it that has switched some pictures or scans off."""
    rows = []
    robots = state["robots"]
    assert isinstance(robots, list)
    for row in robots:
        changed = dict(row)
        for key, off in (("camera", cameras_off), ("laser", lasers_off)):
            if row[key] is not None and row["name"] in off:
                changed[key] = {**row[key], "on": False}
        rows.append(changed)
    return {**state, "robots": rows}
