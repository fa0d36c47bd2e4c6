"""Skid-steered and differential robots: a left and a right side (protocol reference 3.4.1)."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from usarsim_server.protocol import messages
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.drive import WheelDrive
from usarsim_server.robots.families.base import Conduct, Family, Machine, StatusFacts
from usarsim_server.robots.families.registry import register_family
from usarsim_server.robots.reading import parts

__all__ = ["SkidSteer", "WheelConduct", "WheeledFamily"]


class WheelConduct(Conduct):
    """Turns DRIVE into wheel speeds by side, or wheel by wheel."""

    def __init__(self, machine: Machine) -> None:
        super().__init__(machine)
        self._law = WheelDrive(machine.description)

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        targets = self._law.command(drive, dialect)
        if targets is not None:
            self.machine.drive(targets)

    def stop(self) -> None:
        self.machine.drive(self._law.stop())

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        front, rear = self.steering(facts, dialect)
        return messages.ground_status(
            messages.GroundStatus(
                time=facts.time,
                front_steer=front or 0.0,
                rear_steer=rear or 0.0,
                joints=self.joints(facts),
                light=self.light,
                light_intensity=self.light_intensity(dialect),
                battery=facts.battery,
                view=facts.view,
                steered=front is not None or rear is not None,
            ),
            dialect,
            udk_order=dialect is Dialect.UDK and facts.udk_order,
        )

    def joints(self, facts: StatusFacts) -> tuple[tuple[str, float], ...]:
        """Joints that STA tells of by name, such as flippers."""
        return facts.joints

    def steering(self, facts: StatusFacts, dialect: Dialect) -> tuple[float | None, float | None]:
        """Front and rear steering angle, rad; None without steering."""
        return None, None


class WheeledFamily(Family):
    """What all ground vehicles say of themselves."""

    wheel_sensors: ClassVar[bool] = True

    def conduct(self, machine: Machine) -> Conduct:
        return WheelConduct(machine)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        report = robot.report
        return messages.ground_configuration(
            dialect,
            robot.name,
            report.steering_type,
            report.mass,
            report.max_speed,
            report.max_torque,
            report.max_front_steer,
            report.max_rear_steer,
        )

    def geometry(self, robot: RobotDescription, dialect: Dialect) -> str:
        report = robot.report
        return messages.ground_geometry(
            robot.name,
            report.dimensions,
            report.center_of_gravity,
            report.wheel_radius,
            report.track_width,
            report.wheel_base,
        )


@register_family("skid_steer", "differential")
class SkidSteer(WheeledFamily):
    """All wheels of a side turn alike; two driven wheels and casters are a special case."""

    def finish(self, robot: RobotDescription) -> RobotDescription:
        """The wheel base is that of all it stands on: casters count."""
        old = robot.report
        places = [parts.wheel_place(wheel, robot.actuators)[0] for wheel in robot.driven_wheels]
        places += [caster.position[0] for caster in robot.casters]
        base = round(max(places) - min(places), 9)
        derived = old.dimensions == (old.wheel_base, old.track_width, 0.0)
        report = replace(
            old,
            wheel_base=base,
            dimensions=(base, old.track_width, 0.0) if derived else old.dimensions,
        )
        return replace(robot, report=report)
