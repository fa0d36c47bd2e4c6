"""Rovers with lasers in pybullet: python -I pybullet_rovers.py WORK.json RESULT.json."""

from __future__ import annotations

import json
import math
import sys
import time
from importlib.metadata import version
from typing import Any

import pybullet as p

TIMESTEP = 1.0 / 240.0
"""s: the engine's own default, which its guide advises to keep."""
NEAREST = 0.1
"""m from the sensor at which rays begin, outside the laser's own housing."""


class Arena:
    """The hall and its rovers.

    Attributes:
        scans, beams, hits: whole scans, their beams, and those of them that hit something.
        reach: sum of all ranges measured, m.
        metres: way of all rovers together.
    """

    def __init__(self, work: dict[str, Any]) -> None:
        self.work, self.robot, self.laser = work, work["robot"], work["laser"]
        p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81)
        p.setTimeStep(TIMESTEP)
        floor = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE))
        p.changeDynamics(floor, -1, lateralFriction=self.robot["friction"])
        for box in work["boxes"]:
            shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=box["half"])
            turn = p.getQuaternionFromEuler([0, 0, box["yaw"]])
            p.createMultiBody(0, shape, basePosition=box["center"], baseOrientation=turn)
        self.rovers = [self._rover(*start) for start in work["starts"]]
        self._begins, self._ends = self._fan()
        self._places = [p.getBasePositionAndOrientation(one)[0] for one in self.rovers]
        self.forget()

    def forget(self) -> None:
        """Begin to count."""
        self.scans = self.beams = self.hits = 0
        self.reach = self.metres = 0.0

    def _rover(self, x: float, y: float, yaw: float) -> int:
        robot = self.robot
        length, width, height = robot["chassis"]
        housing = robot["housing"]
        chassis = p.createCollisionShapeArray(
            [p.GEOM_BOX, p.GEOM_BOX],
            halfExtents=[[length / 2, width / 2, height / 2], [edge / 2 for edge in housing]],
            collisionFramePositions=[
                [0, 0, 0],
                [robot["housing_forward"], 0, (height + housing[2]) / 2],
            ],
        )
        wheel = p.createCollisionShape(
            p.GEOM_CYLINDER, radius=robot["wheel_radius"], height=robot["wheel_width"]
        )
        places, count = robot["wheels"], len(robot["wheels"])
        drop = robot["wheel_radius"] - robot["chassis_height"]
        rover = p.createMultiBody(
            robot["chassis_mass"],
            chassis,
            basePosition=[x, y, robot["chassis_height"]],
            baseOrientation=p.getQuaternionFromEuler([0, 0, yaw]),
            linkMasses=[robot["wheel_mass"]] * count,
            linkCollisionShapeIndices=[wheel] * count,
            linkVisualShapeIndices=[-1] * count,
            linkPositions=[[a, b, drop] for a, b in places],
            # A cylinder's axis is z; an axle lies along y.
            linkOrientations=[p.getQuaternionFromEuler([-math.pi / 2, 0, 0])] * count,
            linkInertialFramePositions=[[0, 0, 0]] * count,
            linkInertialFrameOrientations=[[0, 0, 0, 1]] * count,
            linkParentIndices=[0] * count,
            linkJointTypes=[p.JOINT_REVOLUTE] * count,
            linkJointAxis=[[0, 0, 1]] * count,
        )
        for link in range(count):
            p.changeDynamics(rover, link, lateralFriction=robot["friction"])
        return int(rover)

    def _fan(self) -> tuple[list[list[float]], list[list[float]]]:
        """Where rays begin and end, in the frame of a rover."""
        laser = self.laser
        forward, up = laser["forward"], laser["height"] - self.robot["chassis_height"]
        step = laser["fov"] / (laser["beams"] - 1)
        angles = [number * step - laser["fov"] / 2 for number in range(laser["beams"])]

        def ring(radius: float) -> list[list[float]]:
            return [
                [forward + radius * math.cos(angle), radius * math.sin(angle), up]
                for angle in angles
            ]

        return ring(NEAREST), ring(laser["range"])

    def command(self, speeds: list[list[float]]) -> None:
        """Set the wheel speeds of every rover."""
        sides = [0 if y > 0 else 1 for _, y in self.robot["wheels"]]
        wheels = list(range(len(sides)))
        torques = [self.robot["wheel_torque"]] * len(sides)
        for rover, pair in zip(self.rovers, speeds, strict=True):
            targets = [pair[side] for side in sides]
            p.setJointMotorControlArray(
                rover, wheels, p.VELOCITY_CONTROL, targetVelocities=targets, forces=torques
            )

    def look(self) -> None:
        """One scan of every rover: a batch of rays each, on one thread."""
        far = self.laser["range"] - NEAREST
        for number, rover in enumerate(self.rovers):
            echoes = p.rayTestBatch(self._begins, self._ends, parentObjectUniqueId=rover)
            ranges = [NEAREST + far * echo[2] for echo in echoes]
            self.scans += 1
            self.beams += len(ranges)
            self.hits += sum(echo[0] >= 0 for echo in echoes)
            self.reach += sum(ranges)
            place = p.getBasePositionAndOrientation(rover)[0]
            self.metres += math.dist(place[:2], self._places[number][:2])
            self._places[number] = place

    def run(self, seconds: float, first: int, deadline: float) -> tuple[float, int]:
        """Advance; returns the simulated s done and the number of the next command."""
        per_scan = round(1.0 / (self.laser["rate"] * TIMESTEP))
        per_command = round(self.work["command_period"] / TIMESTEP)
        commands = self.work["commands"]
        steps, number = 0, first
        while steps < round(seconds / TIMESTEP) and time.perf_counter() < deadline:
            self.command(commands[number % len(commands)])
            number += 1
            for _ in range(per_command // per_scan):
                for _ in range(per_scan):
                    p.stepSimulation()
                self.look()
            steps += per_command
        return steps * TIMESTEP, number


def main() -> None:
    """Do the work, write the result."""
    with open(sys.argv[1], encoding="utf-8") as file:
        work = json.load(file)
    arena = Arena(work)
    _, number = arena.run(work["warm_up"], 0, math.inf)
    arena.forget()
    wall, cpu = time.perf_counter(), time.process_time()
    simulated, _ = arena.run(work["seconds"], number, wall + work["wall_limit"])
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    result = {
        "version": version("pybullet"),
        "simulated": simulated,
        "wall": wall,
        "cpu": cpu,
        "counts": {
            "scans": arena.scans,
            "beams": arena.beams,
            "hits": arena.hits,
            "reach": arena.reach,
            "metres": arena.metres,
        },
    }
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump(result, file)


if __name__ == "__main__":
    main()
