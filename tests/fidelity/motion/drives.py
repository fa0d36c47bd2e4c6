"""The drives that `trials.toml` names: a fresh robot of a class, a test scene, a manoeuvre.

Each gets the workshop, the class and the time step (s), and what `with` says in the table; it
returns what the table reads from.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from motion import manoeuvres, terrain, theory, worlds
from motion.results import Band
from motion.stage import Stage
from motion.terrain import FIELD_END, Crossing
from motion.workshop import Workshop
from motion.worlds import FIELD_START
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.testing import Rehearsal

Drive = Callable[..., Any]

SPIN = 3.0
"""rad/s of the wheels where nothing else is said; a robot that cannot go as fast does what it can.
"""
ALOFT = Pose((0.0, 0.0, 5.0))
ASKEW = Pose((1.0, -2.0, 0.2), quaternion_from_rpy(0.0, 0.0, 0.7))
"""A start on level ground from which a robot looks along no axis."""
CUBIC_POSTS = (0.0, 0.05, 0.10)
SEEDS = range(4)
"""Of step fields."""
DRIVES: dict[str, Drive] = {}


def _drive(function: Drive) -> Drive:
    DRIVES[function.__name__] = function
    return function


def _level(pose: Pose | None = None) -> Callable[[Callable[..., Any]], Drive]:
    """Decorator: what a robot does on a stage is a drive on level ground."""

    def enter(act: Callable[..., Any]) -> Drive:
        def drive(shop: Workshop, robot: str, timestep: float, **given: Any) -> Any:
            with shop.stage(worlds.flat(), robot, timestep, pose) as stage:
                return act(stage, **given)

        DRIVES[act.__name__] = drive
        return act

    return enter


# -- level ground ----------------------------------------------------------------------------------


@_level()
def straight(stage: Stage, speed: float = SPIN) -> manoeuvres.Straight:
    """Six seconds straight ahead."""
    return manoeuvres.drive_straight(stage, stage.capped(speed))


@_level(ASKEW)
def five_metres(stage: Stage) -> manoeuvres.Straight:
    """Five metres straight ahead."""
    seconds = 5.0 / (SPIN * stage.robot.report.wheel_radius)
    return manoeuvres.drive_straight(stage, SPIN, seconds)


@_level()
def at_its_limit(stage: Stage) -> manoeuvres.Straight:
    """As fast as it can."""
    start = stage.settle()
    stage.client.send("DRIVE {Left 100} {Right 100} {Normalized True}")
    return manoeuvres.watch_straight(stage, start, stage.robot.drive.max_wheel_speed, 6.0)


@_drive
def turn(shop: Workshop, robot: str, timestep: float, speed: float = SPIN) -> manoeuvres.Turn:
    """On the spot, anticlockwise."""
    return shop.turn(robot, timestep, speed)


@_drive
def turns(
    shop: Workshop,
    robot: str,
    timestep: float,
    speeds: Sequence[float] = (SPIN,),
    frictions: Sequence[float] = (1.0,),
) -> list[manoeuvres.Turn]:
    """On the spot, at several wheel speeds, on several kinds of ground."""
    return [shop.turn(robot, timestep, speed, mu) for speed in speeds for mu in frictions]


for _act, _pose in (
    (manoeuvres.stop, None),
    (manoeuvres.rest, None),
    (manoeuvres.arc, None),
    (manoeuvres.about_axle, None),
    (manoeuvres.circle, None),
    (manoeuvres.hover, ALOFT),
    (manoeuvres.fly, ALOFT),
    (manoeuvres.lean, ALOFT),
    (manoeuvres.dive, ALOFT),
    (terrain.ground_speed, None),
    (terrain.stand_up, None),
):
    _level(_pose)(_act)


@_drive
def literal(shop: Workshop, robot: str, timestep: float) -> float:
    """A car with the original's rule of steering; returns its radius over that with ours."""
    circle = DRIVES["circle"]
    ours: manoeuvres.Circle = circle(shop, robot.removesuffix("_literal"), timestep)
    theirs: manoeuvres.Circle = circle(shop, robot, timestep)
    return theirs.radius / ours.radius


@_drive
def repeated(shop: Workshop, robot: str, timestep: float) -> tuple[int, int]:
    """The same script twice; returns how many lines and states differ, and of how many."""
    first, second = (run_script(shop, timestep, shop.script_seconds) for _ in range(2))
    differing = sum(a != b for a, b in zip(first, second, strict=False))
    return differing + abs(len(first) - len(second)), len(first)


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


# -- slopes, steps, gaps, walls --------------------------------------------------------------------


def _on_slope(
    shop: Workshop, robot: str, timestep: float, degrees: float, friction: float
) -> Stage:
    pose = worlds.on_slope(degrees, shop.describe(robot).rest_height)
    return shop.stage(worlds.slope(degrees, friction), robot, timestep, pose)


@_drive
def climb(shop: Workshop, robot: str, timestep: float, degrees: float, friction: float) -> float:
    """Ahead on a slope for five seconds; returns the way up, m."""
    with _on_slope(shop, robot, timestep, degrees, friction) as stage:
        return terrain.climb(stage, SPIN)


@_drive
def park(shop: Workshop, robot: str, timestep: float, degrees: float) -> float:
    """Told to stand still on a slope; returns the speed, m/s."""
    with _on_slope(shop, robot, timestep, degrees, 1.0) as stage:
        return terrain.creep(stage)


@_drive
def over_step(shop: Workshop, robot: str, timestep: float, height: float) -> Crossing:
    """At a step."""
    with shop.stage(worlds.step(height), robot, timestep) as stage:
        return terrain.cross(stage, SPIN, 10.0, FIELD_START + 1.0)


@_drive
def over_gap(shop: Workshop, robot: str, timestep: float, width: float) -> Crossing:
    """Across a gap; x is counted from its far edge."""
    pose = Pose((0.0, 0.0, worlds.PLATFORM + shop.describe(robot).rest_height))
    with shop.stage(worlds.gap(width), robot, timestep, pose) as stage:
        run = terrain.cross(stage, SPIN, 10.0, FIELD_START + width + 1.0)
    return replace(run, x=run.x - FIELD_START - width)


@_drive
def into_wall(shop: Workshop, robot: str, timestep: float) -> terrain.Push:
    """Into a wall at full speed, and on."""
    with shop.stage(worlds.wall(), robot, timestep) as stage:
        return terrain.push_wall(stage, stage.robot.drive.max_wheel_speed)


@_drive
def push_crate(shop: Workshop, robot: str, timestep: float) -> tuple[float, float, float]:
    """Five metres behind a crate of 2 kg."""
    with shop.stage(worlds.crate(2.0), robot, timestep) as stage:
        return terrain.push_crate(stage, SPIN, 5.0)


@_drive
def slide(shop: Workshop, robot: str, timestep: float, friction: float) -> float:
    """A block that is given 1 m/s; returns its way, m."""
    world = shop.world(worlds.sliding_block(friction))
    return terrain.slide_block(world, timestep, 1.0)


# -- step fields, tracks ---------------------------------------------------------------------------


def _field_scenes(name: str, levels: Sequence[float]) -> list[worlds.Scene]:
    return [
        worlds.step_field(f"{name}{seed}", worlds.symmetric_heights(seed, levels)) for seed in SEEDS
    ]


def _fields(
    shop: Workshop, robot: str, timestep: float, name: str, levels: Sequence[float]
) -> list[Crossing]:
    runs = []
    for scene in _field_scenes(name, levels):
        with shop.stage(scene, robot, timestep) as stage:
            runs.append(terrain.cross(stage, SPIN, 20.0, FIELD_END + terrain.BEYOND))
    return runs


@_drive
def low_fields(shop: Workshop, robot: str, timestep: float) -> list[Crossing]:
    """Across four fields of posts up to 6 cm."""
    return _fields(shop, robot, timestep, "low", terrain.LOW_POSTS)


@_drive
def cubic_fields(shop: Workshop, robot: str, timestep: float) -> list[Crossing]:
    """Across four fields of posts of 0, 5 and 10 cm."""
    return _fields(shop, robot, timestep, "cubic", CUBIC_POSTS)


@_drive
def tracked_fields(shop: Workshop, robot: str, timestep: float) -> list[Crossing]:
    """Across the low fields with raised flippers, kept on course."""
    runs = []
    for scene in _field_scenes("low", terrain.LOW_POSTS):
        with shop.stage(scene, robot, timestep) as stage:
            terrain.posture(stage, terrain.raised(0.4, 0.4))
            spin, goal = terrain.spin(stage), FIELD_END + terrain.BEYOND
            runs.append(terrain.cross(stage, spin, 20.0, goal, terrain.COURSE))
    return runs


@_drive
def climb_stairs(shop: Workshop, robot: str, timestep: float) -> Crossing:
    """Up six steps of 18 x 28 cm with the front flippers, if any, raised by 0.7 rad."""
    with shop.stage(worlds.stairs(), robot, timestep) as stage:
        if any(link.joint == "FRFlipper" for link in stage.robot.links):
            terrain.posture(stage, terrain.raised(0.7))
        goal = terrain.STAIRS_END + 0.5
        return terrain.cross(stage, terrain.spin(stage), 25.0, goal, terrain.COURSE)


@_drive
def belts(shop: Workshop, robot: str, timestep: float) -> manoeuvres.Turn:
    """On the spot, with the belts at 0.3 m/s."""
    with shop.stage(worlds.flat(), robot, timestep) as stage:
        return manoeuvres.turn_in_place(stage, terrain.spin(stage), shop.turn_seconds)


@_drive
def loaded_flipper(shop: Workshop, robot: str, timestep: float) -> float:
    """A flipper with 5 kg on its tip; returns its error, rad."""
    return terrain.flipper_error(shop, shop.describe(robot), "FRFlipper", -0.5, timestep)


@_drive
def tilt_at_wall(shop: Workshop, robot: str, timestep: float) -> float:
    """All tracked classes beside each other, once for all; returns the tilt of one, rad."""
    key = ("wall", timestep)
    return shop.once(key, lambda: terrain.tilts_at_wall(shop, timestep))[robot]


# -- bands that depend on the robot ----------------------------------------------------------------


def turn_theory(shop: Workshop, robot: str) -> tuple[str, Band]:
    """From wheels that touch along the edges of their tread to those that touch at points."""
    layout = theory.wheel_layout(shop.describe(robot))
    points = theory.turn_ratio_points(*layout[:2])
    edges = theory.turn_ratio_edges(*layout)
    return f"{points:.3f}, edges {edges:.3f}", Band(edges - 0.02, points + 0.02)


def steered_side(shop: Workshop, robot: str) -> tuple[str, Band]:
    """To the right in front is to the left behind."""
    right = robot != "BasicAckermanRobot"
    return "yes" if right else "no", Band(float(right), float(right))


BANDS = {"turn_theory": turn_theory, "steered_side": steered_side}
