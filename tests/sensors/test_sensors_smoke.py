"""Laser scanners in smoke: blocked, blinded, scattered back; sonar does not mind (robots 2.3)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from sensor_fakes import (
    UDK,
    UT2004,
    FakeRobot,
    Scene,
    describe_item,
    describe_robot,
    describe_world,
    numbers,
    read,
    values,
    wall_ahead,
)

from usarsim_server.base.errors import RobotDescriptionError
from usarsim_server.sensors.base import SensorContext, create_sensor
from usarsim_server.simulation.frames import Pose
from usarsim_server.worlds.description import Smoke, SmokePuff, SmokeVolume
from usarsim_server.worlds.smoke import smoke_field

WALL = Scene(wall_ahead(3.0))


def cloud(density: float, near: float = 1.0, far: float = 2.0) -> Smoke:
    """Smoke across the way between two distances ahead."""
    size = (far - near, 200.0, 200.0)
    return Smoke((SmokeVolume("cloud", "box", Pose(((near + far) / 2, 0.0, 0.0)), size, density),))


def speck(distance: float, radius: float = 0.1, **changes: Any) -> Smoke:
    """One opaque particle straight ahead."""
    tiny = (1e-9, 1e-9, 1e-9)
    return Smoke(puffs=(SmokePuff("speck", (distance, 0.0, 0.0), tiny, 1, radius, 1, **changes),))


def make(kind: str, smoke: Smoke, /, *, seed: int = 1, **parameters: Any) -> Any:
    """A sensor in smoke."""
    rng = np.random.default_rng(seed)
    context = SensorContext(describe_robot(), describe_world(), rng, smoke=smoke_field(smoke))
    return create_sensor(describe_item(kind, **parameters), context)


def ahead(sensor: Any, scene: Scene = WALL, robot: FakeRobot | None = None) -> float:
    """The beam straight ahead as it is printed, m."""
    assert read(sensor, robot, scene)
    scan = numbers(values(sensor)["Range"])
    return scan[len(scan) // 2]


def beams(sensor: Any, scene: Scene = WALL) -> Any:
    """The whole scan as it is printed, m."""
    assert read(sensor, None, scene)
    return np.array(numbers(values(sensor)["Range"]))


# -- the original's scanners -----------------------------------------------------------------


@pytest.mark.parametrize(("density", "reading"), [(0.0057, "3.00"), (0.0058, "0.00")])
def test_hokuyo_is_blind_beyond_its_budget(density: float, reading: str) -> None:
    """Robots 76: over 1 m of smoke 0.0057 is within the budget of 0.00575, 0.0058 is not."""
    scanner = make("Hokuyo", cloud(density), fov=0.1, resolution=0.05)
    assert read(scanner, None, WALL)
    middle = values(scanner)["Range"].split(",")[1]
    assert middle == reading


def test_sick_ignores_regional_smoke() -> None:
    """Robots 76: however dense, the SICK and the plain scanner see the wall behind it."""
    thick = Smoke(cloud(50.0).volumes, haze=10.0)
    for kind in ("SICK", "RangeScanner"):
        assert beams(make(kind, thick)).tolist() == beams(make(kind, Smoke())).tolist()


def test_only_the_way_to_the_wall_counts() -> None:
    """Smoke behind the wall is nothing to a Hokuyo; each beam has its own way through it."""
    assert ahead(make("Hokuyo", cloud(50.0, near=3.2, far=3.9))) == 3.0
    # 0.005 per metre: within the budget straight ahead, beyond it where the way is 1.15 m.
    scan = beams(make("Hokuyo", cloud(0.005)))
    angles = 4.189 / 2 - 0.0184086914 * np.arange(len(scan))
    way = 1.0 / np.cos(angles)
    through = (np.abs(angles) < 1.0) & (2.0 * way < 3.95)
    assert (scan[through & (way > 1.16)] == 0.0).any()
    assert (scan[through & (way > 1.16)] == 0.0).all()
    assert (scan[through & (way < 1.14)] > 2.9).all()


def test_a_miss_can_be_blind_too() -> None:
    """The way to the end of the range counts where nothing is hit."""
    assert ahead(make("Hokuyo", cloud(0.1)), Scene()) == 0.0
    assert ahead(make("Hokuyo", cloud(0.1, near=4.1, far=9.0)), Scene()) == 4.0


def test_global_smoke_wears_the_budget() -> None:
    """3 m to the wall through haze of 0.0015 are 0.0045, of 0.0025 are 0.0075."""
    assert ahead(make("Hokuyo", Smoke(haze=0.0015))) == 3.0
    assert ahead(make("Hokuyo", Smoke(haze=0.0025))) == 0.0


@pytest.mark.parametrize("kind", ["SICK", "Hokuyo", "RangeScanner", "IRScanner"])
def test_particles_block_every_scanner(kind: str) -> None:
    """A particle of 0.1 m at 1.5 m reads 1.4 m, and the beams beside it go on to the wall."""
    scan = beams(make(kind, speck(1.55, radius=0.15), fov=1.0, resolution=0.1))
    assert scan[len(scan) // 2] == pytest.approx(1.4, abs=0.011)
    assert scan[0] > 3.0


def test_smoke_before_a_particle_counts() -> None:
    """A Hokuyo blinded on the way to a particle does not read the particle."""
    both = Smoke(cloud(0.1).volumes, speck(2.5).puffs)
    assert ahead(make("Hokuyo", both)) == 0.0
    behind = Smoke(cloud(0.1, near=2.6, far=2.9).volumes, speck(2.5).puffs)
    assert ahead(make("Hokuyo", behind)) == pytest.approx(2.4, abs=0.011)


def test_a_plume_flickers() -> None:
    """Rising particles: what is seen changes with simulated time and repeats with it."""
    plume = Smoke(
        puffs=(SmokePuff("plume", (1.5, 0.0, 0.0), (0.6, 0.6, 2.0), 60, 0.05, 2, lifetime=5.0),)
    )
    scans = []
    for time in (0.0, 0.7, 1.4, 0.0):
        scanner = make("SICK", plume)
        read(scanner, FakeRobot(time=time), WALL)
        scans.append(values(scanner)["Range"])
    assert len(set(scans)) == 3
    assert scans[0] == scans[3]


# -- sensors that do not mind ----------------------------------------------------------------


@pytest.mark.parametrize("smoke", [cloud(50.0), Smoke(haze=5.0), speck(1.5, radius=0.5)])
def test_sonar_hears_through_all_smoke(smoke: Smoke) -> None:
    """Sound passes regional, global and local smoke."""
    sonar = make("Sonar", smoke)
    read(sonar, None, WALL)
    assert values(sonar)["Range"] == "3.0000"


@pytest.mark.parametrize("kind", ["SICK", "Hokuyo", "RangeSensor", "IR"])
@pytest.mark.parametrize("dialect", [UDK, UT2004])
def test_conf_says_nothing_about_smoke(kind: str, dialect: Any) -> None:
    """CONF is the same in smoke and in clear air, whatever the model."""
    clear = make(kind, Smoke()).configuration(dialect)
    assert make(kind, cloud(1.0), smoke="scatter").configuration(dialect) == clear


def test_clear_air_draws_no_random_numbers() -> None:
    """In a world without smoke `scatter` leaves readings and noise as they are."""
    plain = make("SICK", Smoke(), noise=0.05)
    ready = make("SICK", Smoke(), noise=0.05, smoke="scatter")
    for _ in range(3):
        assert beams(plain).tolist() == beams(ready).tolist()


# -- scattered light -------------------------------------------------------------------------


def many(smoke: Smoke, scene: Scene, seed: int = 1) -> Any:
    """Ranges of 4000 parallel beams (one sensor, many readings), unrounded."""
    scanner = make("RangeScanner", smoke, seed=seed, smoke="scatter", fov=1e-3, resolution=1e-4)
    ranges = []
    for _ in range(4000 // scanner.beams + 1):
        read(scanner, None, scene)
        ranges.append(scanner._ranges)
    return np.concatenate(ranges)[:4000]


@pytest.mark.parametrize("density", [0.2, 1.0, 3.0])
def test_light_gets_through_by_beer_and_lambert(density: float) -> None:
    """Through 1 m of smoke the part exp(-density) sees the wall, within three deviations."""
    ranges = many(cloud(density), WALL)
    part = (ranges > 2.99).mean()
    expected = math.exp(-density)
    assert part == pytest.approx(expected, abs=3 * math.sqrt(expected * (1 - expected) / 4000))


def test_early_returns_are_spread_exponentially() -> None:
    """In wide smoke of 2 per metre the returns follow 1 - exp(-2 s), by Kolmogorov's test (1 %)."""
    ranges = np.sort(many(cloud(2.0, near=0.5, far=2.9), WALL))
    early = ranges[ranges < 2.9]
    assert early[0] >= 0.5
    whole = 1.0 - math.exp(-2.0 * 2.4)
    expected = (1.0 - np.exp(-2.0 * (early - 0.5))) / whole
    found = (np.arange(len(early)) + 0.5) / len(early)
    assert np.abs(found - expected).max() < 1.63 / math.sqrt(len(early))


def test_nothing_comes_back_from_behind_the_wall_or_a_particle() -> None:
    """Smoke behind what stops the beam is not seen."""
    assert (many(cloud(5.0, near=3.1, far=3.9), WALL) > 2.99).all()
    both = Smoke(cloud(50.0, near=2.5, far=2.9).volumes, speck(1.0, radius=0.2).puffs)
    assert many(both, WALL) == pytest.approx(np.full(4000, 0.8), abs=1e-4)


def test_scatter_draws_from_the_sensors_own_stream() -> None:
    """Equal seeds give equal scans, other seeds other ones."""
    smoke = cloud(1.0)
    one, same, other = (many(smoke, WALL, seed) for seed in (5, 5, 6))
    assert (one == same).all()
    assert (one != other).any()


# -- parameters and edges --------------------------------------------------------------------


def test_any_scanner_can_have_any_model() -> None:
    """A SICK with a budget of 1.0, a Hokuyo that ignores smoke."""
    assert ahead(make("SICK", cloud(0.9), smoke="budget", smoke_budget=1.0)) == 3.0
    assert ahead(make("SICK", cloud(1.1), smoke="budget", smoke_budget=1.0)) == 0.0
    assert ahead(make("Hokuyo", cloud(50.0), smoke="ignore")) == 3.0


def test_noise_does_not_bring_light_back() -> None:
    """A blind beam reads exactly 0.00, with noise and with a strict minimum range as well."""
    scanner = make("Hokuyo", cloud(1.0), noise=0.1, strict_min_range=True)
    assert [ahead(scanner) for _ in range(5)] == [0.0] * 5


@pytest.mark.parametrize("kind", ["RangeSensor", "IR"])
def test_single_beams_fare_as_scanners_do(kind: str) -> None:
    """Blocked by particles, not by regional smoke unless told so; IR keeps its minimum."""
    blocked = make(kind, speck(0.8), max_range=5.0)
    passing = make(kind, cloud(50.0), max_range=5.0)
    blinded = make(kind, cloud(50.0), max_range=5.0, smoke="budget")
    for sensor in (blocked, passing, blinded):
        read(sensor, None, WALL)
    assert values(blocked)["Range"] == "0.7000"
    assert values(passing)["Range"] == "3.0000"
    assert values(blinded)["Range"] == ("0.2000" if kind == "IR" else "0.0000")


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"smoke": "fog"}, "smoke: 'fog' is not known .write one of ignore, budget, scatter"),
        ({"smoke_budget": 0.0}, "smoke_budget: 0.0 is out of range"),
        ({"smoke": 1}, "smoke: 1 is not text"),
    ],
)
def test_a_wrong_parameter_is_refused(parameters: dict[str, Any], said: str) -> None:
    """The message names the key and what may stand there."""
    with pytest.raises(RobotDescriptionError, match=said):
        make("SICK", Smoke(), **parameters)
