"""The server: whether it starts with these settings, how fast it is, what that is enough for.

Another process puts it together without opening a port, and measures physics, rays and pictures.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usarsim_doctor.checks.machine import cores
from usarsim_doctor.isolation import Outcome, attempt
from usarsim_doctor.registry import Context, Finding, Mark, check
from usarsim_server.options import OPTIONS

SERVER_TIMEOUT = 90.0
TIMEOUT = 60.0
GROWING = 1.6
"""Processor time by which a server grows, over that by which its physics and rays grow."""
STANDING = 1.6
"""Processor time that it takes anyway, over that of physics and rays of `REFERENCE` robots.

Both from one machine (2 cores, AMD EPYC), where physics and rays of 16 and 48 P3AT account for 0.16
and 0.44 cores, and a server with all their sensors took 0.52 and 0.95 (`make bench ARGS=team`). The
rest is noise models, text and sockets.
"""
REFERENCE = 16
SPARE = 0.8
"""Part of one core that is counted on. Most of the rest is Python, so that further cores take some
load off it but do not multiply it."""
DISTURBED = 0.8
"""Part of a core below which the estimate says that it is one for a free machine."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Processor s per simulated s: of the world, and of each robot in physics and in rays."""

    base: float
    physics: float
    rays: float


@check("server", "Server", order=60)
def look_at_server(context: Context) -> Iterator[Finding]:
    """Let another process put it together."""
    settings = context.settings
    if Path(settings.world).expanduser().is_file():
        text = f"{settings.world} is a map, which the server imports when it starts"
        cure = f"usarsim import {settings.world}"
        yield Finding("world", Mark.NOTE, f"{text}; this shows how that goes", cure)
        return
    yield from judge_server(attempt(["server"], settings, SERVER_TIMEOUT)["server"])


def judge_server(outcome: Outcome) -> Iterator[Finding]:
    """What to say after the trial."""
    if outcome.failure is not None:
        text = outcome.failure if outcome.told else f"a defect, {outcome.failure}"
        yield Finding("start", Mark.PROBLEM, f"would not start: {text}", advice=outcome.advice)
        return
    values = outcome.values
    seconds = float(values["seconds"])
    text = f"would start, in {seconds:.1f} s, with the world {values['world']}"
    yield Finding("start", Mark.OK, text, values={"world": values["world"], "start_s": seconds})
    broken = values["broken"]
    if values["tried"] > len(broken):
        text = f"{values['tried'] - len(broken)} of your own can be put into the world"
        yield Finding("robots", Mark.OK, text)
    for robot in broken:
        text = f"cannot be put into the world: {robot['problem']}"
        yield Finding(robot["name"], Mark.WARNING, text, advice=robot["advice"])


@check("rates", "Measured rates", order=70, measures=True)
def look_at_rates(context: Context) -> Iterator[Finding]:
    """Let another process measure, one rate after another."""
    settings = context.settings
    outcomes = attempt(("physics", "rays", "cameras"), settings, TIMEOUT)
    physics, rays = outcomes["physics"], outcomes["rays"]
    yield judge_physics(physics, context)
    if physics.failure is None:
        yield judge_steps(physics)
    yield judge_rays(rays)
    yield judge_cameras(outcomes["cameras"], context)
    if physics.failure is None and rays.failure is None:
        cost = cost_of(physics.values, rays.values)
        yield judge_team(cost, context, cores(), float(physics.values["core_left"]))


def judge_physics(outcome: Outcome, context: Context) -> Finding:
    """What to say of the step rate."""
    if outcome.failure is not None:
        return _failed("physics", Mark.PROBLEM, outcome)
    facts = outcome.values
    factor = float(facts["real_time_factor"])
    text = (
        f"{_rounded(facts['steps_per_second'])} steps of {1e3 * facts['timestep_s']:g} ms per "
        f"second with {facts['robots']} P3AT driving in arena: {factor:.1f} times real time"
    )
    if factor >= 1.0:
        return Finding("physics", Mark.OK, text, values=facts)
    text += ", simulated time will go slower than the clock"
    return Finding(
        "physics", Mark.WARNING, text, context.serve({"--timestep": 0.008}), values=facts
    )


def judge_steps(outcome: Outcome) -> Finding:
    """Whether servos, contact compensation and rays are compiled."""
    reason = str(outcome.values["not_compiled"])
    if not reason and outcome.values["rays_compiled"]:
        return Finding("steps", Mark.OK, "servos, contact compensation and rays are compiled")
    reason = reason or "Embree's library cannot be called for rays"
    return Finding("steps", Mark.NOTE, f"not compiled, so somewhat slower: {reason}")


def judge_rays(outcome: Outcome) -> Finding:
    """What to say of the ray rate."""
    if outcome.failure is not None:
        return _failed("rays", Mark.PROBLEM, outcome)
    facts = outcome.values
    rate = float(facts["rays_per_second"])
    text = (
        f"{_rounded(rate)} rays per second in arena: {_rounded(rate / facts['beams'])} scans of "
        f"{facts['beams']} beams; {_rounded(facts['rays_per_second_together'])} when "
        f"{facts['robots']} robots scan at the same instant"
    )
    return Finding("rays", Mark.OK, text, values=facts)


def judge_cameras(outcome: Outcome, context: Context) -> Finding:
    """What to say of the pictures."""
    if outcome.failure is not None:
        return _failed("cameras", Mark.WARNING, outcome)
    facts = outcome.values
    rate = float(facts["pictures_per_second"])
    wanted = context.settings.camera_rate * _speed(context)
    enough = math.floor(rate / wanted)
    text = f"{_rounded(rate)} pictures of 320x240 per second by {facts['renderer']}: "
    if enough >= 1:
        text += f"{enough} watched camera{'s' * (enough != 1)} at {wanted:g} per second"
        text += " if the thread that draws has a core of its own"
        return Finding("cameras", Mark.OK, text, values=facts)
    slower = max(0.1, math.floor(rate / 2.0))
    text += f"not one camera at {wanted:g} per second"
    cure = context.serve({"--camera-rate": f"{slower:g}"})
    return Finding("cameras", Mark.WARNING, text, cure, values=facts)


def judge_team(cost: Cost, context: Context, cores: float, left: float = 1.0) -> Finding:
    """What both rates are enough for.

    Args:
        cost: that follows from them.
        context: with the speed and the number of robots that are wanted.
        cores: of this machine.
        left: part of one core that other programs left the measurement.
    """
    speed, most = _speed(context), context.settings.max_robots
    robots = team_size(cost, speed, cores)
    pace = "in real time" if speed == 1.0 else f"at {speed:g} times real time"
    least = "at least " if robots == most_robots() else "about "
    text = (
        f"{least}{robots} robot{'s' * (robots != 1)} like P3AT with all their sensors {pace} (an "
        "estimate from the rates of physics and rays, without cameras)"
    )
    values = {"robots": robots, "speed": speed, "estimate": True, "core_left": left}
    if left < DISTURBED:
        text += f"; at this moment other programs leave it {left:.0%} of a core, so fewer"
    if robots >= most:
        return Finding("enough for", Mark.OK, text, values=values)
    if not robots:
        text += ": simulated time will go slower than the clock"
        cure = context.serve({"--speed": f"{max(0.01, 0.5 * speed):g}"})
        return Finding("enough for", Mark.WARNING, text, cure, values=values)
    text += f", but {most} may come: simulated time will go slower than the clock"
    cure = context.serve({"--max-robots": robots})
    return Finding("enough for", Mark.WARNING, text, cure, values=values)


def cost_of(physics: Mapping[str, Any], rays: Mapping[str, Any]) -> Cost:
    """The cost that two measurements amount to."""
    return Cost(
        float(physics["base_cost"]),
        float(physics["cost_per_robot"]),
        float(rays["rays_per_robot_second"]) / float(rays["rays_per_second_of_sensors"]),
    )


def team_size(cost: Cost, speed: float, cores: float) -> int:
    """Robots that can be simulated at a speed: an estimate, from 0 to `most_robots`.

    Of physics and rays n robots take x(n) = base + n (physics + rays). All in all that is taken as
    speed (`GROWING` x(n) + `STANDING` x(`REFERENCE`)), and may be `SPARE` of one core, or of what
    part of a core there is.
    """
    each = cost.physics + cost.rays
    standing = STANDING * (cost.base + REFERENCE * each)
    budget = (SPARE * min(1.0, cores) / speed - standing) / GROWING - cost.base
    if budget <= 0.0:
        return 0
    most = most_robots()
    return most if each * most <= budget else math.floor(budget / each)


@functools.cache
def most_robots() -> int:
    """The most robots that a server can be told to take."""
    [option] = [option for option in OPTIONS if option.key == "max_robots"]
    return int(option.declared.limits.high)


def _speed(context: Context) -> float:
    """Simulated over wall time that is wanted; in lockstep there is no such wish."""
    speed = context.settings.speed
    return 1.0 if math.isinf(speed) else speed


def _failed(subject: str, mark: Mark, outcome: Outcome) -> Finding:
    return Finding(subject, mark, f"could not be measured: {outcome.failure}")


def _rounded(value: float) -> str:
    """Two significant digits at least, with separators: no more are repeatable."""
    if value < 100.0:
        return f"{value:.0f}"
    digits = 2 - math.floor(math.log10(value))
    return f"{round(value, digits):,.0f}"
