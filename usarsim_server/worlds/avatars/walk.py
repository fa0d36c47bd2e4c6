"""A walk from place to place as a pure function of simulated time.

How limbs swing when somebody walks: a pure function of the way walked.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from usarsim_server.simulation.frames import Pose, Quaternion, Vector, wrap_signed
from usarsim_server.worlds.avatars.bodies import ADULT, LIMBS, PELVIS, SHIN, SOLE, THIGH, joint_of


@dataclass(frozen=True, slots=True)
class Gait:
    """How far limbs swing (rad) in a kind of walking.

    Attributes:
        stride: m of way for two steps, of an adult of 1.70 m.
        thigh: to both sides. knee: bent most when the leg comes forward.
        arm: to both sides. elbow: bent all the time.
    """

    stride: float
    thigh: float
    knee: float
    arm: float
    elbow: float


STANDING = Gait(stride=1.0, thigh=0.0, knee=0.0, arm=0.0, elbow=0.0)
WALKING = Gait(stride=1.40, thigh=0.35, knee=0.75, arm=0.35, elbow=0.25)
RUNNING = Gait(stride=2.40, thigh=0.65, knee=1.35, arm=0.75, elbow=1.40)


@dataclass(frozen=True, slots=True)
class Posture:
    """Angles of the joints, rad, forward positive, and how far the hips sink."""

    angles: Mapping[str, float]  # by limb, relative to what it hangs on
    sink: float  # m that the pelvis is lower than when the legs are straight


def posture(gait: Gait, way: float, swing: float, height: float) -> Posture:
    """The posture of a person of some height (m) after a way (m, negative backwards).

    `swing` tells how far into the gait, from 0 (standing) to 1.
    """
    scale = height / ADULT
    phase = math.tau * way / (gait.stride * scale)
    angles: dict[str, float] = {}
    lowest = 0.0
    for side, lag in (("left", 0.0), ("right", math.pi)):
        leg = swing * gait.thigh * math.sin(phase + lag)
        # The knee bends while the thigh comes forward, and the leg is straight while it carries.
        knee = swing * gait.knee * max(0.0, math.cos(phase + lag)) ** 2
        angles[f"thigh_{side}"] = leg
        angles[f"shin_{side}"] = -knee
        angles[f"upper_arm_{side}"] = swing * gait.arm * math.sin(phase + lag + math.pi)
        angles[f"forearm_{side}"] = swing * gait.elbow
        reach = THIGH * math.cos(leg) + (SHIN + SOLE) * math.cos(leg - knee)
        lowest = max(lowest, reach)
    return Posture(angles, scale * (THIGH + SHIN + SOLE - lowest))


def limb_poses(base: Pose, held: Posture, height: float) -> list[Pose]:
    """Poses of all bodies of an avatar in the world, the trunk first."""
    poses = [base]
    above = base
    for limb in LIMBS:
        hangs_on = base if limb.startswith(("thigh", "upper")) else above
        above = hangs_on @ Pose(joint_of(limb, height), _forward(held.angles[limb]))
        poses.append(above)
    return poses


def _forward(angle: float) -> Quaternion:
    """Turns what hangs down forward, about the -y axis."""
    return (math.cos(angle / 2.0), 0.0, -math.sin(angle / 2.0), 0.0)


def bone_rotation(angle: float) -> Vector:
    """Roll, pitch, yaw (rad, wire frame) of a limb that swings forward, relative to the body.

    A limb that hangs down and swings forward is raised: its pitch is positive.
    """
    return 0.0, angle, 0.0


TURN_RATE = 3.0
"""rad/s on the spot."""
RAMP = 0.3
"""s in which limbs begin to swing, and in which they come to rest."""
STRAIGHT_ON = 0.3
"""rad: a smaller turn is made without a halt of the limbs."""


@dataclass(frozen=True, slots=True)
class Stance:
    """Somebody at an instant.

    Attributes:
        ground: the point of the ground below, m. yaw: where the face points, rad.
        way: m walked so far; backwards it shrinks.
        swing: how far into the gait, 0 to 1. gait: the kind of walking.
        walking: under way, not only turning limbs at rest.
    """

    ground: Vector
    yaw: float
    way: float = 0.0
    swing: float = 0.0
    gait: Gait = STANDING
    walking: bool = False


@dataclass(frozen=True, slots=True)
class Leg:
    """One straight piece of a walk: turn on the spot, then go.

    Attributes:
        profile: points of the ground along the piece, m; at least where it begins and ends.
        heading: of the face while going, rad.
        speed: m/s, along the ground plan.
        gait: the kind of walking. backward: the face points back.
        number: tells which errand it belongs to.
    """

    profile: tuple[Vector, ...]
    heading: float
    speed: float
    gait: Gait
    backward: bool = False
    number: int = 0


@dataclass(frozen=True)
class Walk:
    """Legs one after the other; without any the person stands as if frozen."""

    begin: float  # simulated time at which the walk begins, s
    first: Stance  # how the person stands then
    legs: tuple[Leg, ...] = ()  # what follows; each begins where the one before ends

    @property
    def end(self) -> float:
        """Simulated time at which the walk is over, s."""
        return self._times[-1][1] if self._times else self.begin

    def leg_at(self, time: float) -> int:
        """Index of the leg that a time belongs to; their number when all are over."""
        return bisect.bisect_right([stop for _, stop in self._times], time)

    def stance(self, time: float) -> Stance:
        """How the person stands at a simulated time."""
        index = self.leg_at(time)
        if index >= len(self.legs):
            return self._arrivals[-1]
        return self._within(index, max(time, self.begin))

    def _within(self, index: int, time: float) -> Stance:
        leg, before = self.legs[index], self._arrivals[index]
        set_out, stop = self._times[index]
        turn = wrap_signed(leg.heading - before.yaw)
        begun = set_out - abs(turn) / TURN_RATE
        if time < set_out:
            share = (time - begun) / (set_out - begun)
            return replace(before, yaw=wrap_signed(before.yaw + share * turn), walking=True)
        done = min(1.0, (time - set_out) / (stop - set_out)) if stop > set_out else 1.0
        marks = self._marks[index]
        way = done * marks[-1]
        sign = -1.0 if leg.backward else 1.0
        return Stance(
            ground=_along(leg.profile, marks, way),
            yaw=leg.heading,
            way=before.way + sign * way,
            swing=self._swing(index, time - set_out, stop - time),
            gait=leg.gait,
            walking=True,
        )

    def _swing(self, index: int, since: float, left: float) -> float:
        before = self._arrivals[index].swing
        rising = 1.0 if self._goes_on(index - 1) else min(1.0, before + since / RAMP)
        falling = 1.0 if self._goes_on(index) else min(1.0, left / RAMP)
        return max(0.0, min(rising, falling))

    def _goes_on(self, index: int) -> bool:
        """Whether the leg behind leg `index` follows without a halt."""
        if not 0 <= index < len(self.legs) - 1:
            return False
        one, other = self.legs[index], self.legs[index + 1]
        bend = abs(wrap_signed(other.heading - one.heading))
        return bend < STRAIGHT_ON and one.gait is other.gait

    @cached_property
    def _marks(self) -> list[list[float]]:
        """Way along the ground plan (m) to each point of each leg's profile."""
        return [_lengths(leg.profile) for leg in self.legs]

    @cached_property
    def _times(self) -> list[tuple[float, float]]:
        """When each leg sets out, after its turn, and when it is over."""
        times, time, yaw = [], self.begin, self.first.yaw
        for leg, marks in zip(self.legs, self._marks, strict=True):
            set_out = time + abs(wrap_signed(leg.heading - yaw)) / TURN_RATE
            time = set_out + marks[-1] / leg.speed
            yaw = leg.heading
            times.append((set_out, time))
        return times

    @cached_property
    def _arrivals(self) -> list[Stance]:
        """How the person stands before each leg, and after the last."""
        stances = [self.first if self.legs else replace(self.first, walking=False)]
        way = self.first.way
        for index, (leg, marks) in enumerate(zip(self.legs, self._marks, strict=True)):
            way += -marks[-1] if leg.backward else marks[-1]
            on = self._goes_on(index)
            gait = leg.gait if on else STANDING
            stances.append(Stance(leg.profile[-1], leg.heading, way, float(on), gait, walking=on))
        return stances


@dataclass
class Performance:
    """Poses of all bodies of a walking person; those of the last moment asked for are kept."""

    walk: Walk
    height: float
    _known: tuple[float, list[Pose]] = field(default=(-math.inf, []))

    def poses(self, time: float) -> list[Pose]:
        """Poses in the world at a simulated time, the trunk first."""
        moment = min(time, self.walk.end)
        known, poses = self._known
        if known != moment:
            poses = body_poses(self.walk.stance(time), self.height)
            self._known = moment, poses
        return poses


def body_poses(stance: Stance, height: float) -> list[Pose]:
    """Poses of all bodies of a person in the world, the trunk first."""
    held = posture(stance.gait, stance.way, stance.swing, height)
    x, y, z = stance.ground
    turned = (math.cos(stance.yaw / 2.0), 0.0, 0.0, math.sin(stance.yaw / 2.0))
    pelvis = PELVIS * height / ADULT - held.sink
    return limb_poses(Pose((x, y, z + pelvis), turned), held, height)


def _lengths(points: Sequence[Vector]) -> list[float]:
    marks = [0.0]
    for one, other in itertools.pairwise(points):
        marks.append(marks[-1] + math.dist(one[:2], other[:2]))
    return marks


def _along(points: Sequence[Vector], marks: Sequence[float], way: float) -> Vector:
    index = min(bisect.bisect_right(marks, way), len(marks) - 1)
    span = marks[index] - marks[index - 1] if index else 0.0
    share = min(1.0, (way - marks[index - 1]) / span) if span > 0.0 else 1.0
    one, other = points[max(0, index - 1)], points[index]
    x, y, z = (a + share * (b - a) for a, b in zip(one, other, strict=True))
    return x, y, z
