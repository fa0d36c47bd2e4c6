"""Acceptance tests on level ground: V1 to V13, V26, V27 and single items of 5.2 and 5.3."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence

from usarsim_bench.fidelity import theory, worlds
from usarsim_bench.fidelity.manoeuvres import (
    drive_arc,
    drive_straight,
    rest,
    stop,
    turn_in_place,
    watch_straight,
)
from usarsim_bench.fidelity.results import ANY, Band, Result
from usarsim_bench.fidelity.workshop import Case, Workshop
from usarsim_server.testing import Rehearsal

Results = Iterator[Result]
Steps = Sequence[float]

SKID = ("P3AT_real", "P3AT_fast", "P2AT")
"""Skid-steered robots that can be driven at several rad/s."""
HEAVY = ("ATRVJr", "ATRV", "BasicSkidRobot")
"""Those whose servos have most to do in a turn."""
WHEELED = (*SKID, "P2DX")
GAZEBO = ("pioneer3at_with_sensors", "pioneer2dx_with_sensors")
FRICTIONS = (0.3, 0.5, 1.0)
SPEEDS = (1.0, 3.0, 6.0)
"""rad/s; a robot that cannot go as fast does what it can."""
ARCS = ((2.0, 4.0), (0.0, 4.0), (3.0, 4.0))
SPREAD = Band(0.0, 0.02)


def straight_speed(shop: Workshop, steps: Steps) -> Results:
    """V1: ground speed is wheel speed times radius."""
    for robot in (*WHEELED, *GAZEBO):
        for timestep in steps:
            for speed in SPEEDS:
                with shop.stage(worlds.flat(), robot, timestep) as stage:
                    spin = min(speed, stage.robot.drive.max_wheel_speed)
                    run = drive_straight(stage, spin)
                yield Case("V1", robot, timestep).result(
                    f"speed / (r w) at {speed:g} rad/s", run.ratio, "", "1", Band(0.990, 1.005)
                )


def straight_drift(shop: Workshop, steps: Steps) -> Results:
    """V2: five metres straight ahead without leaving the line."""
    for robot in WHEELED:
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                way = 5.0
                run = drive_straight(stage, 3.0, way / (3.0 * stage.robot.report.wheel_radius))
            case = Case("V2", robot, timestep)
            yield case.result("off the line on 5 m", 1e3 * run.lateral, "mm", "0", Band(high=5.0))
            yield case.result("off the heading", math.degrees(run.yaw), "deg", "0", Band(high=0.1))


def top_speed(shop: Workshop, steps: Steps) -> Results:
    """V3 and #23: what a robot does at its limit."""
    expected = {
        "P2AT": ("V3", 0.700, Band(0.68, 0.71)),
        "P3AT": ("#23", 0.127, Band(0.126, 0.128)),
        "P3AT_fast": ("#23", 0.80, Band(0.79, 0.805)),
    }
    for robot, (test, speed, band) in expected.items():
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                start = stage.settle()
                stage.client.send("DRIVE {Left 100} {Right 100} {Normalized True}")
                run = watch_straight(stage, start, stage.robot.drive.max_wheel_speed, 6.0)
            yield Case(test, robot, timestep).result(
                "top speed", run.speed, "m/s", f"{speed:g}", band
            )


def turn_ratio(shop: Workshop, steps: Steps) -> Results:
    """V4: a turn in place is slower than that of a differential robot, as theory says."""
    for robot in (*SKID, GAZEBO[0]):
        with shop.stage(worlds.flat(), robot, steps[0]) as stage:
            half_base, half_track, half_width = theory.wheel_layout(stage.robot)
        points = theory.turn_ratio_points(half_base, half_track)
        edges = theory.turn_ratio_edges(half_base, half_track, half_width)
        for timestep in steps:
            yield Case("V4", robot, timestep).result(
                "turn ratio at 3 rad/s",
                shop.turn(robot, timestep, 3.0).ratio,
                "",
                f"{points:.3f}, edges {edges:.3f}",
                Band(edges - 0.02, points + 0.02),
            )


def effective_track(shop: Workshop, steps: Steps) -> Results:
    """V5 and V6: the track that a differential robot would need to turn like this."""
    for timestep in steps:
        yield Case("V5", "P3AT_real", timestep).result(
            "effective track",
            shop.turn("P3AT_real", timestep, 3.0).track,
            "m",
            "0.588 (ARIA)",
            Band(0.56, 0.62),
        )
        yield Case("V6", "P3DX", timestep).result(
            "effective track",
            shop.turn("P3DX", timestep, 2.0).track,
            "m",
            "0.330, ARIA 0.357",
            Band(0.325, 0.375),
        )


def speed_independence(shop: Workshop, steps: Steps) -> Results:
    """V7: the turn ratio does not depend on the wheel speed."""
    for robot in (*SKID, *HEAVY):
        for timestep in steps:
            ratios = [shop.turn(robot, timestep, speed).ratio for speed in SPEEDS]
            yield Case("V7", robot, timestep).result(
                "spread of turn ratio, 1, 3, 6 rad/s", _spread(ratios), "", "0", SPREAD
            )


def friction_independence(shop: Workshop, steps: Steps) -> Results:
    """V8: the turn ratio does not depend on friction."""
    for robot in SKID:
        for timestep in steps:
            ratios = [shop.turn(robot, timestep, 3.0, mu).ratio for mu in FRICTIONS]
            yield Case("V8", robot, timestep).result(
                "spread of turn ratio, mu 0.3, 0.5, 1", _spread(ratios), "", "0", SPREAD
            )


def timestep_independence(shop: Workshop, steps: Steps) -> Results:
    """V9: the turn ratio does not depend on the time step."""
    compared = steps if len(steps) > 1 else (0.002, *steps)
    names = ", ".join(f"{step * 1e3:g}" for step in sorted(compared))
    for robot in SKID:
        ratios = [shop.turn(robot, timestep, 3.0).ratio for timestep in compared]
        yield Case("V9", robot, None).result(
            f"spread of turn ratio, {names} ms", _spread(ratios), "", "0", SPREAD
        )


def timestep_agreement(shop: Workshop, steps: Steps) -> Results:
    """#120: speeds, turns and arcs hardly depend on the time step."""
    compared = steps if len(steps) > 1 else (0.002, *steps)
    for robot in ("P3AT_real", "P2AT"):
        found: dict[str, list[float]] = {"speed": [], "turn": [], "arc": []}
        for timestep in compared:
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                found["speed"].append(drive_straight(stage, 3.0).speed)
            found["turn"].append(shop.turn(robot, timestep, 3.0).rate)
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                found["arc"].append(drive_arc(stage, 0.0, 4.0).rate)
        for name, values in found.items():
            yield Case("#120", robot, None).result(
                f"{name}: spread over time steps",
                100 * _spread(values) / min(values),
                "%",
                "0",
                Band(0.0, 3.0),
            )


def hop(shop: Workshop, steps: Steps) -> Results:
    """V10, #30, #31 and #61: no hopping, wheels on the ground and clear of the robot itself."""
    for robot in SKID:
        for timestep in steps:
            case = Case("V10", robot, timestep)
            for speed in (3.0, 6.0):
                turn = shop.turn(robot, timestep, speed)
                at = f"turning at {speed:g} rad/s"
                yield case.result(f"hop, {at}", 1e3 * turn.hop, "mm", "0", Band(high=0.5))
                yield case.result(
                    f"all wheels touch, {at}", 100 * turn.contact, "%", "100", Band(99.0, 100.0)
                )
            yield Case("#61", robot, timestep).result(
                "contact with itself", turn.own, "", "0", Band(0.0, 0.0)
            )


def arc(shop: Workshop, steps: Steps) -> Results:
    """V11: on an arc a skid-steered robot turns less than a differential one."""
    for robot in ("P3AT_real", "P3AT_fast"):
        for timestep in steps:
            for left, right in ARCS:
                with shop.stage(worlds.flat(), robot, timestep) as stage:
                    run = drive_arc(stage, left, right)
                yield Case("V11", robot, timestep).result(
                    f"yaw ratio of the arc {left:g}/{right:g} rad/s",
                    run.ratio,
                    "",
                    "below 1",
                    Band(0.45, 0.70),
                )


def yaw_rate_limit(shop: Workshop, steps: Steps) -> Results:
    """V12: how fast the real 3-AT turns in place; for information."""
    for timestep in steps:
        turn = shop.turn("P3AT_real", timestep, 6.4)
        yield Case("V12", "P3AT_real", timestep).result(
            "yaw rate at the wheel limit", math.degrees(turn.rate), "deg/s", "140 (datasheet)", ANY
        )


def stopping(shop: Workshop, steps: Steps) -> Results:
    """V13: DRIVE 0 0 stops within a hand's breadth."""
    for robot in WHEELED:
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                way = stop(stage, 0.33)
            yield Case("V13", robot, timestep).result(
                "overrun from 0.33 m/s", 1e3 * way, "mm", "below 20", Band(0.0, 30.0)
            )


def odometry(shop: Workshop, steps: Steps) -> Results:
    """V27: odometry over-rotates by the inverse of the turn ratio."""
    for robot in SKID:
        for timestep in steps:
            turn = shop.turn(robot, timestep, 3.0)
            yield Case("V27", robot, timestep).result(
                "odometry yaw / true yaw x ratio",
                turn.odometry * turn.grip,
                "",
                "1",
                Band(0.97, 1.03),
            )


def pivot(shop: Workshop, steps: Steps) -> Results:
    """#38: a robot with a caster turns about the middle of its axle."""
    for timestep in steps:
        with shop.stage(worlds.flat(), "P2DX", timestep) as stage:
            report = stage.robot.report
            rate = 2 * 3.0 * report.wheel_radius / report.track_width
            turn = turn_in_place(stage, 3.0, round(math.tau / rate / timestep) * timestep)
        yield Case("#38", "P2DX", timestep).result(
            "axle centre off its place in a turn", 1e3 * turn.drift, "mm", "0", Band(high=20.0)
        )


def resting(shop: Workshop, steps: Steps) -> Results:
    """#63 and #64: a robot that nobody commands stays where it is, on the floor."""
    for robot in (*WHEELED, "P3AT", *GAZEBO):
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                found = rest(stage, 60.0)
            case = Case("#64", robot, timestep)
            yield case.result("moved in 60 s", 1e3 * found.moved, "mm", "0", Band(high=1.0))
            yield case.result(
                "rotated in 60 s", math.degrees(found.rotated), "deg", "0", Band(high=0.1)
            )
            yield Case("#63", robot, timestep).result(
                "overlap with the floor", 1e3 * found.depth, "mm", "0", Band(high=1.0)
            )


def repeatability(shop: Workshop, steps: Steps) -> Results:
    """V26: equal commands and seed give equal states and lines, bit for bit."""
    for timestep in steps:
        first, second = (run_script(shop, timestep, 60.0) for _ in range(2))
        differing = sum(a != b for a, b in zip(first, second, strict=False))
        yield Case("V26", "two robots", timestep).result(
            "lines and states that differ in 60 s",
            differing + abs(len(first) - len(second)),
            "",
            "0",
            Band(0.0, 0.0),
        )


def run_script(shop: Workshop, timestep: float, seconds: float) -> list[str]:
    """Drive two robots over a step field with odd commands.

    Returns:
        Every line that either of them received, and the whole state after each second.
    """
    scene = worlds.step_field("script", worlds.symmetric_heights(1, [0.0, 0.01, 0.02, 0.03]))
    draw = random.Random(5)
    found: list[str] = []
    with Rehearsal(world=str(shop.world(scene)), timestep=timestep, seed=7) as rehearsal:
        clients = [rehearsal.connect() for _ in range(2)]
        for client, name, y in zip(clients, ("P2AT", "P3AT_real"), (-0.35, 0.35), strict=True):
            client.send(f"INIT {{ClassName USARBot.{name}}} {{Location 0.3,{y},-0.2}}")
        for _ in range(round(seconds)):
            for client in clients:
                left, right = draw.uniform(-1.0, 5.0), draw.uniform(-1.0, 5.0)
                client.send(f"DRIVE {{Left {left:.3f}}} {{Right {right:.3f}}}")
            rehearsal.run(1.0)
            state = rehearsal.assembly.simulation.look()
            found += [state.qpos.tobytes().hex(), state.qvel.tobytes().hex()]
        for client in clients:
            found += client.take()
    return found


def _spread(values: Sequence[float]) -> float:
    return max(values) - min(values)
