"""Grippers that hold what is between their fingers, and let it go."""

from __future__ import annotations

import math

from usarsim_conformance.case import Case
from usarsim_conformance.control import ControlClient, Robot
from usarsim_conformance.grounds import YAW, lane
from usarsim_conformance.lines import Line, numbers
from usarsim_conformance.places import Place
from usarsim_conformance.registry import Severity, udk
from usarsim_conformance.walls import controller, create, status_of

_BOX = (0.12, 0.12, 0.12)
_STAND = (0.05, 0.05, 0.1)
"""m; the box fits between the forks of a GripperBase, the stand below them."""


async def _height(client: ControlClient, name: str) -> float:
    """z of an object, m, down positive; NaN if it is gone."""
    location = (await status_of(client, name)).numbers("Location")
    return location[2] if len(location) == 3 else math.nan


async def _order(robot: Robot, command: str, seconds: float) -> None:
    await robot.under(command, seconds=seconds)


@udk("arm.grips", "Grippers hold a box and let it fall", "6, no. 161 and 3.7", Severity.SHOULD)
async def grips(case: Case) -> None:
    """A box between the fingers of a gripper that was closed stays when what it stands on is taken
    away, and falls within 1 s of OPEN. The gripper is that of a GripperBase, where GEO tells."""
    class_name = await case.class_for("post")
    world = await controller(case)
    await case.place()  # so many robots at a time and no more
    base = lane(case)
    base = Place(None, base.location, (0.0, 0.0, YAW))
    robot = await case.spawn(place=base, class_name=class_name)
    await robot.run(0.5)
    pose = await robot.pose()
    geo = await robot.client.ask("GETGEO {Type Gripper}", "GEO {Type Gripper")
    gripper = geo.get("Name") or ""
    middle = _middle(geo)
    case.need(len(middle) == 3, f"GEO tells no Location and Tip of the gripper: {geo}")
    spot = Place(None, pose.location, (0.0, 0.0, pose.yaw)).moved(*middle)
    below = (_BOX[2] + _STAND[2]) / 2.0 + 0.002
    stand = await create(case, world, spot.moved(down=below), _STAND)
    box = await create(case, world, spot, _BOX, " {Physics RigidBody}")
    await robot.run(0.5)
    start = await _height(world, box)
    case.need(
        abs(start - spot.location[2]) < 0.05, f"the box does not stand between the fingers: {start}"
    )
    order = f"SET {{Type Gripper}} {{Name {gripper}}} {{Opcode "
    await _order(robot, order + "CLOSE}", 1.5)
    await world.send(f"CONTROL {{Type Kill}} {{Name {stand}}}")
    await status_of(world, "NoSuchObject")
    await robot.run(1.0)
    held = await _height(world, box)
    case.expect(
        abs(held - start) < 0.06,
        f"z of Location of a box between the fingers is {held:.2f} 1 s after Kill of what it stood "
        f"on, not {start:.2f}: {gripper} was told to CLOSE and does not hold it",
    )
    await _order(robot, order + "OPEN}", 1.0)
    fell = await _height(world, box) - held
    case.expect(
        fell > 0.5,
        f"z of Location of the box has changed by {fell:.2f} m 1 s after OPEN of {gripper}, not by "
        "more than 0.5: nothing but the fingers held it",
    )


def _middle(geo: Line) -> tuple[float, ...]:
    """Ahead, right and down of where a gripper takes hold, m in the robot's frame."""
    location, tip = numbers(geo.get("Location")), numbers(geo.get("Tip"))
    if len(location) != 3 or len(tip) != 3:
        return ()
    return tuple(a + b for a, b in zip(location, tip, strict=True))


@udk(
    "arm.mispkg-gripper", "MISPKG closes and opens grippers", "3.9 and 6, no. 161", Severity.SHOULD
)
async def mispkg_gripper(case: Case) -> None:
    """`MISPKG {Name p} {Gripper 1}` closes the gripper that an arm carries, 0 opens it: Status of
    EFF tells so. The arm is named by ASTA."""
    robot = await case.spawn("gripper")
    told = await robot.client.maybe("EFF {", 2.0)
    arm = await robot.client.maybe("ASTA {", 2.0)
    if told is None or arm is None:
        case.skip(f"{robot.class_name} has no arm with a gripper")
    assert arm is not None
    for value, status in ((1, "CLOSED"), (0, "OPEN"), (1, "CLOSED")):
        await robot.under(f"MISPKG {{Name {arm.get('Name')}}} {{Gripper {value}}}", seconds=0.5)
        line = await robot.wait("EFF {", what="EFF")
        case.expect(
            line.get("Status") == status,
            f"Status of EFF is {line.get('Status')} 0.5 s after MISPKG with Gripper {value}, not "
            f"{status} (protocol reference 3.9)",
        )
