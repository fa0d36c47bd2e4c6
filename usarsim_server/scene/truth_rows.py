"""Rows of the truth: robots, victims, what touches what, who is in whose sight, at one instant.

The format is on the page of the scene port (docs/scene-port.md, "Truth"). A row depends on nothing
but the instant: equal worlds give equal bytes.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_server.protocol.scene import message
from usarsim_server.simulation.frames import Array, Pose
from usarsim_server.simulation.rays.query import PendingReport, RayFan
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.simulation.touching import Touches
from usarsim_server.worlds.surroundings import LiveVictim
from usarsim_server.worlds.victims import part_of

HALF_ANGLE = math.radians(60.0)
"""rad off the axis of a camera within which victims are looked for."""
REACH = 30.0
"""m; likewise."""
DIGITS = 6
"""Decimals of all numbers: micrometres, microseconds."""


@dataclass(frozen=True, slots=True)
class Being:
    """One robot."""

    name: str
    body: int  # number in the simulation
    cameras: Sequence[tuple[str | None, Pose]]  # link (None: chassis), pose on it; looks along x
    battery: Callable[[float], float | None]  # share that is left at a simulated time (s)


@dataclass(frozen=True, slots=True)
class Moment:
    """What a row is made of; nothing of it changes any more."""

    snapshot: Snapshot
    touches: Touches
    beings: Sequence[Being]


@dataclass(frozen=True, slots=True)
class _Look:
    """A camera with victims before it."""

    robot: Being
    found: Sequence[tuple[int, float, float]]
    """Number of each victim, how far off the axis it is (rad), and how far away (m)."""
    fan: RayFan  # to all parts of the first, of the second, ...


def victim_of(geom: str) -> str | None:
    """The victim that a geom belongs to, by the names that rays give; None if to none."""
    found = part_of(geom)
    return None if found is None else found[0]


class TruthRows:
    """Makes the rows of one world; for one thread."""

    def __init__(
        self,
        simulation: Simulation,
        victims: Sequence[LiveVictim],
        label: Callable[[int], str | None],
    ) -> None:
        """Know the world.

        Args:
            simulation: its physics.
            victims: whom to look for, in the order of the rows.
            label: name of a thing or avatar that a client brought, by its number.
        """
        self._simulation, self._victims, self._label = simulation, victims, label
        self._generation: int | None = None
        self._bodies: list[int] = []
        self._names: dict[str, str] = {}

    def row(self, moment: Moment) -> bytes:
        """The whole frame that tells of a moment."""
        snapshot = moment.snapshot
        if snapshot.generation != self._generation:
            model = self._simulation.compiled(snapshot).model
            self._bodies = [model.body(f"victim:{one.name}").id for one in self._victims]
            self._names, self._generation = {}, snapshot.generation
        there = sorted(
            (one for one in moment.beings if one.body in snapshot.layouts), key=lambda one: one.name
        )
        places = snapshot.xpos[self._bodies].reshape(-1, 3)
        contacts = self._contacts(moment, there)
        return message(
            {
                "type": "truth",
                "time": round(snapshot.time, DIGITS),
                "state": _digest(snapshot),
                "robots": [_robot(snapshot, one, contacts[one.body]) for one in there],
                "victims": [
                    {"name": victim.name, "pos": _rounded(place)}
                    for victim, place in zip(self._victims, places, strict=True)
                ],
                "views": self._views(snapshot, there, places),
            }
        )

    # -- touching ----------------------------------------------------------------------------

    def _contacts(
        self, moment: Moment, there: Sequence[Being]
    ) -> Mapping[int, list[dict[str, object]]]:
        """What each robot has touched, by number; the first time of each."""
        robots = {one.body: one.name for one in there}
        firsts: dict[int, dict[tuple[str, str], float]] = {body: {} for body in robots}
        for pair, time in moment.touches.items():
            if pair.body not in robots:
                continue
            if pair.other in robots:
                key = "robot", robots[pair.other]
            elif pair.other is not None:
                if pair.borne:  # it stands on it
                    continue
                key = "world", self._label(pair.other) or ""
            else:
                victim = None if pair.name is None else victim_of(pair.name)
                key = ("victim", victim) if victim else ("world", self._name(pair.name, moment))
            found = firsts[pair.body]
            found[key] = min(time, found.get(key, math.inf))
        return {
            body: [
                {"with": kind, "name": name, "time": time}
                for (kind, name), time in sorted(found.items())
            ]
            for body, found in firsts.items()
        }

    def _name(self, geom: str | None, moment: Moment) -> str:
        """What a part of the scene belongs to."""
        if geom is None:
            return ""
        if geom not in self._names:
            facts = self._simulation.object_facts(geom, moment.snapshot)
            self._names[geom] = geom if facts is None else facts.name
        return self._names[geom]

    # -- seeing ------------------------------------------------------------------------------

    def _views(
        self, snapshot: Snapshot, there: Sequence[Being], places: Array
    ) -> list[dict[str, object]]:
        """Every victim before a camera; of the cameras of a robot the one that sees it best."""
        parts = _Parts(self._victims, snapshot.time)
        looks = [look for one in there for look in _looks(snapshot, one, places, parts)]
        if not looks:
            return []
        reports = [PendingReport(snapshot, look.robot.body, (look.fan,)) for look in looks]
        best: dict[tuple[str, int], tuple[bool, float, float]] = {}
        for look, (hits,) in zip(looks, self._simulation.cast_all(reports), strict=True):
            met, names = 0, hits.names or ()
            for index, angle, distance in look.found:
                own = names[met : met + len(parts[index])]
                met += len(parts[index])
                # Geoms of a victim are named `victim:NAME:PART`.
                head = f"victim:{self._victims[index].name}:"
                hidden = not any(name is not None and name.startswith(head) for name in own)
                key, view = (look.robot.name, index), (hidden, angle, distance)
                best[key] = min(best.get(key, view), view)
        return [
            {
                "robot": robot,
                "victim": self._victims[index].name,
                "angle": round(angle, DIGITS),
                "distance": round(distance, DIGITS),
                "clear": not hidden,
            }
            for (robot, index), (hidden, angle, distance) in best.items()
        ]


class _Parts(dict[int, Array]):
    """Middles (n, 3) of the parts of victims, by number, worked out when they are asked for."""

    def __init__(self, victims: Sequence[LiveVictim], time: float) -> None:
        self._victims, self._time = victims, time

    def __missing__(self, index: int) -> Array:
        parts = self._victims[index].parts(self._time)
        self[index] = np.array([part.position for part in parts])
        return self[index]


def _looks(
    snapshot: Snapshot, one: Being, places: Array, parts: Mapping[int, Array]
) -> Iterator[_Look]:
    """What each camera of a robot may see."""
    state = RobotBody(snapshot, snapshot.layouts[one.body])
    for link, mount in one.cameras:
        eye = (state.pose if link is None else state.link_pose(link)) @ mount
        origin = np.array(eye.position)
        ways = places - origin
        distances = np.linalg.norm(ways, axis=1)
        along = ways @ np.array(eye.rotate((1.0, 0.0, 0.0)))
        angles = np.arctan2(np.sqrt(np.maximum(distances**2 - along**2, 0.0)), along)
        near = np.flatnonzero((distances <= REACH) & (angles <= HALF_ANGLE)).tolist()
        if near:
            ways = np.concatenate([parts[index] for index in near]) - origin
            lengths = np.linalg.norm(ways, axis=1)
            ways = ways / np.maximum(lengths, 1e-9)[:, None]
            fan = RayFan(
                *(origin, ways, float(lengths.max()) + 0.1), through_glass=True, identify=True
            )
            found = [(index, float(angles[index]), float(distances[index])) for index in near]
            yield _Look(one, found, fan)


def _robot(snapshot: Snapshot, one: Being, contacts: list[dict[str, object]]) -> dict[str, object]:
    layout = snapshot.layouts[one.body]
    state, free = RobotBody(snapshot, layout), layout.dof >= 0
    battery = one.battery(snapshot.time)
    spin = state.pose.rotate(state.angular_velocity) if free else (0.0, 0.0, 0.0)
    return {
        "name": one.name,
        "pos": _rounded(state.pose.position),
        "quat": _rounded(state.pose.quaternion),
        "linear": _rounded(state.linear_velocity if free else (0.0, 0.0, 0.0)),
        "angular": _rounded(spin),
        "battery": None if battery is None else round(battery, DIGITS),
        "contacts": contacts,
    }


def _rounded(values: Sequence[float] | Array) -> list[float]:
    return [round(float(value), DIGITS) + 0.0 for value in values]


def _digest(snapshot: Snapshot) -> str:
    """Of all coordinates and velocities, to the last bit."""
    state = snapshot.qpos.tobytes() + snapshot.qvel.tobytes()
    return hashlib.blake2b(state, digest_size=16).hexdigest()
