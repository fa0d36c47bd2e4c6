"""A team of robots driving about, on which rates are measured in the calling thread.

Physics and rays are taken by processor time, so that other programs disturb them little; pictures
by the wall clock, because a graphics card takes none, and by the quickest of them. The three trials
`physics`, `rays` and `cameras` (see `isolation.py`) share one world: `arena`, with a team in it.
"""

from __future__ import annotations

import functools
import math
import time
from statistics import median

import numpy as np

from usarsim_server.app import Assembly, assemble
from usarsim_server.cameras.backend import Quality
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.settings import Settings
from usarsim_server.simulation import native
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.compiled import ray_code
from usarsim_server.simulation.rays.query import PendingReport, RayFan
from usarsim_server.simulation.snapshot import Snapshot

WORLD = "arena"
TEAM = 16
SMALL_TEAM = 4
"""Robots: what a robot costs is the difference between both teams."""
BEAMS = 181
MEASURED = 0.8
"""s of wall time that each rate is taken for."""
CLASS = "P3AT"
CHUNK = 0.1
"""Simulated s between two looks at the clock and between two commands."""
SETTLE = 0.5
"""Simulated s to drive before anything is measured."""
SCANNER = Pose((0.2, 0.0, 0.3))
"""Of the laser scanner on a robot."""
REACH = 20.0
"""m that its beams reach."""
SIZE = (320, 240)
QUICKEST = 20.0
"""Per cent of the pictures that are taken to be undisturbed by other programs."""


class Team:
    """A world without sockets and clock, and robots in it that drive in changing circles."""

    def __init__(self, settings: Settings, robots: int) -> None:
        """Put it together.

        Raises:
            UsarsimError: if the world or the robots cannot be used.
        """
        self._assembly: Assembly = assemble(settings)
        self._dice = np.random.default_rng(settings.seed)
        self._vehicles: list[Vehicle] = []
        self.grow(robots)

    def grow(self, robots: int) -> None:
        """Add robots until there are so many, and let all drive a moment."""
        all_robots, starts = self._assembly.robots, self._assembly.world.starts
        description = all_robots.describe(CLASS)
        assert description is not None  # shipped
        while len(self._vehicles) < robots:
            start = starts[len(self._vehicles) % len(starts)]
            self._vehicles.append(all_robots.spawn(description, None, start.pose))
        self._drive_on(SETTLE)

    def shrink(self, robots: int) -> None:
        """Take robots away until there are so many, and let all drive a moment."""
        while len(self._vehicles) > robots:
            self._assembly.robots.remove(self._vehicles.pop())
        self._drive_on(SETTLE)

    def pace(self, seconds: float) -> tuple[float, float]:
        """Drive on for so many s of wall time.

        Returns:
            Processor s that the physics needs per simulated s, median; and the part of one core
            that other programs left it meanwhile.
        """
        spent: list[float] = []
        begun, begun_working = time.perf_counter(), time.thread_time()
        while not spent or time.perf_counter() < begun + seconds:
            self._command()
            started = time.thread_time()
            self._advance(CHUNK)
            spent.append((time.thread_time() - started) / CHUNK)
        passed = time.perf_counter() - begun
        return median(spent), min(1.0, (time.thread_time() - begun_working) / passed)

    def ray_rates(self, beams: int, seconds: float) -> dict[str, object]:
        """Rays per processor s into a world that moves on, measured for so many s.

        Returns:
            The rates when each robot casts a half circle, one after another and all as one batch,
            and when one after another casts the rays of all its sensors.
        """
        simulation = self._assembly.simulation
        spent: list[tuple[float, float, float]] = []
        end = time.perf_counter() + seconds
        asked = 0
        while not spent or time.perf_counter() < end:
            self._advance(simulation.timestep)
            snapshot = simulation.look()
            fans = [(one.robot, _half_circle(one, snapshot, beams)) for one in self._vehicles]
            surveys = [(one.robot, _survey(one, snapshot)) for one in self._vehicles]
            asked = sum(len(fan.directions) for _, survey in surveys for fan in survey)
            clock = [time.thread_time()]
            for robot, fan in fans:
                simulation.cast([fan], snapshot, robot)
            clock.append(time.thread_time())
            simulation.cast_all([PendingReport(snapshot, robot, [fan]) for robot, fan in fans])
            clock.append(time.thread_time())
            for robot, survey in surveys:
                simulation.cast(survey, snapshot, robot)
            clock.append(time.thread_time())
            spent.append((clock[1] - clock[0], clock[2] - clock[1], clock[3] - clock[2]))
        alone, together, sensors = (median(times) for times in zip(*spent, strict=True))
        cast = beams * len(self._vehicles)
        return {
            "rays_per_second": cast / alone,
            "rays_per_second_together": cast / together,
            "rays_per_second_of_sensors": asked / sensors,
        }

    def rays_wanted(self) -> float:
        """Rays per simulated s that the sensors of one robot ask for."""
        vehicle = self._vehicles[0]
        state = vehicle.body.state(self._assembly.simulation.look())
        assert state is not None
        dialect = vehicle.description.dialect
        wanted = 0.0
        for sensor in vehicle.sensors:
            interval = sensor.interval(dialect)
            if interval > 0.0 and math.isfinite(interval):
                wanted += sum(len(fan.directions) for fan in sensor.rays(state)) / interval
        return wanted

    def picture_rate(self, settings: Settings, seconds: float) -> dict[str, object]:
        """Pictures per wall s of the robots' cameras in turn, with the quality of the settings."""
        simulation, views = self._assembly.simulation, self._assembly.board.views
        painter = Painter(
            simulation.compiled,
            PainterOptions(
                settings.renderer,
                Quality(settings.shadows, settings.multisample),
                self._assembly.world.smoke,
            ),
        )
        spent: list[float] = []
        warm = False
        end = math.inf
        while time.perf_counter() < end or not spent:
            self._advance(simulation.timestep)
            snapshot = simulation.look()
            started = time.perf_counter()
            eye = painter.place(views[len(spent) % len(views)], snapshot, *SIZE)
            assert eye is not None
            painter.tile(eye, snapshot)
            if warm:
                spent.append(time.perf_counter() - started)
            else:  # the first picture loads the model
                warm, end = True, time.perf_counter() + seconds
        painter.close()
        quick = float(np.percentile(spent, QUICKEST))
        return {"renderer": painter.renderer, "pictures_per_second": 1.0 / quick}

    def _drive_on(self, seconds: float) -> None:
        for vehicle in self._vehicles:
            self._steer(vehicle)
        self._advance(seconds)

    def _advance(self, seconds: float) -> None:
        simulation = self._assembly.simulation
        simulation.run_until(simulation.look().time + seconds)

    def _command(self) -> None:
        """Two new commands a second for each robot, as the benchmark of steps gives them."""
        for vehicle in self._vehicles:
            if self._dice.random() < 2.0 * CHUNK:
                self._steer(vehicle)

    def _steer(self, vehicle: Vehicle) -> None:
        top = vehicle.description.drive.max_wheel_speed
        left, right = self._dice.uniform(-top, top, 2)
        wheels = vehicle.description.driven_wheels
        vehicle.body.drive(np.array([left if wheel.side == "left" else right for wheel in wheels]))


def _survey(vehicle: Vehicle, snapshot: Snapshot) -> list[RayFan]:
    """What all sensors of a robot ask for at once."""
    state = vehicle.body.state(snapshot)
    assert state is not None
    return [fan for sensor in vehicle.sensors for fan in sensor.rays(state)]


def _half_circle(vehicle: Vehicle, snapshot: Snapshot, beams: int) -> RayFan:
    """The fan of a scanner that looks ahead."""
    state = vehicle.body.state(snapshot)
    assert state is not None
    pose = state.pose @ SCANNER
    yaw = np.linspace(-math.pi / 2.0, math.pi / 2.0, beams)
    flat = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(beams)], axis=1)
    return RayFan(np.array(pose.position), flat @ pose.matrix().T, REACH)


def physics(settings: Settings, _: str) -> dict[str, object]:
    """Steps per s of processor time with a driving team, what of that each robot costs, why its
    steps are not compiled, if they are not, and whether rays are."""
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
        "not_compiled": native.library()[1],
        "rays_compiled": ray_code() is not None,
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
    plain = Settings(world=WORLD, speed=math.inf, timestep=timestep, max_robots=TEAM)
    return Team(plain, TEAM)
