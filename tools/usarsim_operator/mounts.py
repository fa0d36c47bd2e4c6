"""Where sensors are on their robot, also those that arms, masts and pan-tilts carry.

GEO tells a sensor relative to its carrier, and a carrier as a chain of links: each frame is
relative to its parent, and its z is the axis of the joint. A sensor on a link keeps the directions
of the robot while all joints are at zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from usarsim_client import frames
from usarsim_client.reports import (
    ItemConfiguration,
    ItemGeometry,
    LinkGeometry,
    MissionState,
)
from usarsim_server.protocol.values import Vector

Matrix = NDArray[np.float64]
"""(4, 4): turns and moves points of a sensor into the frame of its robot."""

_MOST_LINKS = 32  # of a chain


class Mounts:
    """All places of one robot."""

    def __init__(self) -> None:
        self._items: dict[str, ItemGeometry] = {}
        self._links: dict[str, dict[int, LinkGeometry]] = {}
        self._sliding: set[tuple[str, int]] = set()
        self._values: dict[str, dict[int, float]] = {}
        self._found: dict[str, Matrix] = {}
        self._posed: dict[str, tuple[Vector, Vector]] = {}

    def know(self, items: Iterable[ItemGeometry]) -> None:
        """Sensors, as GEO tells them."""
        self._items.update({item.name: item for item in items})
        self._forget()

    def know_carriers(
        self, items: Iterable[ItemGeometry], conf: Iterable[ItemConfiguration]
    ) -> None:
        """Mission packages and actuators, as GEO and CONF tell them."""
        for item in items:
            self._links[item.name.lower()] = {link.link: link for link in item.links}
        for one in conf:
            for link in one.links:
                if link.get("jointtype", "").lower() == "prismatic":
                    self._sliding.add((one.name.lower(), int(link.get("link", "0") or 0)))
        self._forget()

    def moved(self, state: MissionState) -> None:
        """Where the joints of a carrier are now."""
        if state.name.lower() in self._links:
            values = {one.link: one.value for one in state.links}
            if self._values.get(state.name.lower()) != values:
                self._values[state.name.lower()] = values
                self._forget()

    def _forget(self) -> None:
        self._found.clear()
        self._posed.clear()

    def of(self, name: str) -> Matrix:
        """Where a sensor is now; at the origin of its robot if nothing is known of it."""
        found = self._found.get(name)
        if found is None:
            found = self._of(name)
            if name in self._items:
                self._found[name] = found
        return found

    def _of(self, name: str) -> Matrix:
        item = self._items.get(name)
        if item is None or not all(map(math.isfinite, (*item.location, *item.orientation))):
            return np.eye(4)
        own = _matrix(item.location, item.orientation)
        carrier = item.mount.lower()
        if item.mount_link is None or item.mount_link not in self._links.get(carrier, {}):
            return own
        now, zero = np.eye(4), np.eye(4)
        for link in self._chain(carrier, item.mount_link):
            step = _matrix(link.location, link.orientation)
            value = self._values.get(carrier, {}).get(link.link, 0.0)
            joint = np.eye(4)
            if (carrier, link.link) in self._sliding:
                joint[2, 3] = value
            elif math.isfinite(value):
                joint[:3, :3] = frames.rotation_matrix((0.0, 0.0, value))
            now, zero = now @ step @ joint, zero @ step
        now[:3, :3] = now[:3, :3] @ zero[:3, :3].T
        return now @ own

    def pose(self, name: str) -> tuple[Vector, Vector]:
        """The same as place (m) and roll, pitch, yaw (rad)."""
        if name in self._posed:
            return self._posed[name]
        place = self.of(name)
        x, y, z = (float(one) for one in place[:3, 3])
        pitch = math.asin(min(1.0, max(-1.0, -place[2, 0])))
        roll = math.atan2(place[2, 1], place[2, 2])
        found = (x, y, z), (roll, pitch, math.atan2(place[1, 0], place[0, 0]))
        if name in self._items:
            self._posed[name] = found
        return found

    def joints(self, name: str) -> tuple[str, dict[str, tuple[int, float]]]:
        """Carrier of a sensor, and the links that `pan` and `tilt` it.

        Each as its number and 1 if it turns to the right or up, -1 if it turns the other way.
        """
        item = self._items.get(name)
        if item is None or item.mount_link is None or item.mount.lower() not in self._links:
            return "", {}
        found, place = dict[str, tuple[int, float]](), np.eye(4)
        for link in self._chain(item.mount.lower(), item.mount_link):
            place = place @ _matrix(link.location, link.orientation)
            _, right, down = place[:3, 2]  # its axis in the frame of the robot
            which, along = ("pan", down) if abs(down) > abs(right) else ("tilt", right)
            found.setdefault(which, (link.link, math.copysign(1.0, along)))
        return item.mount, found

    def turned(self, name: str) -> dict[str, float]:
        """How far a sensor is turned by each of them: `pan` to the right, `tilt` up, rad."""
        carrier, joints = self.joints(name)
        values = self._values.get(carrier.lower(), {})
        return {which: sign * values.get(link, 0.0) for which, (link, sign) in joints.items()}

    def _chain(self, carrier: str, last: int) -> list[LinkGeometry]:
        """Links of a carrier from the base on."""
        links, chain = self._links[carrier], list[LinkGeometry]()
        while (link := links.get(last)) is not None and len(chain) < _MOST_LINKS:
            chain.append(link)
            last = link.parent
        return chain[::-1]


def _matrix(location: Vector, orientation: Vector) -> Matrix:
    place = np.eye(4)
    place[:3, :3] = frames.rotation_matrix(orientation)
    place[:3, 3] = location
    return place
