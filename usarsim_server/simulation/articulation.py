"""What the simulation has to know of the joints, hands and tools of a robot class.

A joint here is anything but a wheel: a pan-tilt, an arm, a flipper, a finger. A hand is whatever
takes hold of things: fingers that close on them, a suction cup, a coupling for tools. A tool lies
about as a body of its own until a coupling takes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import NamedTuple

import mujoco

from usarsim_server.simulation.frames import IDENTITY, Pose

TIE_SOLREF = (0.01, 1.0)
TIE_SOLIMP = (0.98, 0.99, 0.001, 0.5, 2.0)
"""Of what holds two bodies together: 10 micrometres of play under a body's own weight."""


class Order(IntEnum):
    """What a joint is told; the numbers are those of the wire (protocol reference 3.9)."""

    POSITION = 0
    VELOCITY = 1
    TORQUE = 2
    STIFFNESS = 3
    """Share (0 to 1) of its largest force that the joint may use from now on; not on the wire."""


class JointOrder(NamedTuple):
    """An order to one joint: rad or m, rad/s or m/s, N m or N, or a share of 1."""

    order: Order
    value: float


@dataclass(frozen=True, slots=True)
class JointModel:
    """The drive of one joint."""

    name: str  # of the joint in the specification; its range, if any, is there too
    max_speed: float  # rad/s or m/s
    max_force: float  # N m or N that the drive can exert


class Grip(Enum):
    """How a hand takes hold."""

    PINCH = "fingers"
    SUCTION = "suction"
    COUPLING = "coupling"


@dataclass(frozen=True, slots=True)
class HandModel:
    """Something that takes hold of bodies."""

    name: str  # unique within the robot
    grip: Grip  # how it takes hold
    body: str  # name of the body that carries it in the specification
    tip: Pose = IDENTITY
    """Where it holds, in the frame of that body; suction acts along the x axis of it."""
    fingers: tuple[str, ...] = ()  # bodies that all have to touch a thing before it is held (PINCH)
    reach: float = 0.0  # m in front of the tip within which suction catches (SUCTION)
    strength: float = math.inf
    """N of pull, beyond what the friction of fingers bears, at which the thing slips away; then the
    hand has to be told to close again."""
    tolerance: tuple[float, float] = (0.0, 0.0)
    """m and rad by which a tool may be out of place (COUPLING)."""
    tools: tuple[str, ...] = ()  # names of the tools it may take (COUPLING)


@dataclass(frozen=True, slots=True)
class ToolModel:
    """A body with a free joint of its own that comes and goes with the robot."""

    body: str  # its name in the specification, a root body; so is its joint's
    pose: Pose  # where it lies when the robot appears, relative to the robot's reference point
    holder: str | None = None
    """Hand that holds it from the start, if any; then `pose` is where the hand is."""


@dataclass(frozen=True, slots=True)
class HandState:
    """What a hand is doing."""

    closed: bool = False  # it was told to close
    holding: str | None = None  # name of the body it holds, None if there is none


def tie_name(prefix: str, hand: str) -> str:
    """Name of the constraint that a hand holds with."""
    return f"{prefix}{hand}:hold"


def anchor_name(prefix: str) -> str:
    """Name of the constraint that keeps an anchored robot in its place."""
    return f"{prefix}:anchor"


def add_ties(
    spec: mujoco.MjSpec, prefix: str, root: str, hands: Sequence[HandModel], anchored: bool
) -> None:
    """Give one robot slot the constraints that it will hold things with, all of them idle.

    The slot, whose names have the prefix, is in the world already; `root` is its root body without
    prefix.
    """
    ties = [(tie_name(prefix, hand.name), prefix + hand.body) for hand in hands]
    if anchored:
        ties.append((anchor_name(prefix), prefix + root))
    for name, body in ties:
        spec.add_equality(
            name=name,
            type=mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=body,
            name2="world",
            active=False,
            solref=TIE_SOLREF,
            solimp=TIE_SOLIMP,
        )
