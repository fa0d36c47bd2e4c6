"""Rates: measured for real once, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pytest

from usarsim_doctor import team as trials
from usarsim_doctor.checks.server import (
    Cost,
    cost_of,
    judge_cameras,
    judge_physics,
    judge_rays,
    judge_steps,
    judge_team,
    most_robots,
    team_size,
)
from usarsim_doctor.isolation import Outcome
from usarsim_doctor.registry import Context, Mark
from usarsim_server.errors import SettingsError
from usarsim_server.options import load_settings
from usarsim_server.settings import Settings
from usarsim_server.simulation import native

HERE = Context(Settings())
COST = Cost(base=0.021, physics=0.005, rays=0.005)
PHYSICS: Mapping[str, Any] = {
    "robots": 16,
    "timestep_s": 0.004,
    "steps_per_second": 2500.0,
    "real_time_factor": 10.0,
    "base_cost": 0.02,
    "cost_per_robot": 0.005,
    "core_left": 0.9,
    "not_compiled": "no C compiler (cc)",
    "rays_compiled": False,
}
RAYS: Mapping[str, Any] = {
    "beams": 181,
    "robots": 16,
    "rays_per_second": 300_000.0,
    "rays_per_second_together": 900_000.0,
    "rays_per_second_of_sensors": 450_000.0,
    "rays_per_robot_second": 2250.0,
}


@pytest.fixture(scope="module")
def measured() -> dict[str, Mapping[str, Any]]:
    """The three rates of this machine, each taken for a moment."""
    patch = pytest.MonkeyPatch()
    patch.setattr(trials, "MEASURED", 0.05)
    settings = Settings(renderer="rays")
    try:
        return {
            "physics": trials.physics(settings, ""),
            "rays": trials.rays(settings, ""),
            "cameras": trials.cameras(settings, ""),
        }
    finally:
        patch.undo()
        trials._team.cache_clear()


def test_rates_are_measured_and_hang_together(measured: dict[str, Mapping[str, Any]]) -> None:
    """Steps per second times the step are the real-time factor; what robots cost adds up to it."""
    physics = measured["physics"]
    assert physics["robots"] == 16
    assert 0.0 < physics["core_left"] <= 1.0
    assert physics["real_time_factor"] > 0.0
    assert physics["steps_per_second"] * physics["timestep_s"] == pytest.approx(
        physics["real_time_factor"]
    )
    total = physics["base_cost"] + 16 * physics["cost_per_robot"]
    assert total >= 1.0 / physics["real_time_factor"] - 1e-9
    assert measured["cameras"]["renderer"] == "rays"
    assert measured["cameras"]["pictures_per_second"] > 0.0


def test_rays_of_a_robot_are_those_of_its_sensors(measured: dict[str, Mapping[str, Any]]) -> None:
    """P3AT: a SICK of 181 beams at 5 Hz."""
    rays = measured["rays"]
    assert min(rate for key, rate in rays.items() if key.startswith("rays_per_second")) > 0.0
    assert rays["rays_per_robot_second"] == pytest.approx(181 * 5)


def test_what_is_measured_is_said(measured: dict[str, Mapping[str, Any]]) -> None:
    """Every measurement makes a finding, with the figures for machines beside it."""
    physics = judge_physics(Outcome(measured["physics"]), HERE)
    rays = judge_rays(Outcome(measured["rays"]))
    cameras = judge_cameras(Outcome(measured["cameras"]), HERE)
    assert "steps of 4 ms per second with 16 P3AT driving in arena" in physics.text
    assert "rays per second in arena" in rays.text
    assert "pictures of 320x240 per second by rays" in cameras.text
    for finding, key in ((physics, "physics"), (rays, "rays"), (cameras, "cameras")):
        assert finding.values == measured[key]


def test_the_cost_follows_from_both_rates() -> None:
    """Rays wanted per simulated second over rays per second are a robot's share."""
    assert cost_of(PHYSICS, RAYS) == Cost(0.02, 0.005, 0.005)


def test_the_team_fits_into_the_budget_and_one_more_does_not() -> None:
    """Growing and standing cost together keep within the 0.8 cores that are counted on."""
    size = team_size(COST, 1.0, 2.0)

    def rates(robots: int) -> float:
        return COST.base + robots * (COST.physics + COST.rays)

    assert 1.6 * rates(size) + 1.6 * rates(16) <= 0.8
    assert 1.6 * rates(size + 1) + 1.6 * rates(16) > 0.8
    assert size == 29


def test_the_estimate_is_near_what_was_seen() -> None:
    """On the machine of the constants: 0.52 cores with 16 robots, 0.95 with 48."""
    seen = Cost(base=0.025, physics=0.0044, rays=0.0042)
    for robots, cores in ((16, 0.52), (48, 0.95)):
        growing = seen.base + robots * (seen.physics + seen.rays)
        standing = seen.base + 16 * (seen.physics + seen.rays)
        assert 1.6 * growing + 1.6 * standing == pytest.approx(cores, rel=0.03)
    assert 30 <= team_size(seen, 1.0, 2.0) < 48


def test_the_team_shrinks_with_speed_and_with_the_processor() -> None:
    """Twice as fast or half a core: fewer; nothing left: none; never more than can be asked for."""
    assert team_size(COST, 2.0, 2.0) == team_size(COST, 1.0, 0.5) < team_size(COST, 1.0, 1.0)
    assert team_size(COST, 1.0, 1.0) == team_size(COST, 1.0, 64.0)
    assert team_size(COST, 100.0, 2.0) == 0
    assert team_size(Cost(0.0, 1e-5, 0.0), 1.0, 2.0) == most_robots()
    assert team_size(Cost(0.0, 0.0, 0.0), 1.0, 2.0) == most_robots()
    assert load_settings({"max_robots": str(most_robots())}).max_robots == most_robots()
    with pytest.raises(SettingsError):
        load_settings({"max_robots": str(most_robots() + 1)})


def test_the_estimate_says_that_it_is_one() -> None:
    """Enough for the robots that may come is ok; else a limit is advised that fits."""
    fine = judge_team(COST, HERE, 2.0)
    assert fine.mark is Mark.OK
    assert fine.text.startswith("about 29 robots")
    assert "estimate" in fine.text
    many = judge_team(COST, Context(Settings(max_robots=64)), 2.0)
    assert (many.mark, many.cure) == (Mark.WARNING, "usarsim serve --max-robots 29")
    fast = judge_team(COST, Context(Settings(speed=50.0)), 2.0)
    assert (fast.mark, fast.cure) == (Mark.WARNING, "usarsim serve --speed 25")
    disturbed = judge_team(COST, HERE, 2.0, left=0.45)
    assert disturbed.mark is Mark.OK
    assert "about 29 robots" in disturbed.text
    assert "leave it 45% of a core" in disturbed.text
    assert "of a core" not in fine.text
    lockstep = judge_team(COST, Context(Settings(speed=math.inf)), 2.0)
    assert lockstep.values["robots"] == 29


def test_slow_machines_are_warned() -> None:
    """Physics below real time, and a renderer too slow for one camera, each with an option."""
    slow = judge_physics(Outcome({**PHYSICS, "real_time_factor": 0.6}), HERE)
    assert (slow.mark, slow.cure) == (Mark.WARNING, "usarsim serve --timestep 0.008")
    pictures = {"renderer": "rays", "pictures_per_second": 9.0}
    blurred = judge_cameras(Outcome(pictures), HERE)
    assert (blurred.mark, blurred.cure) == (Mark.WARNING, "usarsim serve --camera-rate 4")
    fine = judge_cameras(Outcome({**pictures, "pictures_per_second": 100.0}), HERE)
    assert "6 watched cameras at 15 per second" in fine.text


def test_whether_steps_are_compiled_is_said(measured: dict[str, Mapping[str, Any]]) -> None:
    """One line, with the reason if they are not; as it is here, and as it would be without."""
    here = judge_steps(Outcome(measured["physics"]))
    assert (here.mark is Mark.OK) == (native.library()[0] is not None)
    without = judge_steps(Outcome(PHYSICS))
    assert without.mark is Mark.NOTE
    assert without.text.endswith("no C compiler (cc)")
    steps_alone = judge_steps(Outcome({**PHYSICS, "not_compiled": ""}))
    assert (steps_alone.mark, "Embree" in steps_alone.text) == (Mark.NOTE, True)


def test_what_cannot_be_measured_is_one_line() -> None:
    """Physics and rays are needed, pictures are not."""
    dead = Outcome(failure="the process was ended by SIGILL")
    for finding, mark in (
        (judge_physics(dead, HERE), Mark.PROBLEM),
        (judge_rays(dead), Mark.PROBLEM),
        (judge_cameras(dead, HERE), Mark.WARNING),
    ):
        assert finding.mark is mark
        assert finding.text == "could not be measured: the process was ended by SIGILL"
