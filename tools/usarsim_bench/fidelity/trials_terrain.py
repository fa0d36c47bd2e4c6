"""Acceptance tests on obstacles: V14 to V20, V22 and single items of 5.3."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from usarsim_bench.fidelity import theory, worlds
from usarsim_bench.fidelity.results import ANY, Band, Result
from usarsim_bench.fidelity.terrain import (
    FIELD_END,
    Crossing,
    climb,
    creep,
    cross,
    push_crate,
    push_wall,
    slide_block,
)
from usarsim_bench.fidelity.workshop import Case, Workshop
from usarsim_bench.fidelity.worlds import FIELD_START, PLATFORM
from usarsim_server.simulation.frames import Pose

Results = Iterator[Result]
Steps = Sequence[float]

SKID = ("P3AT_real", "P3AT_fast", "P2AT")
LOW_BELLY = "P3AT_fast"
"""The UDK class has 5.3 cm of ground clearance; posts of 6 cm may hold it by its belly."""
SPIN = 3.0
"""rad/s of the wheels on every obstacle."""
GRADE = math.degrees(math.atan(0.35))
"""Slope of the datasheet, degrees."""
STEEP = 40.0
"""Degrees from which on robots tip over before they slip."""
MARGIN = 3.0
"""Degrees above and below the limit of a slope."""
SEEDS = range(4)
LOW_POSTS = tuple(n / 100 for n in range(7))
CUBIC_POSTS = (0.0, 0.05, 0.10)
BEYOND = 0.3
"""m behind an obstacle where it counts as crossed."""


def grade(shop: Workshop, steps: Steps) -> Results:
    """V14: a 35 % grade is climbed."""
    for robot in SKID:
        for timestep in steps:
            way = _climb(shop, robot, timestep, GRADE, 0.8)
            yield Case("V14", robot, timestep).result(
                "way up a 35 % grade, mu 0.8, 5 s", way, "m", "climbs", Band(low=1.0)
            )


def slope_limits(shop: Workshop, steps: Steps) -> Results:
    """V15: the steepest slope is that of the friction."""
    for robot in SKID:
        for timestep in steps:
            case = Case("V15", robot, timestep)
            for friction in (0.4, 0.6, 0.8, 1.0):
                limit = math.degrees(theory.slope_limit(friction))
                for degrees, target, band in (
                    (limit - MARGIN, "climbs", Band(low=0.5)),
                    (limit + MARGIN, "slides", Band(high=0.0)),
                ):
                    if degrees < STEEP:
                        way = _climb(shop, robot, timestep, degrees, friction)
                        quantity = f"way up {degrees:.1f} deg, mu {friction:g}, 5 s"
                        yield case.result(quantity, way, "m", target, band)


def _climb(shop: Workshop, robot: str, timestep: float, degrees: float, friction: float) -> float:
    pose = worlds.on_slope(degrees, shop.rest_height(robot))
    with shop.stage(worlds.slope(degrees, friction), robot, timestep, pose) as stage:
        return climb(stage, SPIN)


def parking(shop: Workshop, steps: Steps) -> Results:
    """V16: a robot told to stand still on a slope does."""
    degrees = 15.0
    for robot in (*SKID, "P2DX", "P3AT_brakeless"):
        for timestep in steps:
            pose = worlds.on_slope(degrees, shop.rest_height(robot))
            with shop.stage(worlds.slope(degrees, 1.0), robot, timestep, pose) as stage:
                speed = creep(stage)
            yield Case("V16", robot, timestep).result(
                "creep on 15 deg", 1e3 * speed, "mm/s", "0", Band(high=6.0)
            )


def square_steps(shop: Workshop, steps: Steps) -> Results:
    """V17: steps up to most of a wheel radius are climbed."""
    cases = [("P3AT_strong", 6), ("P3AT_strong", 8), ("P3AT_strong", 10)]
    cases += [("P3AT_fast", 6), ("P2AT", 6)]
    for robot, height in cases:
        for timestep in steps:
            with shop.stage(worlds.step(height / 100), robot, timestep) as stage:
                run = cross(stage, SPIN, 10.0, FIELD_START + 1.0)
            required = height < 10
            yield Case("V17", robot, timestep).result(
                f"rise at a step of {height} cm",
                100 * run.rise,
                "cm",
                f"{height}" if required else "not required",
                Band(low=height - 0.1) if required else ANY,
            )


def gaps(shop: Workshop, steps: Steps) -> Results:
    """V18: a gap of 15 cm is crossed; one of 20 cm swallows the real 3-AT."""
    for robot, width in (*((robot, 15) for robot in SKID), ("P3AT_real", 20)):
        for timestep in steps:
            pose = Pose((0.0, 0.0, PLATFORM + shop.rest_height(robot)))
            with shop.stage(worlds.gap(width / 100), robot, timestep, pose) as stage:
                run = cross(stage, SPIN, 10.0, FIELD_START + 1.0 + width / 100)
            falls = width == 20
            yield Case("V18", robot, timestep).result(
                f"way beyond a gap of {width} cm",
                run.x - FIELD_START - width / 100,
                "m",
                "falls" if falls else "crosses",
                Band(high=BEYOND) if falls else Band(low=BEYOND),
            )


def step_fields(shop: Workshop, steps: Steps) -> Results:
    """V19, #61 and #62: low step fields are crossed, without contortions."""
    for robot in SKID:
        for timestep in steps:
            runs = _fields(shop, robot, timestep, "low", LOW_POSTS)
            low = robot == LOW_BELLY
            yield Case("V19", robot, timestep).result(
                "fields of 0 to 6 cm crossed, of 4",
                _crossed(runs),
                "",
                "optional" if low else "4",
                ANY if low else Band(4.0, 4.0),
            )
            yield Case("V19", robot, timestep).result(
                "largest tilt",
                math.degrees(max(run.tilt for run in runs)),
                "deg",
                "no flip",
                Band(high=60.0),
            )
            yield Case("#61", robot, timestep).result(
                "contact with itself", sum(run.own for run in runs), "", "0", Band(0.0, 0.0)
            )
            yield Case("#62", robot, timestep).result(
                "longest way in one step",
                1e3 * max(run.jump for run in runs),
                "mm",
                "small",
                Band(high=100.0),
            )


def cubic_field(shop: Workshop, steps: Steps) -> Results:
    """V20: cubic step fields are numerically sound; crossing them is not required."""
    for robot in SKID:
        for timestep in steps:
            runs = _fields(shop, robot, timestep, "cubic", CUBIC_POSTS)
            case = Case("V20", robot, timestep)
            yield case.result(
                "overlap on fields of 0, 5, 10 cm",
                1e3 * max(run.depth for run in runs),
                "mm",
                "below 15",
                Band(high=15.0),
            )
            yield case.result(
                "numerical warnings", sum(run.warnings for run in runs), "", "0", Band(0.0, 0.0)
            )
            yield case.result("fields crossed, of 4", _crossed(runs), "", "optional", ANY)


def _fields(
    shop: Workshop, robot: str, timestep: float, name: str, levels: Sequence[float]
) -> list[Crossing]:
    runs = []
    for seed in SEEDS:
        scene = worlds.step_field(f"{name}{seed}", worlds.symmetric_heights(seed, levels))
        with shop.stage(scene, robot, timestep) as stage:
            runs.append(cross(stage, SPIN, 20.0, FIELD_END + BEYOND))
    return runs


def _crossed(runs: Sequence[Crossing]) -> int:
    """How many came out on the far side, not off the edge of the field."""
    return sum(run.x > FIELD_END + BEYOND and abs(run.y) < 0.6 for run in runs)


def sliding(shop: Workshop, steps: Steps) -> Results:
    """V22: a block slides as far as Coulomb friction lets it."""
    for timestep in steps:
        for friction in (0.3, 0.5, 1.0):
            way, _ = slide_block(shop.world(worlds.sliding_block(friction)), timestep, 1.0)
            expected = theory.sliding_distance(1.0, friction)
            yield Case("V22", "block", timestep).result(
                f"slide from 1 m/s, mu {friction:g}",
                1e3 * way,
                "mm",
                f"{1e3 * expected:.1f}",
                Band(950 * expected, 1050 * expected),
            )


def wall(shop: Workshop, steps: Steps) -> Results:
    """#59: a wall stops a robot at full speed."""
    for robot in (*SKID, "P3DX", "pioneer3at_with_sensors", "pioneer2dx_with_sensors"):
        for timestep in steps:
            with shop.stage(worlds.wall(), robot, timestep) as stage:
                run = push_wall(stage, stage.robot.drive.max_wheel_speed)
            case = Case("#59", robot, timestep)
            yield case.result("overlap with a wall", 1e3 * run.depth, "mm", "0", Band(high=10.0))
            yield case.result("climb at a wall", 1e3 * run.rise, "mm", "0", Band(high=10.0))
            yield case.result("speed at a wall", 1e3 * run.speed, "mm/s", "0", Band(high=10.0))


def crate(shop: Workshop, steps: Steps) -> Results:
    """#60: a crate is pushed along, not run over and not lost."""
    for robot in SKID:
        for timestep in steps:
            with shop.stage(worlds.crate(2.0), robot, timestep) as stage:
                moved, ahead, aside = push_crate(stage, SPIN, 5.0)
            case = Case("#60", robot, timestep)
            yield case.result("way of a pushed crate of 2 kg", moved, "m", "5", Band(low=5.0))
            yield case.result("crate ahead of the robot", ahead, "m", "touching", Band(0.3, 0.6))
            yield case.result("crate aside", 1e3 * abs(aside), "mm", "0", Band(high=200.0))
