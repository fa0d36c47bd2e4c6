"""What a robot has reported, as pages are told it; no socket, no clock."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass

from usarsim_client import readings, reports
from usarsim_client.decoder import Value
from usarsim_client.reports import ItemGeometry
from usarsim_operator.world_clock import age

STALE = 1.0
"""s of age from which on a datum must not look alive."""
_THIN = 0.1  # m between two places of a way
_MOST_PLACES = 2000
_FULL = 90000  # s of battery from which on there is none
SOURCES = {"GroundTruth": 0, "INS": 1, "Odometry": 2}
"""Types that tell a pose, the best one first."""
_MOST_JOINTS = 32
_WEAK = 0.5  # s of silence
_NEAR = 0.5  # simulated s between two poses by which a third one is guessed

Pose = tuple[float, float, float, float, float, float]


@dataclass(slots=True)
class Heard:
    """A sensor: when it was heard last (s of the world's clock), and how often it reports."""

    type: str
    last: float
    period: float = 0.0

    @property
    def patience(self) -> float:
        """s after which it is stale; rare ones have two and a half of their periods."""
        return max(STALE, 2.5 * self.period)

    def stale(self, now: float) -> bool:
        """Whether it has not reported for too long."""
        return age(self.last, now) > self.patience


@dataclass(frozen=True, slots=True)
class Change:
    """Something that pages are told as an `event`."""

    kind: str
    value: object


class Telemetry:
    """The newest of everything of one robot.

    Attributes:
        pose: x, y, z (m), roll, pitch, yaw (rad); None before the first.
        source: what told it. time: simulated s of the newest report.
        path: its way so far, thinned; path_version counts changes.
    """

    def __init__(self) -> None:
        self.pose: Pose | None = None
        self.source = ""
        self.time = 0.0
        self.pose_time = 0.0
        self.speed = 0.0
        self.battery: float | None = None
        self.light = False
        self.joints: dict[str, float] = {}
        self._scanned: dict[str, None] = {}
        self.path: list[tuple[float, float]] = []
        self.path_version = 0
        self.sensors: dict[str, Heard] = {}
        self.bumpers: dict[str, bool] = {}
        self.last = -math.inf
        self._posed = -math.inf
        self._before: tuple[Pose | None, float] = None, 0.0
        self._places: dict[str, tuple[str, int]] = {}
        self._first_battery = 0.0
        self._loud = False
        self._first = math.inf

    # -- what is told ---------------------------------------------------------------------------

    def know_bumpers(self, items: Iterable[ItemGeometry]) -> None:
        """Where touch sensors are: those in front make one ring, from the left, the others too."""
        rings: dict[str, list[ItemGeometry]] = {"front": [], "rear": []}
        for item in items:
            rings["front" if item.location[0] >= 0.0 else "rear"].append(item)
        for ring, members in rings.items():
            for segment, item in enumerate(sorted(members, key=lambda one: one.location[1])):
                self._places[item.name] = ring, segment
                self.bumpers.setdefault(item.name, False)

    def feed(self, value: Value, now: float) -> list[Change]:
        """Take a value; what pages are to be told of it at once."""
        self.last = now
        match value:
            case readings.Reading():
                return self._sensor(value, now)
            case reports.Status():
                return self._status(value)
            case reports.Event():
                return [Change("battery" if "Battery" in value.event else "link", value.event)]
            case _:
                return []

    def _status(self, status: reports.Status) -> list[Change]:
        self.time = max(self.time, status.time)
        self.light = status.light
        self.joints = dict(itertools.islice(status.joints.items(), _MOST_JOINTS))
        seconds = status.battery
        if seconds is None or seconds >= _FULL:
            self.battery = None
        else:
            self._first_battery = max(self._first_battery, float(seconds), 1.0)
            self.battery = seconds / self._first_battery
        return []

    def hear(self, name: str, kind: str, now: float) -> None:
        """Note that a sensor reported, whatever it said."""
        self.last = now
        heard = self.sensors.get(name)
        if heard is None:
            if len(self.sensors) < 256:
                self.sensors[name] = Heard(kind, now)
        else:
            passed = min(age(heard.last, now), 10.0)
            heard.period += 0.2 * (passed - heard.period) if heard.period else passed
            heard.last = now

    def prefers(self, kind: str, now: float) -> bool:
        """Whether a pose of a type of sensor would be taken."""
        better = SOURCES[kind] > SOURCES.get(self.source, 9)
        return not better or now - self._posed >= STALE

    def wake(self, now: float) -> None:
        """Begin to look again at what nobody listened to: nothing of it is old by that."""
        self.last = now if self.last > -math.inf else self.last
        for heard in self.sensors.values():
            heard.last = now

    def _sensor(self, value: readings.Reading, now: float) -> list[Change]:
        if math.isfinite(value.time):
            self.time = max(self.time, value.time)
        self.hear(value.name, value.type, now)
        match value:
            case readings.Pose():
                self._at(type(value).__name__, (*value.location, *value.orientation), value, now)
            case readings.Odometry():
                self._at("Odometry", (value.x, value.y, 0.0, 0.0, 0.0, value.theta), value, now)
            case (
                readings.LaserScan()
                | readings.Scan3D()
                | readings.DepthStrip()
                | readings.PointCloud()
            ):
                if value.name in self.sensors:
                    self._scanned[value.name] = None
            case readings.Touch():
                return self._touch(value)
            case readings.Sound():
                return self._sound(value)
            case _:
                pass
        return []

    def _touch(self, value: readings.Touch) -> list[Change]:
        before = self.bumpers.get(value.name, False)
        if value.name not in self.bumpers and len(self.bumpers) >= 64:
            return []
        self.bumpers[value.name] = value.touched
        if before == value.touched:
            return []
        ring, segment = self._place(value.name)
        return [Change("bumper", {"ring": ring, "segment": segment, "pressed": value.touched})]

    def _sound(self, value: readings.Sound) -> list[Change]:
        """A noise that begins, dB; while it lasts there is nothing new."""
        before, self._loud = self._loud, value.loudness > 0.0
        return [Change("sound", round(value.loudness, 1))] if self._loud and not before else []

    def _place(self, name: str) -> tuple[str, int]:
        if name in self._places:
            return self._places[name]
        behind = any(part in name.lower() for part in ("rear", "back"))
        number = "".join(one for one in name if one.isdigit())
        return "rear" if behind else "front", int(number[-4:] or 0)

    def _at(self, source: str, pose: Pose, value: readings.Reading, now: float) -> None:
        if not all(math.isfinite(part) for part in pose):
            return
        self._first = min(self._first, now)
        if not self.prefers(source, now):
            return
        if self.source != source and "Odometry" in (self.source, source):
            self.path.clear()  # odometry counts from where the robot started: another frame
        passed = value.time - self.pose_time
        if self.pose is not None and self.source == source and passed > 1e-3:
            gone = math.dist(pose[:3], self.pose[:3])
            self.speed += 0.5 * (gone / passed - self.speed)
        self._before = (self.pose, self.pose_time) if self.source == source else (None, 0.0)
        self.pose, self.source, self._posed = pose, source, now
        self.pose_time = value.time if math.isfinite(value.time) else self.time
        if not self.path or math.dist(pose[:2], self.path[-1]) >= _THIN:
            self.path.append((pose[0], pose[1]))
            self.path_version += 1
            if len(self.path) > _MOST_PLACES:
                self.path = [*self.path[:-1:2], self.path[-1]]

    def forget_way(self) -> None:
        """Its way begins where it is now."""
        self.path.clear()
        self.path_version += 1

    def place_at(self, time: float) -> tuple[float, float, float] | None:
        """x, y (m), yaw (rad) at a simulated time near that of the newest pose, by its last two.

        None without a pose. A scan that is told before the pose of its instant needs that: a robot
        that turns has moved on by degrees since the pose before.
        """
        if self.pose is None:
            return None
        x, y, yaw = self.pose[0], self.pose[1], self.pose[5]
        before, passed = self._before[0], self.pose_time - self._before[1]
        late = time - self.pose_time
        if before is None or not 1e-3 < passed < _NEAR or abs(late) > _NEAR:
            return x, y, yaw
        share = late / passed
        turned = math.remainder(yaw - before[5], math.tau)
        return x + share * (x - before[0]), y + share * (y - before[1]), yaw + share * turned

    # -- what pages see -----------------------------------------------------------------------

    def pose_age(self, now: float) -> float:
        """s since the pose came."""
        return age(self._posed, now)

    def scan_age(self, now: float) -> float | None:
        """s since a scanner or range camera reported; None if there is none."""
        ages = [age(self.sensors[name].last, now) for name in self._scanned if name in self.sensors]
        return round(min(ages), 3) if ages else None

    def places_scans(self, now: float) -> bool:
        """Whether its pose is good for a map: odometry only where nothing better reports."""
        return self.source != "Odometry" or now - self._first > STALE

    @property
    def height(self) -> float:
        """m by the true pose; nan without: odometry tells none, and that of an INS drifts."""
        return math.nan if self.pose is None or self.source != "GroundTruth" else -self.pose[2]

    def flat_reach(self, off: float) -> float:
        """m from which on the plane of a flat scan is more than `off` m higher or lower than here.

        A robot that leans scans over walls at one side, and the ground at the other; one that is
        upside down scans the wrong side.
        """
        if self.pose is None or self.source == "Odometry":
            return math.inf
        if self.tipped:
            return 0.0
        upright = math.cos(self.pose[3]) * math.cos(self.pose[4])
        lean = math.sqrt(max(0.0, 1.0 - upright**2))
        return off / lean if lean > 0.0 else math.inf

    def link(self, now: float) -> str:
        """How the connection is: good, weak or lost."""
        silent = age(self.last, now)
        return "good" if silent < _WEAK else "weak" if silent < STALE else "lost"

    def stale(self, now: float) -> list[str]:
        """Names of sensors that have not reported for too long."""
        return [name for name, one in self.sensors.items() if one.stale(now)]

    def sensor_rows(self, now: float) -> list[dict[str, object]]:
        """Sensors as `state` tells them."""
        return [
            {
                "name": name,
                "type": one.type,
                "age": round(age(one.last, now), 3),
                "stale": one.stale(now),
                "rate_hz": round(1.0 / one.period, 1) if one.period > 1e-3 else 0.0,
            }
            for name, one in self.sensors.items()
        ]

    def bumper_rows(self) -> list[dict[str, object]]:
        """Bumpers as `state` tells them."""
        rows: list[dict[str, object]] = []
        for name, pressed in self.bumpers.items():
            ring, segment = self._place(name)
            rows.append({"ring": ring, "segment": segment, "pressed": pressed})
        return rows

    @property
    def tipped(self) -> bool:
        """Whether it lies more than 45 degrees from upright."""
        if self.pose is None or self.source == "Odometry":
            return False
        return math.cos(self.pose[3]) * math.cos(self.pose[4]) < math.cos(math.radians(45.0))
