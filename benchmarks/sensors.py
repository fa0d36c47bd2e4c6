"""Robots with many or fast sensors: do they keep time, and does everything arrive.

Both teams drive classes of their own, variants of the shipped one in a folder that exists only
while they are measured.
"""

from __future__ import annotations

import random
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path

from benchmarks.measures import rate, streams
from benchmarks.plan import Plan
from benchmarks.robot_files import write_class
from benchmarks.server import Server
from benchmarks.team import FACTOR_AIM, TeamTrial, named, team_figures, try_team
from usarsim_bench.crowd import DEFAULT_CLASS, Behaviour, Controller, Crowd, wander
from usarsim_bench.figures import Aim, Figure, Section
from usarsim_bench.recording import Chunk, lines

ROBOTS = 4
SECONDS = 30.0

EVERYTHING, LASER = "EverySensor", "FastLaser"
"""Classes of the two teams."""

SENSOR_TYPES = (
    *("3DRangeScanner", "Accel", "Acceleration", "Accelerometer", "Acoustic"),
    *("AcousticArraySensor", "AltitudeSensor", "Battery", "BumperArray", "CO2", "CO2Sensor"),
    *("Encoder", "ExampleAcousticArray", "ExampleSonarArray", "GPS", "GPSSensor", "GroundTruth"),
    *("GroundTruthMovable", "Helper", "Hokuyo", "HokuyoURG04LX", "HumanMotion"),
    *("HumanMotionSensor", "IMU", "INS", "INU", "IR", "IRScanner", "IRSensor", "KinectDepth"),
    *("LineLaser", "MagneticCompass", "MissionTime", "ObjectSensor", "Odometry", "PCL"),
    *("RangeImager", "RangeScanner", "RangeScanner3D", "RangeSensor", "RangeSensorArray", "RFID"),
    *("RFIDReader", "RFIDReleaser", "RFIDSensor", "RFIDTag", "RotatingPointCloudScanner", "SICK"),
    *("Sonar", "SonarSensor", "Sound", "SoundSensor", "Tachometer", "Touch", "TouchArray"),
    *("VictimRFID", "VictRFID", "VictSensor"),
)
"""Every type that a robot file may name, other spellings included."""

_NEEDED = {"Encoder": "wheel = 0"}
"""Keys without which a type cannot be used."""
_PLACE = "position = [0.2, 0, -0.2]"
"""On the deck (wire frame); from there other robots are seen."""

BEAMS = 1081
LASER_RATE = 20.0
"""Scans per second: as a Hokuyo UTM-30LX, 270 degrees and 30 m, at half of its rate."""
_LASER_KEYS = f"fov = 4.71, resolution = 0.00436, max_range = 30.0, interval = {1.0 / LASER_RATE:g}"
RATE_AIM = Aim(">=", 19.0)

IMAGE_CHANCE = 0.2
"""How often a command to drive is followed by one for a depth image: every 2.5 s on average. An
image takes 2 s."""

_SCAN = re.compile(rb"SEN .*\{Name %s\}.*\{Range ([^{}]*)\}" % LASER.encode())
_FRAME = re.compile(rb"SEN .*\{Type RangeImager\}.*\{Frames (\d+)\} \{Frame (\d+)\} \{Range ")


def write_classes(folder: Path) -> None:
    """Write the robot files of both teams into a folder."""
    every = (_sensor(type_, f"Any{type_}", _NEEDED.get(type_, "")) for type_ in SENSOR_TYPES)
    write_class(folder, EVERYTHING, sensors=every)
    write_class(folder, LASER, sensors=[_sensor("RangeScanner", LASER, _LASER_KEYS)])


def _sensor(type_: str, name: str, keys: str) -> str:
    parts = [f'type = "{type_}"', f'name = "{name}"', _PLACE, keys]
    return f"{{ {', '.join(filter(None, parts))} }}"


def look_around(controller: Controller, dice: random.Random) -> None:
    """Drive at random, and now and then have the depth cameras take an image."""
    wander(controller, dice)
    if dice.random() < IMAGE_CHANCE:
        controller.send("SET {Type RangeImager} {Opcode SCAN}")


def whole_scans(chunks: Iterable[Chunk]) -> list[float]:
    """Arrivals of the fast laser's scans that have all their beams."""
    found = ((moment, _SCAN.match(line)) for moment, line in lines(chunks))
    return [moment for moment, scan in found if scan and scan[1].count(b",") == BEAMS - 1]


def whole_images(chunks: Iterable[Chunk]) -> list[float]:
    """Arrivals of the last frame of every depth image."""
    found = ((moment, _FRAME.match(line)) for moment, line in lines(chunks))
    return [moment for moment, part in found if part and int(part[2]) == int(part[1]) - 1]


def measure_sensors(plan: Plan) -> Section:
    """Two teams one after the other; `plan.seconds` of wall time are watched for each."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    with tempfile.TemporaryDirectory(prefix="usarsim-bench-") as name:
        folder = Path(name)
        write_classes(folder)
        every, told = _watch(plan, folder, EVERYTHING, look_around, robots, seconds)
        laser, scanned = _watch(plan, folder, LASER, wander, robots, seconds)
    images = sum(rate(whole_images(chunks), every.start, every.stop) for chunks in told)
    scans = [rate(whole_scans(chunks), laser.start, laser.stop) for chunks in scanned]
    return Section(
        "sensors",
        "Many sensors, fast sensors",
        f"{robots} robots in {plan.world}, random DRIVE commands at 2 Hz each, clients in another "
        f"process, {seconds:g} s for each team. All types: {DEFAULT_CLASS} with its own sensors "
        f"and one of each of the {len(SENSOR_TYPES)} types, depth images asked for now and then. "
        f"Lasers: {DEFAULT_CLASS} with its own sensors and a scanner of {BEAMS} beams, "
        f"{LASER_RATE:g} times a second.",
        (
            *named("All types", team_figures(every, FACTOR_AIM)),
            Figure("All types: streams of a robot, fewest", min(len(streams(c)) for c in told)),
            Figure("All types: depth images of all robots", images, "1/s"),
            *named("Lasers", team_figures(laser, FACTOR_AIM)),
            Figure("Lasers: whole scans of a robot, fewest", min(scans), "1/s", 2, RATE_AIM),
        ),
    )


def _watch(
    plan: Plan, folder: Path, robot_class: str, behaviour: Behaviour, robots: int, seconds: float
) -> tuple[TeamTrial, list[list[Chunk]]]:
    """A trial of a team of one class, and everything that each client received."""
    plan.say(f"sensors: {robots} {robot_class} for {seconds:g} s")
    with (
        Server(plan.world, robots, "--robots", str(folder)) as server,
        Crowd(server.port, plan.seed, behaviour) as crowd,
    ):
        trial = try_team(server, crowd, robots, seconds, robot_class)
        return trial, [one.chunks for one in crowd.controllers]
