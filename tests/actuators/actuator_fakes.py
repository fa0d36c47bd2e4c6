"""A robot with an arm and hands as values, and a machine that notes what it is told."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import (
    ActuatorDescription,
    DriveDescription,
    EffectorDescription,
    ItemDescription,
    JointType,
    LinkDescription,
    RobotDescription,
    RobotReport,
    Shape,
)
from usarsim_server.robots.families.static import Platform
from usarsim_server.simulation.articulation import HandState, JointOrder
from usarsim_server.simulation.frames import Pose, Vector, pose_from_wire
from usarsim_server.simulation.layout import RobotLayout
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.testing import Rehearsal, RehearsedClient

ZERO: Vector = (0.0, 0.0, 0.0)
UT2004, UDK = Dialect.UT2004, Dialect.UDK
PIECE = Shape("box", (0.1, 0.1, 0.1), Pose(), 1.0, (0.5, 0.5, 0.5, 1.0))


def link(
    body: str,
    joint: str,
    parent: int | None = None,
    axis: Vector = (0.0, 0.0, -1.0),
    place: Vector = ZERO,
    rotation: Vector = ZERO,
    **changes: object,
) -> LinkDescription:
    """A link; axis, place and rotation are in the wire frame."""
    x, y, z = axis
    values: dict[str, object] = {
        "body": body,
        "joint": joint,
        "parent": parent,
        "type": JointType.REVOLUTE,
        "axis": (x, -y, -z),
        "pose": pose_from_wire(place, rotation),
        "shapes": (PIECE,),
        "limits": None,
        "max_speed": 0.1745,
        "max_torque": 20.0,
        **changes,
    }
    return LinkDescription(**values)  # type: ignore[arg-type]


PAN_TILT = ActuatorDescription(
    "CameraPanTilt",
    None,
    pose_from_wire((0.12, 0.0, -0.2)),
    (
        link("CameraPanTilt_Link1", "CameraPanTilt_Joint1"),
        link(
            "CameraPanTilt_Link2",
            "CameraPanTilt_Joint2",
            0,
            (0.0, 1.0, 0.0),
            (0.0, 0.0, -0.05),
            limits=(-0.7854, 0.7854),
        ),
    ),
)
"""The pan-tilt of the sample messages of protocol reference 4.7 and 4.8."""

ARM = ActuatorDescription(
    "ArmA",
    None,
    pose_from_wire((0.1, 0.0, -0.35)),
    (
        link("ArmA_Link1", "ArmA_Joint1", None, (0.0, 0.0, 1.0), limits=(-1.5708, 1.5708)),
        link(
            "ArmA_Link2",
            "ArmA_Joint2",
            0,
            (1.0, 0.0, 0.0),
            (0.05, 0.0, -0.08),
            type=JointType.PRISMATIC,
            limits=(0.0, 0.35),
            max_torque=800.0,
        ),
    ),
    (0.18, 0.0, 0.0),
)

WRIST = ActuatorDescription(
    "Wrist", "ArmA_Link2", pose_from_wire((0.2, 0.0, 0.0)), (link("Wrist_Link1", "Wrist_Joint1"),)
)

FLIPPERS = ActuatorDescription(
    "Flippers",
    None,
    Pose(),
    tuple(link(name, name) for name in ("FRFlipper", "FLFlipper")),
    package=False,
)


def effector(
    kind: str, name: str, mount: str | None = None, **changes: object
) -> EffectorDescription:
    """An effector of a type; `fingers`, `shapes`, `tip`, `detached` as usual, others parameters."""
    fields = {key: changes.pop(key) for key in ("fingers", "tip", "detached") if key in changes}
    item = ItemDescription(kind, name, mount, pose_from_wire((0.1, 0.0, 0.0)), changes, "test")
    return EffectorDescription(item, (PIECE,), **fields)  # type: ignore[arg-type]


FINGERS = tuple(
    link(f"Hand_Finger{n}", f"Hand_FingerJoint{n}", limits=(0.0, 0.04), home=0.0) for n in (1, 2)
)
HAND = effector("Gripper", "Hand", "ArmA_Link2", fingers=FINGERS, tip=(0.05, 0.0, 0.0))
CUP = effector("VacuumGripper", "Cup", None, tip=(0.0, 0.0, -0.183))
CHANGER = effector("ToolChanger", "Changer", "Wrist_Link1")
SPARE = effector("VacuumGripper", "Spare", None, detached=True, tip=(0.1, 0.0, 0.0))


def robot(
    actuators: tuple[ActuatorDescription, ...] = (ARM, WRIST, FLIPPERS),
    effectors: tuple[EffectorDescription, ...] = (HAND, CUP, CHANGER, SPARE),
    name: str = "Arms",
) -> RobotDescription:
    """A robot with these limbs and nothing else."""
    return RobotDescription(
        name=name,
        model=name,
        kind="static",
        dialect=UDK,
        description="",
        shapes=(PIECE,),
        wheels=(),
        casters=(),
        rest_height=0.0,
        drive=DriveDescription(0.0),
        battery=None,
        report=RobotReport(0, 0, 0, 0, "None", ZERO, ZERO, 0, 0),
        items=(),
        source=Path("test.toml"),
        family=Platform(),
        actuators=actuators,
        effectors=effectors,
    )


class Machine:
    """Notes orders; its joints stand wherever they are put.

    Attributes:
        orders: every call of `command_joints`, in order.
        hands: every call of `operate_hand`.
        obeys: what `operate_hand` answers.
        positions, rates, torques: of joints by name; absent ones are zero.
        held: what a hand is doing, by name; absent ones are open and empty.
        gone: the robot has left the world.
        looks: how often somebody looked.
    """

    def __init__(self, description: RobotDescription) -> None:
        self.orders: list[dict[str, JointOrder]] = []
        self.hands: list[tuple[str, bool]] = []
        self.obeys = True
        self.positions: dict[str, float] = {}
        self.rates: dict[str, float] = {}
        self.torques: dict[str, float] = {}
        self.held: dict[str, HandState] = {}
        self.gone = False
        self.looks = 0
        self._joints = [link.joint for link in description.links]
        self._hands = [one.name for one in description.effectors]

    def command_joints(self, orders: Mapping[str, JointOrder]) -> None:
        """Note the orders."""
        self.orders.append(dict(orders))

    def operate_hand(self, hand: str, close: bool) -> bool:
        """Note the order."""
        self.hands.append((hand, close))
        return self.obeys

    def look(self) -> RobotBody | None:
        """The state as it was put."""
        self.looks += 1
        return None if self.gone else self.state()

    def state(self, time: float = 63.4021) -> RobotBody:
        """The state as it was put, at a time."""
        index = {joint.lower(): number for number, joint in enumerate(self._joints)}
        nothing = np.zeros(0, dtype=np.intp)
        layout = RobotLayout(
            *(5, 1, 0, 0, {}, index, index, nothing, nothing, nothing, frozenset({1}), nothing)
        )

        def array(values: dict[str, float]) -> np.ndarray:
            return np.array([values.get(joint, 0.0) for joint in self._joints])

        snapshot = Snapshot(
            time=time,
            step=0,
            generation=0,
            qpos=array(self.positions),
            qvel=array(self.rates),
            xpos=np.zeros((2, 3)),
            xquat=np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
            layouts={0: layout},
            torque=array(self.torques),
            hands={5: {name: self.held.get(name, HandState()) for name in self._hands}},
        )
        return RobotBody(snapshot, layout)


def spawn(stage: Rehearsal, client: RehearsedClient, name: str, extra: str = "") -> None:
    """Spawn a robot at the origin, away from everybody, and let its quiet period pass."""
    client.send(f"INIT {{ClassName USARBot.{name}}} {{Location 0,0,-0.25}} {extra}")
    stage.run(0.5)
    client.take()


def values(client: RehearsedClient, head: str, name: str) -> dict[int, float]:
    """Position by link number in the newest status line of an actuator."""
    lines = [x for x in client.lines if x.startswith(head + " ") and f"{{Name {name}}}" in x]
    pairs = re.findall(r"\{Link (\d+)\} \{Value (-?[\d.]+)\}", lines[-1])
    return {int(link): float(value) for link, value in pairs}


def settle(stage: Rehearsal, client: RehearsedClient, seconds: float) -> None:
    """Let time pass and keep only the lines of the last half second."""
    stage.run(seconds)
    client.take()
    stage.run(0.5)
