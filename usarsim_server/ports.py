"""What a server listens on: a service for each port that its settings ask for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from usarsim_server.assembly import Assembly
from usarsim_server.base.logs import Log
from usarsim_server.cameras.encoding import Encoder
from usarsim_server.protocol import messages
from usarsim_server.radio.configuration import RadioOptions, read_radio, read_radio_file
from usarsim_server.radio.event_log import EventLog
from usarsim_server.radio.network import Network, RadioWorld
from usarsim_server.radio.obstacles import SceneryObstacles
from usarsim_server.robots.description import RobotDescription
from usarsim_server.scene.feed import Census, SceneFeed
from usarsim_server.scene.supervision_channels import Supervisor
from usarsim_server.scene.truth_channel import TruthChannel
from usarsim_server.scene.truth_feed import TruthFeed
from usarsim_server.scene.truth_rows import Being, TruthRows
from usarsim_server.services.budget import Pace, WorkBudget, whole_share
from usarsim_server.services.comserver import ComServerLimits, ComServerService
from usarsim_server.services.control import ControlLimits, ControlService
from usarsim_server.services.dialogue import (
    TRUTH_LIMITS,
    Desk,
    DialogueLimits,
    Instant,
    ground_truth_service,
    ready,
    responder,
    truth_service,
)
from usarsim_server.services.images import ImageService
from usarsim_server.services.owners import Owners
from usarsim_server.services.port import Service
from usarsim_server.services.relay import LinkOptions
from usarsim_server.services.scene_port import ScenePort
from usarsim_server.services.wireless import WirelessLimits, WirelessService
from usarsim_server.sessions.outbox import OutboxLimits
from usarsim_server.sessions.reset import put_back
from usarsim_server.settings import Settings
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.truth.ground_truth import Actors, GroundTruth

GAME_TYPE = "BotDeathMatch"
"""What both generations of the original said in their greeting (protocol reference 1.2)."""

INSTANT = 0.02
"""Simulated s for which an answer about places holds: a robot at 2 m/s is 4 cm further by then."""

_log = Log("server")


def services_of(assembly: Assembly) -> tuple[Service, ...]:
    """The services of a server, none of them listening yet."""
    settings, simulation, robots = assembly.settings, assembly.simulation, assembly.robots
    services: list[Service] = []
    if settings.port is not None:
        services.append(_control_service(settings, settings.port, assembly))
    if settings.image_port is not None:
        services.append(_image_service(settings, settings.image_port, assembly))
    tells = settings.truth == "on"
    obstacles = SceneryObstacles(simulation)
    span = INSTANT / settings.speed
    truth = GroundTruth(robots.stations, obstacles, span, lambda: robots.changes)
    ground_truth = responder(truth.answers)
    victims, roles = assembly.surroundings.victims, assembly.roles
    actors = Actors(simulation, robots.classes, victims, roles.avatars, roles.objects)
    pace = _pace(settings, simulation)
    recent = Instant(span, truth.version, ready(truth.at_once))
    positions = partial(ground_truth_service, respond=ground_truth, instant=recent)
    listed = Instant(span, lambda: robots.changes)
    poses = partial(truth_service, answer=actors.answer, instant=listed)
    ports = (("groundtruth_port", positions, DialogueLimits()), ("truth_port", poses, TRUTH_LIMITS))
    for key, service, limits in ports:
        port = getattr(settings, key)
        if tells and port is not None:
            services.append(
                service(
                    settings.host,
                    port,
                    required=settings.demands(key),
                    limits=replace(limits, idle=settings.idle_timeout),
                    pace=pace,
                )
            )
        elif port is not None and settings.demands(key):
            _log.warning("a port is not opened: ground truth is switched off", setting=key)
    radio_limits = WirelessLimits(idle=settings.idle_timeout)
    desk = Desk("wireless", ground_truth, radio_limits, recent, pace=pace) if tells else None
    radio = RadioWorld(robots.stations, obstacles, lambda: simulation.now, settings.speed)
    services += _wireless_services(settings, radio, radio_limits, desk, assembly.owners, pace)
    if settings.scene_port is not None:
        services.append(_scene_port(settings, settings.scene_port, assembly))
    return tuple(services)


def _control_service(settings: Settings, port: int, assembly: Assembly) -> ControlService:
    world = assembly.world
    greeting = messages.encode(messages.greeting(GAME_TYPE, world.level, world.time_limit))
    most = settings.connections
    limits = ControlLimits(
        max_connections=most,
        per_address=settings.max_per_address,
        arrival_rate=settings.connection_rate,
        # Everybody may come at once, and once more to ask for start poses.
        arrival_burst=2 * most,
        max_line=settings.line_bytes,
        rate=settings.input_rate,
        idle=settings.idle_timeout,
        outbox=OutboxLimits(stream_bytes=settings.outbox_bytes, reply_bytes=settings.reply_bytes),
    )
    return ControlService(
        settings.host,
        port,
        greeting,
        assembly.make_session,
        limits,
        _pace(settings, assembly.simulation),
    )


def _image_service(settings: Settings, port: int, assembly: Assembly) -> ImageService:
    return ImageService(
        settings.host,
        port,
        assembly.render_loop,
        Encoder(settings.image_type),
        legacy=settings.image_legacy,
        silent_push=settings.image_silent_push,
        bound=assembly.board.bound,
        required=settings.demands("image_port"),
        pace=_pace(settings, assembly.simulation),
    )


def _scene_port(settings: Settings, port: int, assembly: Assembly) -> ScenePort:
    simulation, robots, roles = assembly.simulation, assembly.robots, assembly.roles
    census = Census(robots, roles.avatars, roles.objects)
    pace = _pace(settings, simulation)
    feed = SceneFeed(simulation, assembly.world, census, robots.marks, pace)
    supervisor = Supervisor(
        assembly.supervision,
        simulation,
        lambda: put_back(roles, assembly.surroundings, tuple(assembly.sessions)),
        assembly.surroundings.call,
    )
    return ScenePort(
        *(settings.host, port, feed, assembly.world.level, settings.scene_token),
        channels={**supervisor.channels, "truth": TruthChannel(_truth_feed(assembly))},
        requests=supervisor.requests if settings.supervise == "on" else None,
    )


def _truth_feed(assembly: Assembly) -> TruthFeed:
    simulation, robots, roles = assembly.simulation, assembly.robots, assembly.roles
    rows = TruthRows(
        simulation,
        assembly.surroundings.victims,
        lambda body: roles.objects.label(body) or roles.avatars.label(body),
    )

    def beings() -> list[Being]:
        return [
            Being(one.name, one.robot, _mounts(one.description), one.power.share)
            for one in robots.vehicles
        ]

    return TruthFeed(simulation, rows, beings)


def _mounts(robot: RobotDescription) -> list[tuple[str | None, Pose]]:
    return [(camera.link, camera.pose) for camera in robot.cameras]


def _pace(settings: Settings, simulation: Simulation) -> Callable[[], float]:
    """Which part of their shares ports may use: a world that goes at no pace falls behind none."""
    if math.isinf(settings.speed):
        return whole_share
    return Pace(lambda: simulation.now, lambda: 0.0 if simulation.paused else simulation.speed)


def _wireless_services(
    settings: Settings,
    world: RadioWorld,
    limits: WirelessLimits,
    ground_truth: Desk | None,
    owners: Owners,
    pace: Callable[[], float],
) -> list[Service]:
    """The two wireless simulations, as far as they are wanted; each has a network of its own."""
    if settings.wireless_port is None and settings.comserver_port is None:
        return []
    options = _radio_options(settings)
    log = EventLog(settings.wireless_log, world.clock)

    def network() -> Network:
        return Network(
            world,
            options.model,
            options.fading,
            # Where robots were when the watch looked is a matter of the clock on the wall.
            cache_distance=0.0 if settings.lockstep else options.cache_distance,
            patience=options.patience,
            log=log,
        )

    services: list[Service] = []
    if settings.wireless_port is not None:
        services.append(
            WirelessService(
                settings.host,
                settings.wireless_port,
                network(),
                ground_truth,
                link_options=LinkOptions(
                    options.shape,
                    settings.speed,
                    settings.seed,
                    WorkBudget(options.share, pace=pace),
                ),
                limits=replace(limits, poll=options.poll),
                required=settings.demands("wireless_port"),
                owners=owners,
                strict=settings.strict_radio,
                looks_again=settings.lockstep,
            )
        )
    if settings.comserver_port is not None:
        services.append(
            ComServerService(
                settings.host,
                settings.comserver_port,
                network(),
                limits=ComServerLimits(poll=options.poll, idle=settings.idle_timeout),
                pace=pace,
                required=settings.demands("comserver_port"),
                owners=owners,
            )
        )
    return services


def _radio_options(settings: Settings) -> RadioOptions:
    given = settings.wireless
    if isinstance(given, Path):
        table, place = read_radio_file(given), str(given)
    else:
        table, place = dict(given or {}), f"{settings.config or 'settings'}: [wireless]"
    return read_radio(table, place, settings.wireless_model, settings.seed)
