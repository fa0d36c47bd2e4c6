"""What pages are shown of the world as it happens: pictures, scans, points, poses, lines.

Each is packed once, for all pages that want it.
"""

from __future__ import annotations

import itertools
import json
import math
import struct
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from usarsim_client import readings
from usarsim_client.scene import Poses
from usarsim_operator import packets
from usarsim_operator.robot_link import Driven
from usarsim_operator.roles import Role
from usarsim_operator.scene_link import Message

if TYPE_CHECKING:
    from usarsim_operator.station import Station

_FLAT = 0.3
"""m that an echo of a flat scan may be higher or lower than its scanner to be on the map."""


class Shows:
    """Hands on to the pages of one station."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self._sequence = itertools.count()
        self._mapped: dict[str, float] = {}

    def forget(self, robot: str) -> None:
        """A robot has left."""
        self._mapped.pop(robot, None)

    def scan(self, driven: Driven, scan: readings.LaserScan, now: float) -> None:
        viewers = [
            page for page in self._station.pages.values() if driven.name not in page.lasers_off
        ]
        if not self._station.pages and not self._station.autonomy.acts(driven.name):
            return
        place, turned = driven.mounts.pose(scan.name)
        driven.far = max(driven.far, float(max(scan.ranges, default=0.0)))
        limit = driven.clouds.limit(scan.name)
        most = limit if math.isfinite(limit) else driven.far
        if viewers:
            data = self._head(packets.SCAN, driven, scan.time) + packets.scan(
                scan.fov, most, place, turned, scan.ranges
            )
            for page in viewers:
                page.show("scan", driven.name, data)
        pose = driven.telemetry.place_at(scan.time)
        if not driven.telemetry.places_scans(now) or self._station.autonomy.carried(driven.name):
            return
        if pose is not None and now - self._mapped.get(driven.name, -1.0) >= 1.0:
            self._mapped[driven.name] = now
            x, y, yaw = pose
            ahead, right = math.cos(yaw), math.sin(yaw)
            x += ahead * place[0] - right * place[1]  # where the scanner is
            y += right * place[0] + ahead * place[1]
            reach = driven.telemetry.flat_reach(_FLAT)
            ranges = np.minimum(scan.ranges, reach)
            self._station.map.add((x, y, yaw + turned[2]), scan.bearings, ranges, min(most, reach))

    def points(self, driven: Driven, value: readings.Reading) -> None:
        """Tell points to those who are about this robot: no others draw them."""
        viewers = [
            page
            for page in self._station.pages.values()
            if page.selected == driven.name and driven.name not in page.lasers_off
        ]
        if not viewers:
            return
        seen = driven.clouds.feed(value, driven.telemetry.pose)
        if isinstance(value, readings.DepthStrip) and value.frame + 1 >= value.frames:
            driven.look()  # the picture is whole, or there is none: the next one
        if seen is not None:
            data = self._head(packets.POINTS, driven, value.time) + packets.points(seen)
            for page in viewers:
                page.show("points", driven.name, data)

    def _head(self, kind: int, driven: Driven, time: float) -> bytes:
        return packets.head(kind, driven.index, next(self._sequence), time)

    def picture(self, driven: Driven, jpeg: bytes, count: int) -> None:
        if driven.cut:  # it was under way
            return
        data = packets.head(packets.PICTURE, driven.index, count, driven.telemetry.time) + jpeg
        now = self._station.now
        for page in self._station.pages.values():
            slow = page.selected != driven.name and now - page.pictured.get(driven.name, 0.0) < 0.18
            if driven.name not in page.cameras_off and not slow:
                page.pictured[driven.name] = now
                page.show("picture", driven.name, data)

    def spectator(self, jpeg: bytes, count: int) -> None:
        """The world from outside, for those who may see it and cannot draw it themselves."""
        head = packets.head(packets.PICTURE, packets.SPECTATOR, count, self._station.time, flags=1)
        data = head + jpeg
        for page in self._station.pages.values():
            if page.role.sees_truth and not page.draws:
                page.show("picture", "", data)

    def poses(self, poses: Poses) -> None:
        """True poses, for those who may see them."""
        rest = struct.pack("<II", poses.generation, len(poses.rows)) + poses.rows.tobytes()
        head = packets.head(packets.POSES, packets.SPECTATOR, next(self._sequence), poses.time)
        data = head + rest
        for page in self._station.pages.values():
            if page.role.sees_truth:
                page.show("poses", "", data)

    def lines(self, message: Message) -> None:
        """Protocol lines, for those who want them."""
        by_robot: dict[str, list[dict[str, object]]] = {}
        for row in message.get("rows", ()):
            direction = "in" if "in" in row else "out"
            told = {
                "time": row.get("time"),
                "session": row.get("session"),
                "direction": direction,
                "text": row.get(direction, ""),
                "reading": row.get("reading", ""),
                "effect": row.get("effect", ""),
                "fault": "; ".join(map(str, row.get("faults", ()))),
            }
            by_robot.setdefault(row.get("robot") or "", []).append(told)
        for page in self._station.pages.values():
            if not page.wants_lines or page.role is not Role.INSTRUCTOR:
                continue
            for robot, rows in by_robot.items():
                if page.lines in (None, robot):
                    page.show(
                        "lines",
                        robot,
                        _text(
                            {"type": "lines", "robot": robot, "rows": rows[-50:]}
                            | {"lost": message.get("lost", 0) + max(0, len(rows) - 50)}
                        ),
                    )


def _text(message: Mapping[str, object]) -> str:
    return json.dumps(message, separators=(",", ":"))
