"""What the rest of the server sees of the physics: immutable pictures of one instant.

Only the physics thread touches live MuJoCo data. After a step it publishes a `Snapshot`; a
`RobotState` is one robot's window onto it. Everything here is in the simulation frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.articulation import HandState
from usarsim_server.simulation.frames import Pose, Vector, pose_of
from usarsim_server.simulation.layout import RobotLayout

if TYPE_CHECKING:
    from usarsim_server.simulation.model import CompiledWorld


Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Snapshot:
    """State of the whole world at one simulated instant; arrays are read-only copies."""

    time: float
    """Simulated seconds since the world started."""
    step: int
    """Number of physics steps since the world started."""
    generation: int
    """Counts recompilations of the model; indices are valid within one generation only."""
    qpos: Array
    qvel: Array
    xpos: Array
    """Body positions (nbody, 3), m."""
    xquat: Array
    """Body orientations (nbody, 4), w x y z."""
    layouts: Mapping[int, RobotLayout] = field(default_factory=dict)
    """Layouts of the active robots by robot id."""
    torque: Array = field(default_factory=lambda: np.zeros(0))
    """Forces of the joint drives (nv,), N m or N; wheels included."""
    hands: Mapping[int, Mapping[str, HandState]] = field(default_factory=dict)
    """What hands are doing, by slot and name of the hand."""
    world: CompiledWorld | None = None
    """The model that it belongs to, which lives as long as anybody has such a snapshot."""


class RobotState(Protocol):
    """One robot at one instant, as sensors see it. Implemented by `RobotBody`; easy to fake."""

    @property
    def snapshot(self) -> Snapshot:
        """The whole world at this instant."""

    @property
    def time(self) -> float:
        """Simulated seconds."""

    @property
    def pose(self) -> Pose:
        """Pose of the robot's reference point in the world."""

    @property
    def linear_velocity(self) -> Vector:
        """Velocity of the reference point in the world frame, m/s."""

    @property
    def wheel_angles(self) -> Array:
        """Accumulated angles of the driven wheels in part order, rad, positive rolling forward."""

    @property
    def wheel_speeds(self) -> Array:
        """Spin of the driven wheels in part order, rad/s, positive rolling forward."""

    def link_pose(self, link: str) -> Pose:
        """World pose of a link by name (any case). Raises KeyError for an unknown link."""

    def joint_position(self, joint: str) -> float:
        """Position of a joint by name (any case), rad or m. Raises KeyError if unknown."""


@dataclass(frozen=True, eq=False)
class RobotBody:
    """`RobotState` of one robot in one snapshot."""

    snapshot: Snapshot
    layout: RobotLayout

    @property
    def time(self) -> float:
        """Simulated seconds."""
        return self.snapshot.time

    @cached_property
    def pose(self) -> Pose:
        """Pose of the robot's reference point in the world."""
        return self._body_pose(self.layout.base)

    @property
    def linear_velocity(self) -> Vector:
        """Velocity of the reference point in the world frame, m/s."""
        x, y, z = self.snapshot.qvel[self.layout.dof : self.layout.dof + 3].tolist()
        return x, y, z

    @property
    def angular_velocity(self) -> Vector:
        """Angular velocity in the robot's own frame, rad/s."""
        x, y, z = self.snapshot.qvel[self.layout.dof + 3 : self.layout.dof + 6].tolist()
        return x, y, z

    @property
    def wheel_angles(self) -> Array:
        """Accumulated angles of the driven wheels in part order, rad."""
        return self.snapshot.qpos[self.layout.wheel_qpos]

    @property
    def wheel_speeds(self) -> Array:
        """Spin of the driven wheels in part order, rad/s."""
        return self.snapshot.qvel[self.layout.wheel_dof]

    def link_pose(self, link: str) -> Pose:
        """World pose of a link by name (any case). Raises KeyError for an unknown link."""
        return self._body_pose(self.layout.links[link.lower()])

    def joint_position(self, joint: str) -> float:
        """Position of a joint by name (any case), rad or m. Raises KeyError if unknown."""
        return float(self.snapshot.qpos[self.layout.joint_qpos[joint.lower()]])

    def joint_positions(self, joints: Sequence[str]) -> list[float]:
        """Positions of many joints at once, see `joint_position`."""
        places = [self.layout.joint_qpos[one.lower()] for one in joints]
        positions: list[float] = self.snapshot.qpos[places].tolist()
        return positions

    def joint_velocity(self, joint: str) -> float:
        """Rate of a joint by name (any case), rad/s or m/s. Raises KeyError if unknown."""
        return float(self.snapshot.qvel[self.layout.joint_dof[joint.lower()]])

    def joint_torque(self, joint: str) -> float:
        """Force of a joint's drive by name (any case), N m or N. Raises KeyError if unknown."""
        return float(self.snapshot.torque[self.layout.joint_dof[joint.lower()]])

    def hand(self, name: str) -> HandState:
        """What a hand is doing. Raises KeyError for an unknown hand."""
        return self.snapshot.hands[self.layout.slot][name]

    def _body_pose(self, body: int) -> Pose:
        return pose_of(self.snapshot.xpos[body], self.snapshot.xquat[body])
