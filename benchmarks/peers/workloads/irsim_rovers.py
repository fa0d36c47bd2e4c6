"""Rovers with lasers in IR-SIM: python -I irsim_rovers.py WORK.json RESULT.json."""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
import time
from importlib.metadata import version
from typing import Any

import irsim
import yaml


def world_file(work: dict[str, Any], folder: str) -> str:
    """Write the hall and the rovers as IR-SIM's YAML; returns the file's name."""
    robot, laser = work["robot"], work["laser"]
    top = robot["wheel_radius"] * robot["top_speed"]
    mass = robot["chassis_mass"] + len(robot["wheels"]) * robot["wheel_mass"]
    length = robot["chassis"][0]
    width = robot["track"] + robot["wheel_width"]
    sensor = {
        "name": "lidar2d",
        "range_min": 0.0,
        "range_max": laser["range"],
        "angle_range": laser["fov"],
        "number": laser["beams"],
        "noise": False,
        "offset": [laser["forward"], 0, 0],
    }
    rovers = [
        {
            "kinematics": {"name": "diff"},
            "shape": {"name": "rectangle", "length": length, "width": width},
            "state": start,
            "mass": mass,
            "friction": robot["friction"],
            "vel_max": [top, 2.0 * top / robot["track"]],
            "vel_min": [-top, -2.0 * top / robot["track"]],
            "sensors": [sensor],
        }
        for start in work["starts"]
    ]
    obstacles = [
        {
            "shape": {
                "name": "rectangle",
                "length": 2.0 * box["half"][0],
                "width": 2.0 * box["half"][1],
            },
            "state": [box["center"][0], box["center"][1], box["yaw"]],
            "kinematics": {"name": "static"},
        }
        for box in work["boxes"]
    ]
    world = {
        "width": 2.0 * work["half_x"],
        "height": 2.0 * work["half_y"],
        "offset": [-work["half_x"], -work["half_y"]],
        "step_time": 1.0 / laser["rate"],
        "sample_time": 1.0 / laser["rate"],
        "collision_mode": "contact",
        "control_mode": "auto",
    }
    name = os.path.join(folder, "hall.yaml")
    with open(name, "w", encoding="utf-8") as file:
        yaml.safe_dump({"world": world, "robot": rovers, "obstacle": obstacles}, file)
    return name


class Hall:
    """The running world.

    Attributes:
        scans, beams, hits: whole scans, their beams, and those of them that hit something.
        reach: sum of all ranges measured, m.
        metres: way of all rovers together.
    """

    def __init__(self, work: dict[str, Any], env: Any) -> None:
        self.work, self.env = work, env
        self._places = self._look_where()
        self.forget()

    def forget(self) -> None:
        """Begin to count."""
        self.scans = self.beams = self.hits = 0
        self.reach = self.metres = 0.0

    def _look_where(self) -> list[tuple[float, float]]:
        return [(float(one.state[0, 0]), float(one.state[1, 0])) for one in self.env.robot_list]

    def run(self, seconds: float, first: int, deadline: float) -> tuple[float, int]:
        """Advance; returns the simulated s done and the number of the next command."""
        work, robot, laser = self.work, self.work["robot"], self.work["laser"]
        robots = list(range(work["robots"]))
        per_command = round(work["command_period"] * laser["rate"])
        steps, number = 0, first
        while steps < round(seconds * laser["rate"]) and time.perf_counter() < deadline:
            speeds = work["commands"][number % len(work["commands"])]
            number += 1
            actions = [
                [
                    robot["wheel_radius"] * (left + right) / 2,
                    robot["wheel_radius"] * (right - left) / robot["track"],
                ]
                for left, right in speeds
            ]
            for _ in range(per_command):
                self.env.step(actions, action_id=robots)
                self._read()
            steps += per_command
        return steps / laser["rate"], number

    def _read(self) -> None:
        for one in self.env.robot_list:
            scan = one.get_lidar_scan()
            self.scans += 1
            self.beams += len(scan["ranges"])
            self.reach += float(scan["ranges"].sum())
            self.hits += int(scan["valid"].sum())
        places = self._look_where()
        self.metres += sum(map(math.dist, places, self._places))
        self._places = places


def main() -> None:
    """Do the work, write the result."""
    with open(sys.argv[1], encoding="utf-8") as file:
        work = json.load(file)
    with tempfile.TemporaryDirectory() as folder:
        env = irsim.make(world_file(work, folder), headless=True, log_level="ERROR", seed=0)
    hall = Hall(work, env)
    _, number = hall.run(work["warm_up"], 0, math.inf)
    hall.forget()
    wall, cpu = time.perf_counter(), time.process_time()
    simulated, _ = hall.run(work["seconds"], number, wall + work["wall_limit"])
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    result = {
        "version": version("ir-sim"),
        "simulated": simulated,
        "wall": wall,
        "cpu": cpu,
        "counts": {
            "scans": hall.scans,
            "beams": hall.beams,
            "hits": hall.hits,
            "reach": hall.reach,
            "metres": hall.metres,
        },
    }
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump(result, file)


if __name__ == "__main__":
    main()
