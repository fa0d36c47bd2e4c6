"""What one avatar does with MOVE and GOTO, and what it reports (protocol reference 3.13, 4.4).

Used by one thread at a time.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_server.base.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.requests import Goto, Move, Request
from usarsim_server.protocol.values import Dialect, near
from usarsim_server.sessions.schedule import Role, Schedule, first_report
from usarsim_server.simulation.frames import Vector, flip_point, wire_from_pose
from usarsim_server.simulation.rays.query import PendingReport
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.avatars.avatars import Avatar, Avatars
from usarsim_server.worlds.avatars.bodies import AvatarClass
from usarsim_server.worlds.avatars.walk import (
    RUNNING,
    WALKING,
    Gait,
    Leg,
    Stance,
    Walk,
    bone_rotation,
    posture,
)
from usarsim_server.worlds.avatars.ways import Survey, distances_to, find_node, survey, way_to
from usarsim_server.worlds.description import PathNode

REPORT_INTERVAL = 0.05
"""s between two STA (protocol 4.4)."""
MOST_ERRANDS = 1000
"""Places that may wait to be walked to."""
MOST_POINTS = 20_000
"""Points of the ground on the way to all of them: 2 km. What lies beyond is not walked to."""

_BONES = (
    ("LeftArm", "upper_arm_left"),
    ("LeftForeArm", "forearm_left"),
    ("RightArm", "upper_arm_right"),
    ("RightForeArm", "forearm_right"),
)
"""Names of the bones in BSTA and the limbs that they move."""

_HALF_SPEED = 0.5


@dataclass(frozen=True, slots=True)
class _Manner:
    """How to get somewhere: speed (m/s), kind of walking, face pointing back."""

    speed: float
    gait: Gait
    backward: bool = False


@dataclass(frozen=True, slots=True)
class _Errand:
    """One place (x and y, m) to walk to, and how."""

    place: tuple[float, float]
    manner: _Manner


class Walker(Role):
    """Conducts one avatar on behalf of one client.

    Attributes:
        schedule: of STA and BSTA, which come together.
        slow: where it may walk is surveyed with many rays.
    """

    slow = True
    dialect = Dialect.UDK

    def __init__(
        self,
        avatar: Avatar,
        avatars: Avatars,
        nodes: Sequence[PathNode],
        simulation: Simulation,
        quiet_period: float,
        log: Log,
    ) -> None:
        """Take over an avatar that has just been spawned.

        Args:
            avatar: the avatar.
            avatars: all of them, to leave them at the end.
            nodes: the path nodes of the world.
            simulation: the world.
            quiet_period: simulated s after spawning without reports (protocol 1.8).
            log: names the connection and the avatar.
        """
        self.name, self.body = avatar.name, avatar.handle
        self._avatar = avatar
        self._avatars = avatars
        self._nodes = nodes
        self._simulation = simulation
        self._quiet_period = quiet_period
        self._log = log
        self._walk = Walk(0.0, avatar.begin)
        self._errands: tuple[_Errand, ...] = ()
        self._seen: dict[tuple[Vector, tuple[float, float]], Survey] = {}
        """Ways of the latest plan by start, to the millimetre, and goal. Scenery never moves."""
        self.schedule = Schedule(
            [REPORT_INTERVAL], lambda now: first_report(now, now, self._quiet_period)
        )

    # -- the role of a connection ------------------------------------------------------------

    def leave(self) -> None:
        self._avatars.remove(self._avatar)

    def restart(self, time: float) -> None:
        """Stand as in the beginning, with nowhere to go."""
        self._errands = ()
        begin = self._avatar.begin
        with contextlib.suppress(KeyError):  # it has left the world
            self._walk = self._avatar.perform(lambda now: Walk(now, begin))

    def obey(self, request: Request) -> list[str]:
        """Carry out a request; none of them is answered."""
        match request:
            case Move():
                self._move(request)
            case Goto():
                self._go_to(request.name, _manner(self._avatar.kind, None), append=False)
            case _:
                self._log.debug("an avatar ignores", request=type(request).__name__)
        return []

    def read(self, snapshot: Snapshot, due: Sequence[int]) -> PendingReport | None:
        state = self._avatar.state(snapshot)
        if state is None or not due:
            return None
        location, orientation = wire_from_pose(state.pose)
        stance = self._walk.stance(snapshot.time)
        if self._walk.legs and snapshot.time > self._walk.end:
            self._halt()  # nobody has to place a body any more that stays where it is
        status = messages.AvatarStatus(
            time=snapshot.time,
            class_name=self._avatar.kind.name,
            name=self._avatar.name,
            location=location,
            orientation=orientation,
            walking=stance.walking,
        )
        held = posture(stance.gait, stance.way, stance.swing, self._avatar.kind.height)
        bones = [(bone, bone_rotation(held.angles[limb])) for bone, limb in _BONES]
        told = [
            messages.avatar_status(status),
            messages.avatar_bones(snapshot.time, self._avatar.name, bones),
        ]
        return PendingReport(snapshot, finish=lambda hits: told)

    # -- going -------------------------------------------------------------------------------

    def _move(self, request: Move) -> None:
        action = (request.action or "New").strip().lower()
        if action == "pause":
            self._halt()
            return
        if action == "resume":
            self._set_out(self._halt())
            return
        if action not in ("new", "append"):
            self._log.info("unknown action of MOVE ignored", action=request.action)
            return
        manner = _manner(self._avatar.kind, request.type)
        append = action == "append"
        if request.location is not None:
            x, y, _ = flip_point((*request.location, 0.0))
            self._take_up([_Errand((x, y), manner)], append)
        elif request.pathnode is not None:
            self._go_to(request.pathnode, manner, append)

    def _go_to(self, tag: str, manner: _Manner, append: bool) -> None:
        """Walk along the path nodes to the one of a tag; an unknown one is ignored."""
        goal = find_node(self._nodes, tag)
        if goal is None:
            hint = near(tag, (node.tag for node in self._nodes))
            self._log.info(f"unknown path node ignored{hint}", node=tag)
            return
        stance = self._halt()
        start = stance.ground
        if append and self._errands:
            x, y = self._errands[-1].place
            start = (x, y, stance.ground[2])
        way = [
            _Errand((node.position[0], node.position[1]), manner) for node in self._way(start, goal)
        ]
        self._take_up(way, append)

    def _way(self, start: Vector, goal: PathNode) -> list[PathNode]:
        """Path nodes from a place to a goal; the first one is in sight if any is."""
        left = distances_to(self._nodes, goal.tag)
        known = [node for node in self._nodes if node.tag in left]
        known.sort(key=lambda node: math.dist(node.position[:2], start[:2]) + left[node.tag])
        for node in known:
            if survey(self._simulation, start, node.position[:2]).obstacle is None:
                return way_to(self._nodes, node.tag, goal.tag)
        nearest = min(known, key=lambda node: math.dist(node.position[:2], start[:2]))
        return way_to(self._nodes, nearest.tag, goal.tag)

    def _take_up(self, errands: Sequence[_Errand], append: bool) -> None:
        stance = self._halt()
        kept = self._errands if append else ()
        self._errands = (*kept, *errands)[:MOST_ERRANDS]
        self._set_out(stance)

    def _halt(self) -> Stance:
        """Stand still where one is, and strike off what is done; how one stands."""
        if not self._walk.legs:
            return self._walk.stance(self._walk.begin)
        moment: list[float] = []

        def stop(time: float) -> Walk:
            moment.append(time)
            return Walk(time, self._walk.stance(time))

        try:
            stopped = self._avatar.perform(stop)
        except KeyError:  # it has left the world
            return self._walk.first
        done = self._walk.leg_at(moment[0])
        numbers = {leg.number for leg in self._walk.legs[done:]}
        self._errands = tuple(
            errand for number, errand in enumerate(self._errands) if number in numbers
        )
        self._walk = stopped
        return stopped.first

    def _set_out(self, stance: Stance) -> None:
        """Plan the way to all errands from where one stands, and go."""
        known, self._seen = self._seen, {}
        legs, reached, points = [], stance.ground, 0
        for number, errand in enumerate(self._errands):
            if math.dist(reached[:2], errand.place) < 1e-3:
                continue
            x, y, z = reached
            way = ((round(x, 3), round(y, 3), round(z, 3)), errand.place)
            seen = known.get(way) or survey(self._simulation, reached, errand.place)
            self._seen[way] = seen
            legs.append(_leg(seen.profile, errand, number))
            reached = seen.profile[-1]
            points += len(seen.profile)
            blocked = seen.obstacle or ("the length of all ways" if points > MOST_POINTS else None)
            if blocked is not None:
                self._log.info("the way is blocked", by=blocked, at=reached)
                self._errands = self._errands[: number + 1]
                break
        try:
            self._walk = self._avatar.perform(lambda time: Walk(time, stance, tuple(legs)))
        except KeyError:
            self._log.debug("the avatar has left the world")


def _manner(kind: AvatarClass, gait: str | None) -> _Manner:
    wanted = (gait or "").strip().lower()
    if wanted == "run":
        return _Manner(kind.run_speed, RUNNING)
    if wanted == "walk_backward":
        return _Manner(kind.walk_speed * _HALF_SPEED, WALKING, backward=True)
    return _Manner(kind.walk_speed, WALKING)


def _leg(profile: tuple[Vector, ...], errand: _Errand, number: int) -> Leg:
    (x, y, _), manner = profile[0], errand.manner
    heading = math.atan2(errand.place[1] - y, errand.place[0] - x)
    if manner.backward:
        heading += math.pi
    return Leg(profile, heading, manner.speed, manner.gait, manner.backward, number)
