"""Composition root: settings become a world, a simulation, a fleet and services.

The only place that knows everybody.
"""

from __future__ import annotations

import asyncio
import math
import sys
import weakref
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

from usarsim_server.assembly import Assembly
from usarsim_server.base.errors import UsarsimError, WorldError, at
from usarsim_server.base.files import data_directory, is_regular
from usarsim_server.base.logs import Log
from usarsim_server.cameras.backend import Quality
from usarsim_server.cameras.board import CameraBoard
from usarsim_server.cameras.painter import PainterOptions
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.render_loop import RenderLoop, RenderOptions
from usarsim_server.cameras.spectators import find_viewpoint, named_viewpoints
from usarsim_server.cameras.view import Grid
from usarsim_server.ports import services_of
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.scene.supervision import Supervision
from usarsim_server.services.limits import SpawnGate
from usarsim_server.services.port import run_services
from usarsim_server.sessions.dispatcher import Dispatcher
from usarsim_server.sessions.robot_role import RobotRoleOptions
from usarsim_server.sessions.robots import Robots
from usarsim_server.sessions.roles import RoleOptions, Roles
from usarsim_server.sessions.schedule import REPORT_GRID, UNPACED_GRID
from usarsim_server.sessions.session import Session
from usarsim_server.settings import Settings
from usarsim_server.simulation.growth import share_heaps
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.world_cost import WorldLimits
from usarsim_server.worlds.avatars import bodies as avatar_classes
from usarsim_server.worlds.avatars.avatars import Avatars
from usarsim_server.worlds.avatars.bodies import load_avatars
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.loader import find_world, load_world
from usarsim_server.worlds.machinery.obstacles import operators_of
from usarsim_server.worlds.objects import bodies as object_classes
from usarsim_server.worlds.objects.bodies import load_objects
from usarsim_server.worlds.objects.objects import WorldObjects
from usarsim_server.worlds.scene import build_in_parts, scene_error
from usarsim_server.worlds.surroundings import Surroundings

SWITCH_INTERVAL = 0.0002
"""s after which a Python thread has to let others run; the default of 5 ms starves the physics."""

MAPS = "usarsim_server.maps"
"""Entry point group of what makes a world folder of a map: a function of the map's path, of whether
files may be read that lie elsewhere, and of the limits of the world."""

_LEAST_BURST = 64
"""Robots that may come at the same moment, even if fewer fit into the world: most of those who try
again and again do so because it is full."""

_log = Log("server")


def assemble(settings: Settings) -> Assembly:
    """Load the world and the robots and put a server together.

    Raises:
        WorldError: if the world cannot be used.
        RobotDescriptionError: if a robot file cannot be used.
    """
    limits = WorldLimits(settings.max_pieces, settings.max_world_memory)
    world = load_world(_world_folder(settings.world, settings.allow_outside, limits))
    robot_catalog = load_catalog(settings.robots, allow_outside=settings.allow_outside)
    simulation = _simulation(settings, world)
    surroundings = Surroundings(world)
    operators = operators_of(world.machinery)
    simulation.set_movers((*surroundings.movers, *operators.movers), operators.machines)
    board = CameraBoard(Grid(*settings.tiles, *settings.tile_size))
    tells = settings.truth == "on"
    robots = Robots(robot_catalog, world, simulation, settings.seed, surroundings, board, tells)
    shipped = data_directory("worlds")
    catalog = load_objects([folder / object_classes.SHEET for folder in (shipped, world.folder)])
    objects = WorldObjects(catalog, simulation, world.lower, world.upper)
    classes = load_avatars([folder / avatar_classes.SHEET for folder in (shipped, world.folder)])
    avatars = Avatars(classes, simulation)
    robots.call_things(lambda body: objects.label(body) or avatars.label(body), objects.number)
    surroundings.watch(avatars.passers)
    render_loop = RenderLoop(simulation, board, _render_options(settings, world), robots.lit)
    _add_spectators(settings, world, simulation, board)
    gate = SpawnGate(settings.robot_rate, float(max(_LEAST_BURST, settings.max_robots)))
    # At a pace the physics looks for itself, once in a while, and is not woken for each report.
    unpaced = math.isinf(settings.speed)
    attention = simulation.attention if unpaced else None
    dispatcher = Dispatcher(simulation.cast_all, attention, simulation.moment)
    simulation.wake_batched(dispatcher.batched)
    options = _role_options(settings)
    roles = Roles(world, simulation, robots, objects, avatars, gate.admit, gate.forget, options)
    sessions = weakref.WeakSet[Session]()
    supervision = Supervision(lambda: tuple(sessions), lambda: simulation.now)
    assembly = Assembly(
        *(settings, world, simulation, robots, surroundings, roles, render_loop, dispatcher),
        supervision,
        sessions,
    )
    return replace(assembly, services=services_of(assembly))


def _simulation(settings: Settings, world: WorldDescription) -> Simulation:
    """The physics of a world, which compiles its scene.

    Raises:
        WorldError: if MuJoCo cannot read or compile the scene.
    """
    scene, fixed = build_in_parts(
        world,
        allow_outside=settings.allow_outside,
        limits=WorldLimits(settings.max_pieces, settings.max_world_memory),
    )
    options = SimulationOptions(
        physics=PhysicsOptions(timestep=settings.timestep, surfaces=world.surfaces),
        speed=settings.speed,
        patience=settings.lockstep_patience or math.inf,
        max_robots=settings.max_robots,
        max_things=settings.max_objects,
        lower=world.lower,
        upper=world.upper,
    )
    try:
        return Simulation(scene.copy, options, fixed)  # a growing model is made anew of a copy
    except ValueError as error:
        raise scene_error(world, error) from error


def _world_folder(named: str, allow_outside: bool, limits: WorldLimits) -> Path:
    """The folder of a world; a map of another program is imported first, or remembered.

    Args:
        named: by the user.
        allow_outside: the map may have files read that lie elsewhere.
        limits: of what becomes of the map.

    Raises:
        WorldError: there is no such world, or the map cannot be imported.
    """
    path = Path(named).expanduser()
    if not is_regular(path):
        return find_world(named)
    for point in entry_points(group=MAPS):
        importer: Callable[[Path, bool, WorldLimits], Path] = point.load()
        return importer(path, allow_outside, limits)
    raise WorldError(at(path, "maps cannot be imported", "install usarsim_maps"))


def run(settings: Settings) -> int:
    """Serve until told to end; returns the exit code.

    Raises:
        UsarsimError: if the server cannot start, or the physics has to give up.
    """
    sys.setswitchinterval(SWITCH_INTERVAL)
    share_heaps()
    assembly = assemble(settings)
    try:
        asyncio.run(_serve(assembly))
    finally:
        assembly.stop()
    if assembly.simulation.failure is not None:
        raise UsarsimError(f"the physics had to give up: {assembly.simulation.failure}")
    return 0


async def _serve(assembly: Assembly) -> None:
    """Run the world and all services until a signal, or until the physics gives up."""
    stop, loop = asyncio.Event(), asyncio.get_running_loop()

    def give_up() -> None:
        loop.call_soon_threadsafe(stop.set)

    if assembly.settings.image_port is not None:
        assembly.render_loop.open()
    assembly.simulation.start(give_up)
    await run_services(assembly.services, stop=stop)


def _render_options(settings: Settings, world: WorldDescription) -> RenderOptions:
    return RenderOptions(
        rate=settings.camera_rate,
        always=settings.always_render,
        painter=PainterOptions(
            renderer=settings.renderer,
            quality=Quality(settings.shadows, settings.multisample),
            smoke=world.smoke,
        ),
    )


def _add_spectators(
    settings: Settings, world: WorldDescription, simulation: Simulation, board: CameraBoard
) -> None:
    """Let the spectators that were asked for fill the first tiles."""
    if not settings.spectator:
        return
    snapshot = simulation.look()
    stage = Stage(simulation.compiled(snapshot))
    stage.show(snapshot)
    width, height = settings.tile_size
    known = named_viewpoints(stage, world, width / height)
    for text in settings.spectator:
        view = find_viewpoint(text, known)
        board.add(view.name, "", None, None, view.pose, view.fov)


def _role_options(settings: Settings) -> RoleOptions:
    # The quiet period is promised in wall time; the simulation knows only its own.
    paced = not math.isinf(settings.speed)
    factor = settings.speed if paced else 1.0
    return RoleOptions(
        dialect=settings.dialect,
        replace_robot=settings.second_init == "replace",
        tick=settings.tick if settings.lockstep else None,
        role=RobotRoleOptions(
            quiet_period=settings.quiet_period * factor,
            beat=REPORT_GRID if paced else UNPACED_GRID,
            udk_sta_order=settings.sta_order == "udk",
        ),
        start_at_first_pose=settings.default_start == "first",
        clean_on_close=settings.clean_on_close,
    )
