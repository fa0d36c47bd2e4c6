"""Tracked robots: belts whose surface moves, on the chassis and on flippers.

DRIVE turns a sprocket on each side, a wheel that touches nothing; so ramps, brake, encoders,
tachometer and odometry are those of wheels. Before every step the spin of the sprocket becomes the
speed of the surface of all belts on its side (robots reference 4.7). Flippers are links of an
actuator with `package = false`.

A belt is made of rollers, ellipsoids as wheels are, and of flat boxes for its straight runs, which
stand back a little so that on level ground it rests on its rollers as a real one does. A roller's
surface turns about its axis, that of a run moves along it.

A surface that moves as told pulls with all the grip it finds. At a wall that is more than a drive
can give: what the ground gives the belts presses them against the wall, and what they find there
lifts the robot until it lies on its back. A real drive divides its thrust among all that its belts
grip, and stalls. So while a wall holds a robot back, the friction of the contacts of each side is
lowered until all of them together can take no more than the thrust of that side: torque of the
sprocket over its radius. Elsewhere grip gives out before thrust does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.tables import Table
from usarsim_server.robots.description import (
    ActuatorDescription,
    RobotDescription,
    Wheel,
)
from usarsim_server.robots.families.base import register_family
from usarsim_server.robots.families.wheeled import WheeledFamily, with_footprint
from usarsim_server.robots.tracks import Roller, Track, lowest, read_tracks, runs, touching
from usarsim_server.simulation.ground import MARK
from usarsim_server.simulation.motion_laws import Law, LawModel

Array = NDArray[np.float64]

SAG = 0.001
"""m that straight runs stand back; at rest a roller sinks in by a third of that."""
DEAD_SPIN = 1e-6
"""rad/s below which a sprocket stands still, so that a robot at rest can fall asleep."""
STEEP = 0.1
"""Largest upward part of the normal of a wall (6 degrees). Edges are none: belts catch on them."""
BEHIND = 0.75
"""Share of the speed of its belts below which something holds a robot back."""
CREEP = 1e-3
"""m/s below which belts stand still: gears that do not move hold whatever the drive could pull."""
HIDDEN = 3
"""Geom group of what is not seen, by cameras and rays."""
CONTACT_SOLREF = (0.02, 1.0)
LINK_SOLREF = (0.01, 1.0)
"""On links, whose contacts are as stiff as their small mass asks for, but carry the whole robot."""
CONTACT_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
_FOREIGN, _HULL = -2, -1
"""Geoms that are no belt of a side: of others, of the robot itself."""
_ABOUT_Y = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
"""Turns the z axis of a cylinder to the side."""


@register_family("tracked")
@dataclass(frozen=True)
class Tracked(WheeledFamily):
    """Driven like a skid-steered robot; flippers are driven by name and told of in STA."""

    tracks: tuple[Track, ...] = ()

    @classmethod
    def read(
        cls,
        reader: Table,
        parent: Self | None,
        wheels: Sequence[Wheel],
        actuators: Sequence[ActuatorDescription],
    ) -> Self:
        """Read the `[[track]]` tables."""
        return cls(read_tracks(reader, parent.tracks if parent else (), actuators))

    def support(self, actuators: Sequence[ActuatorDescription]) -> float:
        """Tracks are what it stands on."""
        return -min(lowest(track, actuators) for track in self.tracks)

    def finish(self, robot: RobotDescription) -> RobotDescription:
        """Wheel separation and base are those of the tracks."""
        track_width, wheel_base = _footprint(self.tracks, robot.actuators)
        return with_footprint(robot, wheel_base, track_width)

    def complete(self, spec: mujoco.MjSpec, robot: RobotDescription) -> None:
        """Put the belts around the body; what only drives them is not seen."""
        for wheel in robot.wheels:
            if not wheel.collides:
                spec.geom(wheel.name).group = HIDDEN
        for number, track in enumerate(self.tracks):
            body = spec.body(track.link or "base")
            _add_belt(body, f"track:{number}", track)

    def laws(self, robot: RobotDescription) -> tuple[LawModel, ...]:
        """The sprockets move the belts."""
        fields = {
            f"track:{number}:{part}": (track.side, field)
            for number, track in enumerate(self.tracks)
            for part, field in _fields(track, robot).items()
        }
        drive = {
            side: Drive(
                sprocket=wheels[0].name,
                radius=wheels[0].radius,
                thrust=sum(robot.drive.wheel_torque / wheel.radius for wheel in wheels),
            )
            for side in ("left", "right")
            for wheels in ([wheel for wheel in robot.driven_wheels if wheel.side == side],)
        }
        return (LawModel(lambda model, prefix: Treads(model, prefix, drive, fields), 0),)


def _footprint(
    tracks: Sequence[Track], actuators: Sequence[ActuatorDescription]
) -> tuple[float, float]:
    """Distance of the belts of both sides and of their first and last axles, m.

    Belts on links count only if there is none on the chassis.
    """
    fixed = [track for track in tracks if track.link is None] or tracks
    places = [
        (place.position[1], place.position[0] + place.rotate((roller.x, 0.0, roller.z))[0])
        for track in fixed
        for place in (track.place(actuators),)
        for roller in track.rollers
    ]
    sides, axles = zip(*places, strict=True)
    return round(max(sides) - min(sides), 9), round(max(axles) - min(axles), 9)


def _add_belt(body: mujoco.MjsBody, name: str, track: Track) -> None:
    """Rollers that collide, their looks, and straight runs; all weightless."""
    x, y, z = track.position
    half = track.width / 2.0
    for number, roller in enumerate(touching(track.rollers)):
        place = [x + roller.x, y, z + roller.z]
        rows = _rows(track, roller)
        for row in range(rows):
            aside = (2 * row + 1 - rows) * half / rows
            _add_surface(
                body,
                track,
                name=f"{name}:roller{number}:{row}",
                type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
                size=[roller.radius, half / rows, roller.radius],
                pos=[place[0], y + aside, place[2]],
                group=HIDDEN,
            )
        body.add_geom(
            name=f"{name}:look{number}",
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[roller.radius, half, 0.0],
            pos=place,
            quat=_ABOUT_Y,
            mass=0.0,
            contype=0,
            conaffinity=0,
            rgba=track.color,
        )
    for number, run in enumerate(runs(track.rollers)):
        (ahead, up), thickness = run.normal, run.depth - SAG
        inward = SAG + thickness / 2.0
        middle = [
            (a + b) / 2.0 - inward * n
            for a, b, n in zip(run.start, run.end, run.normal, strict=True)
        ]
        # Its x axis lies along the run, its z axis points outwards.
        angle = math.atan2(ahead, up)
        _add_surface(
            body,
            track,
            name=f"{name}:run{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[run.length / 2.0, half, thickness / 2.0],
            pos=[x + middle[0], y, z + middle[1]],
            quat=[math.cos(angle / 2.0), 0.0, math.sin(angle / 2.0), 0.0],
        )


def _rows(track: Track, roller: Roller) -> int:
    """How many rollers stand beside each other: one that is as wide as high touches like a ball."""
    return max(1, round(track.width / roller.radius))


def _add_surface(body: mujoco.MjsBody, track: Track, **geom: object) -> None:
    added = body.add_geom(
        mass=0.0,
        condim=3,
        friction=(track.friction, 0.005, 0.0001),
        solref=CONTACT_SOLREF if track.link is None else LINK_SOLREF,
        solimp=CONTACT_SOLIMP,
        rgba=track.color,
        **geom,
    )
    # Without any speed at compile time MuJoCo would not look at it later.
    added.surfacevel = [MARK, 0.0, 0.0, 0.0, 0.0, 0.0]


def _fields(track: Track, robot: RobotDescription) -> dict[str, Array]:
    """Surface velocity (linear, angular, in the geom's frame) of each part per rad/s of spin."""
    sprocket = next(wheel for wheel in robot.driven_wheels if wheel.side == track.side)
    # On a link that is mounted the other way round the belt runs the other way round.
    left = track.place(robot.actuators).rotate((0.0, 1.0, 0.0))[1]
    speed = math.copysign(sprocket.radius, left)
    parts = {}
    for number, roller in enumerate(touching(track.rollers)):
        for row in range(_rows(track, roller)):
            spin = speed / roller.radius
            parts[f"roller{number}:{row}"] = np.array([0.0, 0.0, 0.0, 0.0, spin, 0.0])
    for number, _ in enumerate(runs(track.rollers)):
        parts[f"run{number}"] = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    return parts


@dataclass(frozen=True, slots=True)
class Drive:
    """What drives the belts of one side."""

    sprocket: str  # name of the wheel
    radius: float  # belts run at radius times its speed, m
    thrust: float  # with which it can move all its belts together, N


class Pull(NamedTuple):
    """One contact of a belt in one step.

    Attributes:
        contact: its number. side: of the belt, 0 is left. row: of its normal force.
        friction: in full.
    """

    contact: int
    side: int
    row: int
    friction: float


class Treads(Law):
    """Moves the surfaces of the belts of one robot as fast as its sprockets turn.

    It remembers the share of their grip that the belts of each side may use.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        prefix: str,
        drives: dict[str, Drive],
        fields: dict[str, tuple[str, Array]],
    ) -> None:
        """Find the parts in the compiled model.

        Args:
            model: compiled.
            prefix: of all names of the robot's slot.
            drives: of each side.
            fields: side and surface velocity per rad/s of every part of a belt, by geom name.
        """
        left, right = drives["left"], drives["right"]
        self._left, self._right = (
            int(model.joint(prefix + drive.sprocket).dofadr[0]) for drive in (left, right)
        )
        self._radii = (left.radius, right.radius)
        self._thrust = (left.thrust, right.thrust)
        self._geoms = np.array([model.geom(prefix + name).id for name in fields], dtype=np.intp)
        self._fields = np.zeros((2, len(fields), 6))
        self._base = int(model.body(prefix + "base").id)
        self._dof = int(model.body_dofadr[self._base])
        own = model.body_rootid[model.geom_bodyid] == model.body_rootid[self._base]
        self._part = np.where(own, _HULL, _FOREIGN)
        for row, (side, field) in enumerate(fields.values()):
            number = 0 if side == "left" else 1
            self._fields[number, row] = field
            self._part[self._geoms[row]] = number
        self._written = (math.nan, math.nan)
        self._belts = 0.0
        self._share = (1.0, 1.0)
        self._pulling: list[Pull] = []

    def prepare(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        """Read the spins, and write them if they have changed."""
        velocity = data.qvel
        left, right = velocity[self._left], velocity[self._right]
        spins = (
            0.0 if abs(left) < DEAD_SPIN else left,
            0.0 if abs(right) < DEAD_SPIN else right,
        )
        if spins != self._written:
            fields = self._fields
            model.geom_surfacevel[self._geoms] = spins[0] * fields[0] + spins[1] * fields[1]
            self._written = spins
            self._belts = float(spins[0] * self._radii[0] + spins[1] * self._radii[1]) / 2.0

    def push(self, model: mujoco.MjModel, data: mujoco.MjData, command: Array) -> None:
        """Lower the friction of the belts of a robot that a wall holds back."""
        self._pulling = self._contacts(data) if self._is_behind(data) else []
        if not self._pulling:
            self._share = (1.0, 1.0)
            return
        friction, mu = data.contact.friction, data.contact.mu
        for pull in self._pulling:
            share = self._share[pull.side]
            if share < 1.0:
                friction[pull.contact] *= share
                mu[pull.contact] *= share

    def feel(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """What the belts press, and could grip with full friction, says their share."""
        if not self._pulling:
            return
        force = data.efc_force
        grip = [0.0, 0.0]
        for pull in self._pulling:
            grip[pull.side] += pull.friction * float(force[pull.row])
        left, right = (
            thrust / max(thrust, most) for thrust, most in zip(self._thrust, grip, strict=True)
        )
        self._share = (left, right)

    def _is_behind(self, data: mujoco.MjData) -> bool:
        """Whether the robot moves slower than its belts, both sides taken together."""
        if not abs(self._belts) > CREEP:
            return False
        x, y, z = data.qvel[self._dof : self._dof + 3].tolist()
        a, b, c = data.xmat[self._base, ::3].tolist()
        return bool((x * a + y * b + z * c) / self._belts < BEHIND)

    def _contacts(self, data: mujoco.MjData) -> list[Pull]:
        """The active contacts of belts; none if the robot is at no wall."""
        contact = data.contact
        parts = self._part[contact.geom].max(axis=1)
        rows, up, friction = contact.efc_address, contact.frame[:, 2], contact.friction[:, 0]
        found, wall = [], False
        for number in np.flatnonzero(parts > _FOREIGN).tolist():
            row, side = int(rows[number]), int(parts[number])
            if row < 0:
                continue
            wall = wall or abs(up[number]) < STEEP
            if side != _HULL:
                found.append(Pull(number, side, row, float(friction[number])))
        return found if wall else []

    def release(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Stop the belts."""
        model.geom_surfacevel[self._geoms] = 0.0
        self._written = (math.nan, math.nan)
        self._belts, self._share = 0.0, (1.0, 1.0)

    def state(self) -> Array:
        """The shares."""
        return np.array(self._share)

    def restore(self, state: Array) -> None:
        """Take shares over; what was written last may not hold any longer."""
        self._written = (math.nan, math.nan)
        self._share = (float(state[0]), float(state[1]))
