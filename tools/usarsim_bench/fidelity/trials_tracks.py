"""Acceptance tests of tracked robots: V19 and V21, and single items of 5.2 and 5.3."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from usarsim_bench.fidelity import worlds
from usarsim_bench.fidelity.lanes import LANE, Lane, drive_lanes
from usarsim_bench.fidelity.manoeuvres import turn_in_place
from usarsim_bench.fidelity.results import Band, Result
from usarsim_bench.fidelity.stage import Stage
from usarsim_bench.fidelity.terrain import FIELD_END, Crossing, cross
from usarsim_bench.fidelity.workshop import Case, Workshop
from usarsim_bench.fidelity.worlds import FIELD_START
from usarsim_server.robots.description import RobotDescription
from usarsim_server.sessions.robots import robot_model
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import PhysicsOptions

Results = Iterator[Result]
Steps = Sequence[float]

RUN = 0.3
"""m/s of the belts in all these tests (robots reference 5.2 #47)."""
REFERENCE_RATIOS = {"Kenaf": 0.328, "TeleMax": 0.655}
"""Turn in place over that of a differential robot, taken once from these models (5.2 #39)."""
TRACKED = (
    *("Kenaf", "Tarantula", "TeleMax", "Talon"),
    *("Rugbot", "Matilda", "crawler_robot", "Soryu"),
)
CLIMBERS = TRACKED[:4]
"""Classes that climb the stairs of V21."""
PUSHES = (1.0, 0.3, -1.0)
"""Shares of their top speed at which robots run into a wall, the last one backwards."""
PUSHING = 10.0
"""s from the start to the end of a push."""
SPREAD = 0.02
SEEDS = range(4)
LOW_POSTS = tuple(n / 100 for n in range(7))
BEYOND = 0.3
"""m behind a field where it counts as crossed."""
COURSE = 4.0
"""How sharply a robot is steered back to its line (see `cross`)."""
STAIRS_END = FIELD_START + 6 * 0.28
"""x of the edge of the landing, m."""
LOAD = 5.0
"""kg on the tip of a flipper (5.2 #46)."""
GRAVITY = 9.81


def spin(stage: Stage, belts: float = RUN) -> float:
    """Speed of the sprockets (rad/s) at which the belts run at a speed (m/s)."""
    return belts / stage.robot.driven_wheels[0].radius


def posture(stage: Stage, angles: Mapping[str, float]) -> None:
    """Bring flippers to angles (rad)."""
    groups = " ".join(f"{{{joint} {angle:g}}}" for joint, angle in angles.items())
    stage.client.send(f"MULTIDRIVE {groups}")
    stage.run(2.0)


def raised(front: float, rear: float = 0.0) -> dict[str, float]:
    """Angles of four flippers that are raised by so much (rad) in front and at the back.

    All of them turn about the same axis, so those in front go up with negative angles.
    """
    return {"FRFlipper": -front, "FLFlipper": -front, "RRFlipper": rear, "RLFlipper": rear}


# -- on the level ----------------------------------------------------------------------------------


def ground_speed(stage: Stage, seconds: float = 3.0) -> float:
    """Ground speed (m/s) with the belts at `RUN`, after two seconds."""
    stage.settle()
    stage.drive(spin(stage), spin(stage))
    stage.run(2.0)
    begin = stage.state.pose.position
    stage.run(seconds)
    return math.dist(begin[:2], stage.state.pose.position[:2]) / seconds


def belt_ratio(stage: Stage, seconds: float) -> tuple[float, float]:
    """Turn in place with the belts at `RUN`: yaw rate over the differential one, and hop (m)."""
    turn = turn_in_place(stage, spin(stage), seconds)
    return turn.ratio, turn.hop


def speed(shop: Workshop, steps: Steps) -> Results:
    """#47: the ground speed is that of the belts."""
    for robot in REFERENCE_RATIOS:
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                measured = ground_speed(stage)
            yield Case("#47", robot, timestep).result(
                "ground speed at 0.3 m/s of the belts", measured, "m/s", "0.3", Band(0.2985, 0.3015)
            )


def turning(shop: Workshop, steps: Steps) -> Results:
    """#39: tracked robots turn at their stored ratio, at every time step, without hopping."""
    for robot, ratio in REFERENCE_RATIOS.items():
        for timestep in steps:
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                measured, hop = belt_ratio(stage, shop.turn_seconds)
            case = Case("#39", robot, timestep)
            yield case.result(
                "turn ratio of the belts",
                measured,
                "",
                f"{ratio:g} (stored)",
                Band(ratio - SPREAD / 2, ratio + SPREAD / 2),
            )
            yield case.result("hop, turning", 1e3 * hop, "mm", "0", Band(high=0.5))


# -- flippers --------------------------------------------------------------------------------------


def flipper_error(
    shop: Workshop, robot: RobotDescription, joint: str, angle: float, timestep: float
) -> float:
    """Largest error (rad) of a flipper that holds an angle with a load hung on its outer roller.

    The load is no thing in the world: it pulls in the physics itself, below the protocol.
    """
    options = PhysicsOptions(timestep=timestep)
    engine = Engine(shop.scenery(worlds.flat()), options, slots=(robot_model(robot),))
    engine.occupy(0, 0, Pose((0.0, 0.0, robot.rest_height)))
    engine.command_joints(0, {joint: JointOrder(Order.POSITION, angle)})
    engine.advance(round(3.0 / timestep))
    layout = engine.world.layouts[0]
    model, data = engine.world.model, engine.data
    body = layout.links[joint.lower()]
    reach = max(
        (model.geom_pos[geom] for geom in layout.geoms if model.geom_bodyid[geom] == body),
        key=lambda place: abs(float(place[0])),
    )
    pull, nothing = np.array([0.0, 0.0, -LOAD * GRAVITY]), np.zeros(3)
    worst = 0.0
    for _ in range(round(2.0 / timestep)):
        point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ reach
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(model, data, pull, nothing, point, body, data.qfrc_applied)
        engine.advance(1)
        worst = max(worst, abs(float(data.qpos[layout.joint_qpos[joint.lower()]]) - angle))
    return worst


def stand_up(stage: Stage) -> tuple[float, float]:
    """Lower all flippers by 0.8 rad: largest error of an angle (rad), and rise of the body (m)."""
    wanted = raised(-0.8, -0.8)
    begin = stage.settle()
    posture(stage, wanted)
    stage.run(4.0)
    end = stage.state
    error = max(abs(end.joint_position(joint) - angle) for joint, angle in wanted.items())
    return error, end.pose.position[2] - begin.pose.position[2]


def flippers(shop: Workshop, steps: Steps) -> Results:
    """#46: flippers hold their angle with a load, and the robot on top of them."""
    for robot in REFERENCE_RATIOS:
        found = shop.describe(robot)
        for timestep in steps:
            case = Case("#46", robot, timestep)
            error = flipper_error(shop, found, "FRFlipper", -0.5, timestep)
            yield case.result("sag of a flipper under 5 kg", error, "rad", "0", Band(high=0.1))
            with shop.stage(worlds.flat(), robot, timestep) as stage:
                error, rise = stand_up(stage)
            yield case.result("sag, standing on flippers", error, "rad", "0", Band(high=0.1))
            yield case.result("rise, standing on flippers", 1e3 * rise, "mm", "", Band(low=50.0))


# -- obstacles -------------------------------------------------------------------------------------


def cross_field(shop: Workshop, robot: str, seed: int, timestep: float) -> Crossing:
    """Cross a step field of posts up to 6 cm with raised flippers, kept on course."""
    scene = worlds.step_field(f"low{seed}", worlds.symmetric_heights(seed, LOW_POSTS))
    with shop.stage(scene, robot, timestep) as stage:
        posture(stage, raised(0.4, 0.4))
        return cross(stage, spin(stage), 20.0, FIELD_END + BEYOND, COURSE)


def step_fields(shop: Workshop, steps: Steps) -> Results:
    """V19, #61 and #62: low step fields are crossed, without contortions."""
    for robot in REFERENCE_RATIOS:
        for timestep in steps:
            runs = [cross_field(shop, robot, seed, timestep) for seed in SEEDS]
            case = Case("V19", robot, timestep)
            across = sum(run.x > FIELD_END + BEYOND and abs(run.y) < 0.6 for run in runs)
            yield case.result("fields of 0 to 6 cm crossed, of 4", across, "", "4", Band(4.0, 4.0))
            yield case.result(
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


def climb_stairs(shop: Workshop, timestep: float, robot: str = "Kenaf") -> Crossing:
    """Climb six steps of 18 x 28 cm at mu 1 with the front flippers, if any, raised by 0.7 rad."""
    with shop.stage(worlds.stairs(), robot, timestep) as stage:
        if any(link.joint == "FRFlipper" for link in stage.robot.links):
            posture(stage, raised(0.7))
        return cross(stage, spin(stage), 25.0, STAIRS_END + 0.5, COURSE)


def stairs(shop: Workshop, steps: Steps) -> Results:
    """V21: tracked robots climb stairs."""
    for robot in CLIMBERS:
        for timestep in steps:
            run = climb_stairs(shop, timestep, robot)
            case = Case("V21", robot, timestep)
            yield case.result("rise on six steps of 18 cm", run.rise, "m", "1.08", Band(1.07, 1.09))
            yield case.result(
                "largest tilt on stairs", math.degrees(run.tilt), "deg", "no flip", Band(high=60.0)
            )
            yield case.result("warnings on stairs", run.warnings, "", "0", Band(0.0, 0.0))


def tilts_at_wall(shop: Workshop, timestep: float) -> dict[str, float]:
    """Largest tilt (rad) of each class that runs into a wall and goes on, at any of `PUSHES`."""
    lanes = [
        Lane(robot, share * robot.drive.max_wheel_speed)
        for robot in map(shop.describe, TRACKED)
        for share in PUSHES
    ]
    scene = worlds.wall(LANE * len(lanes))
    outcomes = drive_lanes(shop, scene, lanes, timestep, PUSHING)
    worst = dict.fromkeys(TRACKED, 0.0)
    for lane, outcome in zip(lanes, outcomes, strict=True):
        worst[lane.robot.name] = max(worst[lane.robot.name], outcome.tilt)
    return worst


def wall(shop: Workshop, steps: Steps) -> Results:
    """#59: at a wall no tracked robot rears up, however fast it comes."""
    for timestep in steps:
        for robot, tilt in tilts_at_wall(shop, timestep).items():
            yield Case("#59", robot, timestep).result(
                "largest tilt at a wall", math.degrees(tilt), "deg", "small", Band(high=30.0)
            )
