"""What is done in a process that can be spared (see `isolation.py`): one function per trial.

Each takes the settings of the server and the argument of its name, and returns facts that can be
written as JSON. The three rates share one world: `arena`, with a team that drives about.
"""

from __future__ import annotations

import functools
import importlib
import math
import os
import time
from dataclasses import asdict
from importlib import metadata
from typing import TYPE_CHECKING, Any

from usarsim_server.doctor.findings import problem_and_advice
from usarsim_server.errors import UsarsimError
from usarsim_server.settings import Settings

if TYPE_CHECKING:
    from usarsim_server.doctor.team import Team

__all__ = ["BEAMS", "TEAM", "cameras", "findings", "gl", "package", "physics", "rays", "server"]

WORLD = "arena"
TEAM = 16
SMALL_TEAM = 4
"""Robots: what a robot costs is the difference between both teams."""
BEAMS = 181
MEASURED = 0.8
"""s of wall time that each rate is taken for."""
MOST_CLASSES = 20
"""Robot classes of the user's own that are tried out."""


def package(settings: Settings, module: str) -> dict[str, object]:
    """Import a module; which version of its distribution is installed."""
    loaded = importlib.import_module(module)
    for distribution in metadata.packages_distributions().get(module, ()):
        return {"version": metadata.version(distribution)}
    return {"version": str(getattr(loaded, "__version__", ""))}


def gl(settings: Settings, platform: str) -> dict[str, object]:
    """What an OpenGL context of a platform says about itself."""
    os.environ["MUJOCO_GL"] = "disable"
    os.environ["PYOPENGL_PLATFORM"] = platform
    context: Any = importlib.import_module(f"mujoco.{platform}").GLContext(16, 16)
    context.make_current()
    calls: Any = importlib.import_module("OpenGL.GL")
    asked = {"renderer": calls.GL_RENDERER, "vendor": calls.GL_VENDOR, "version": calls.GL_VERSION}
    return {name: (calls.glGetString(what) or b"").decode() for name, what in asked.items()}


def findings(settings: Settings, key: str) -> dict[str, object]:
    """What a check finds that shall run here."""
    from usarsim_server.doctor.registry import Context, all_checks

    [one] = [one for one in all_checks() if one.key == key]
    found = one.look(Context(settings))
    return {"findings": [asdict(finding) | {"mark": finding.mark.value} for finding in found]}


def server(settings: Settings, _: str) -> dict[str, object]:
    """Put the server together as `serve` would, but open no port and let no time pass.

    Robot classes of the user's own are put into the world, one after another.
    """
    from usarsim_server.app import assemble
    from usarsim_server.robots.roster import load_roster

    started = time.perf_counter()
    assembly = assemble(settings)
    try:
        seconds = time.perf_counter() - started
        folders = [folder.resolve() for folder in settings.robots]
        own = [
            robot
            for robot in load_roster(
                settings.robots, allow_outside=settings.allow_outside
            ).descriptions()
            if robot.source.resolve().parent in folders
        ]
        broken: list[dict[str, str | None]] = []
        for robot in own[:MOST_CLASSES]:
            try:
                vehicle = assembly.fleet.spawn(robot, None, assembly.world.starts[0].pose)
                assembly.fleet.remove(vehicle)
            except (UsarsimError, ValueError) as error:
                problem, advice = problem_and_advice(str(error))
                broken.append({"name": robot.name, "problem": problem, "advice": advice})
        return {
            "world": assembly.world.name,
            "seconds": seconds,
            "tried": len(own[:MOST_CLASSES]),
            "broken": broken,
        }
    finally:
        assembly.stop()


def physics(settings: Settings, _: str) -> dict[str, object]:
    """Steps per s of processor time with a driving team, and what of that each robot costs."""
    team = _team(settings.timestep)
    large, share = team.pace(MEASURED)
    team.shrink(SMALL_TEAM)
    small = team.pace(MEASURED / 2.0)[0]
    team.grow(TEAM)
    per_robot = max(0.0, (large - small) / (TEAM - SMALL_TEAM))
    return {
        "robots": TEAM,
        "timestep_s": settings.timestep,
        "steps_per_second": 1.0 / (large * settings.timestep),
        "real_time_factor": 1.0 / large,
        "base_cost": max(0.0, large - TEAM * per_robot),
        "cost_per_robot": per_robot,
        "core_left": share,
    }


def rays(settings: Settings, _: str) -> dict[str, object]:
    """Rays per second in fans of `BEAMS`, as a laser scanner on each robot casts them."""
    team = _team(settings.timestep)
    return {
        "beams": BEAMS,
        "robots": TEAM,
        "rays_per_robot_second": team.rays_wanted(),
        **team.ray_rates(BEAMS, MEASURED),
    }


def cameras(settings: Settings, _: str) -> dict[str, object]:
    """Camera pictures per second, drawn by what the server would draw with."""
    return _team(settings.timestep).picture_rate(settings, MEASURED)


@functools.cache
def _team(timestep: float) -> Team:
    from usarsim_server.doctor.team import Team

    plain = Settings(world=WORLD, speed=math.inf, timestep=timestep, max_robots=TEAM)
    return Team(plain, TEAM)
