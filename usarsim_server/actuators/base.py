"""One actuator: orders to its links, and the text about them in both dialects.

Links are numbered from 1 in MISPKG and in everything that is reported, from 0 in ACT (protocol
reference 5.2 number 5). GEO announces every link by a frame whose z axis is the axis of its joint
(4.7), as captured messages show: a pan axis that points upwards is `{Orientation
3.1415,0.0000,0.0000}` on the body, a tilt axis that points to the right is `1.5707,0.0000,0.0000`
on the pan. What is mounted on a link is announced in another frame, the link's own, which is
parallel to the body while the joints are at zero; captured poses of cameras on such links have no
rotation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from usarsim_server.protocol.messages import ActuatorItem, ActuatorLink, actuator_status
from usarsim_server.protocol.requests import LinkTarget
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import ActuatorDescription, LinkDescription, RobotDescription
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.frames import (
    IDENTITY,
    Pose,
    Vector,
    flip_point,
    flip_quaternion,
    quaternion_from_rpy,
    wire_from_pose,
)
from usarsim_server.simulation.snapshot import RobotBody


def joint_frame(link: LinkDescription) -> Pose:
    """The announced frame of a link, seen from the link's own frame.

    It is turned about x, and only if the axis has a part along x also about the new y.
    """
    x, y, z = flip_point(link.axis)
    roll = math.atan2(-y, z) if y or z else 0.0
    if roll <= -math.pi:
        roll = math.pi
    pitch = math.asin(min(1.0, max(-1.0, x)))
    about_x = Pose(quaternion=flip_quaternion(quaternion_from_rpy(roll, 0.0, 0.0)))
    about_y = Pose(quaternion=flip_quaternion(quaternion_from_rpy(0.0, pitch, 0.0)))
    return about_x @ about_y


def announced_link(
    actuator: ActuatorDescription, index: int, base: Pose = IDENTITY
) -> tuple[Vector, Vector]:
    """Wire location (m) and rotation (rad) of a link relative to its parent, joints at zero.

    Args:
        actuator: the chain.
        index: of the link, from 0.
        base: what links without a parent are relative to is here, seen from the base.
    """
    link = actuator.links[index]
    origin = base if link.parent is None else joint_frame(actuator.links[link.parent])
    return wire_from_pose(origin.inverse() @ link.pose @ joint_frame(link))


RELATIVE = 10
"""Orders 10, 11, 12 are 0, 1, 2 relative to the present value (robots reference 1.6)."""


def joint_order(
    link: LinkDescription, order: int, value: float, state: RobotBody | None
) -> JointOrder | None:
    """What a wire order means for a joint; None if there is no such order.

    Args:
        link: the link that the joint moves.
        order: 0 position, 1 velocity, 2 torque; 10, 11, 12 the same on top of what is.
        value: rad or m, their rates, N m or N.
        state: the present state, needed for relative orders only.
    """
    kind = order - RELATIVE if order >= RELATIVE else order
    if not Order.POSITION <= kind <= Order.TORQUE:
        return None
    if order >= RELATIVE:
        if state is None:
            return None
        value += _present(link, Order(kind), state)
    return JointOrder(Order(kind), value)


def _present(link: LinkDescription, order: Order, state: RobotBody) -> float:
    if order is Order.POSITION:
        return state.joint_position(link.joint)
    if order is Order.VELOCITY:
        return state.joint_velocity(link.joint)
    return state.joint_torque(link.joint)


class Actuator:
    """A mission package or arm; used by one thread.

    Attributes:
        name: item name.
        description: what the robot file says.
    """

    def __init__(self, description: ActuatorDescription, robot: RobotDescription) -> None:
        self.name = description.name
        self.description = description
        mount = description.mount
        carrier = None if mount is None else robot.find_link(mount)
        self._mount = robot.name if carrier is None else carrier[0].name
        self._mount_link = None if carrier is None else carrier[1]

    def orders(
        self, groups: Sequence[LinkTarget], first: int, state: RobotBody | None
    ) -> dict[str, JointOrder]:
        """Orders by joint; links and orders that do not exist are left out.

        Args:
            groups: as sent.
            first: number that the client means by the first link: 1 in MISPKG, 0 in ACT.
            state: the present state, needed for relative orders only.
        """
        orders = {}
        for group in groups:
            index = group.link - first
            if not 0 <= index < len(self.description.links):
                continue
            link = self.description.links[index]
            order = joint_order(link, group.order, group.value, state)
            if order is not None:
                orders[link.joint] = order
        return orders

    def status(self, dialect: Dialect, state: RobotBody) -> str:
        """The MISSTA or ASTA line."""
        links = [
            (state.joint_position(link.joint), state.joint_torque(link.joint))
            for link in self.description.links
        ]
        return actuator_status(dialect, state.time, self.name, links)

    def item(self) -> ActuatorItem:
        """The actuator for CONF and GEO Actuator: its links hang on its base."""
        location, rotation = wire_from_pose(self.description.pose)
        return ActuatorItem(
            name=self.name,
            location=location,
            rotation=rotation,
            mount=self._mount,
            mount_link=self._mount_link,
            links=self._links(IDENTITY),
            tip=flip_point(self.description.tip),
        )

    def package(self) -> ActuatorItem:
        """The actuator for CONF and GEO MisPkg: its links hang on what carries it."""
        return ActuatorItem(name=self.name, links=self._links(self.description.pose.inverse()))

    def _links(self, base: Pose) -> tuple[ActuatorLink, ...]:
        links = []
        for index, link in enumerate(self.description.links):
            location, rotation = announced_link(self.description, index, base)
            links.append(
                ActuatorLink(
                    joint_type=link.type.value,
                    max_speed=link.max_speed,
                    max_torque=link.max_torque,
                    limits=link.limits,
                    parent=None if link.parent is None else link.parent + 1,
                    location=location,
                    rotation=rotation,
                )
            )
        return tuple(links)
