"""`usarsim radio-map`: where in a world the radio of one place is heard."""

from __future__ import annotations

import argparse
import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_server.cli.common import Subparsers, add_command, number, numbers, written
from usarsim_server.errors import SettingsError, at

if TYPE_CHECKING:
    from usarsim_exploration.coverage import Grid
    from usarsim_server.protocol.values import Vector
    from usarsim_server.simulation.simulation import Simulation
    from usarsim_server.worlds.description import WorldDescription


_EPILOG = (
    "Places are in the wire frame, as INIT takes them: x forward, y right, z down, in metres. "
    "Write --from=X,Y,Z with an equals sign where X is negative."
)
_MARGIN = 1.0
_CELLS = 240
"""Cells along the longer side, unless --cell says otherwise."""
_MOST_CELLS = 1_000_000
_NO_WALLS = 20.0
"""m around the source that are shown of a world where nothing stands."""
_HIGH = 1000.0
"""m: what lies higher is no part of the world (parked robots)."""


def add_parser(subparsers: Subparsers) -> None:
    """Add `radio-map` to the command line."""
    parser = add_command(
        subparsers,
        "radio-map",
        "draw how strong the radio of one place is heard in a world",
        run,
        epilog=_EPILOG,
    )
    parser.add_argument("picture", metavar="OUT.png", type=Path, help="PNG file to write")
    parser.add_argument("--world", metavar="NAME|PATH", default="arena", help="default arena")
    parser.add_argument(
        "--from",
        dest="source",
        metavar="X,Y,Z",
        type=_vector(3),
        required=True,
        help="place of the sender",
    )
    parser.add_argument("--model", metavar="NAME", help="propagation model (default obstacle)")
    parser.add_argument(
        "--wireless", metavar="FILE.toml", type=Path, help="settings of the model, as for serve"
    )
    parser.add_argument(
        "--height",
        metavar="M",
        type=float,
        help="height of the receivers above z = 0 (default: that of the sender)",
    )
    parser.add_argument("--cell", metavar="M", type=float, help="edge of a cell")
    parser.add_argument(
        "--area",
        metavar="X,Y,X,Y",
        type=_vector(4),
        help="two corners of the rectangle to show (default: all that stands in the world)",
    )
    parser.add_argument("--csv", metavar="FILE", type=Path, help="write the values, too")


def run(arguments: argparse.Namespace) -> int:
    """Survey, draw, write.

    Raises:
        UsarsimError: if world or settings cannot be used or a file cannot be written.
    """
    from usarsim_exploration.coverage import draw_coverage, find_walls, survey
    from usarsim_server.radio.configuration import read_radio, read_radio_file
    from usarsim_server.radio.obstacles import SceneryObstacles
    from usarsim_server.simulation.frames import flip_point
    from usarsim_server.worlds.loader import find_world, load_world

    given: Path | None = arguments.wireless
    table = {} if given is None else read_radio_file(given)
    model = read_radio(table, str(given or "settings"), arguments.model).model
    world = load_world(find_world(arguments.world))
    simulation = _simulation(world)
    source = flip_point(arguments.source)
    grid = _grid(arguments, world, simulation, source)
    coverage = survey(model, SceneryObstacles(simulation), source, grid)
    name = arguments.model or table.get("model", "obstacle")
    title = f"{world.name}, {name}, from {numbers(arguments.source)}, cells of {grid.cell:.3g} m"
    image = draw_coverage(coverage, find_walls(simulation.cast_scenery, grid), title)
    with written(arguments.picture) as file:
        image.save(file, "PNG")
    if arguments.csv is not None:
        text = io.StringIO(newline="")
        coverage.write_csv(text)
        with written(arguments.csv) as file:
            file.write(text.getvalue().encode())
    share = 100.0 * float(coverage.linked.mean())
    print(f"{arguments.picture}: {title}; a link in {number(share, 1)} % of the area")
    return 0


def _simulation(world: WorldDescription) -> Simulation:
    from usarsim_server.simulation.simulation import Simulation, SimulationOptions
    from usarsim_server.worlds.scene import build_scene

    return Simulation(lambda: build_scene(world), SimulationOptions())


def _grid(
    arguments: argparse.Namespace, world: WorldDescription, simulation: Simulation, source: Vector
) -> Grid:
    from usarsim_exploration.coverage import Grid

    if arguments.area is not None:
        x, y, to_x, to_y = arguments.area
        low, high = (min(x, to_x), min(-y, -to_y)), (max(x, to_x), max(-y, -to_y))
    else:
        low, high = _extent(world, simulation, source)
    longer = max(high[0] - low[0], high[1] - low[1])
    if not longer > 0.0:
        raise SettingsError(at("--area", "is empty", "name two opposite corners"))
    cell = _nice(longer / _CELLS) if arguments.cell is None else arguments.cell
    if not 0.001 <= cell <= 1000.0:
        raise SettingsError(at("--cell", f"{cell:g} does not fit", "write metres from 0.001 on"))
    height = source[2] if arguments.height is None else arguments.height
    if not math.isfinite(height):
        raise SettingsError(at("--height", f"{height:g} does not fit", "write metres"))
    grid = Grid.over(low, high, cell, height)
    if grid.rows * grid.columns > _MOST_CELLS:
        problem = f"{grid.columns} times {grid.rows} cells are too many"
        raise SettingsError(at("--cell", problem, "write a larger one, or a smaller --area"))
    return grid


def _extent(
    world: WorldDescription, simulation: Simulation, source: Vector
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Corners around all that stands within the bounds of the world, and around the source."""
    import mujoco
    import numpy as np

    model = simulation.compiled(simulation.snapshot).model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turns = data.geom_xmat.reshape(-1, 3, 3)
    middles = data.geom_xpos + np.einsum("nij,nj->ni", turns, model.geom_aabb[:, :3])
    halves = np.einsum("nij,nj->ni", np.abs(turns), model.geom_aabb[:, 3:])
    stands = model.geom_type != int(mujoco.mjtGeom.mjGEOM_PLANE)
    stands &= (model.body_weldid[model.geom_bodyid] == 0) & (middles[:, 2] < _HIGH)
    here = np.array(source)
    if stands.any():
        low = np.maximum((middles - halves)[stands].min(axis=0), world.lower)
        high = np.minimum((middles + halves)[stands].max(axis=0), world.upper)
    else:
        low, high = here - _NO_WALLS, here + _NO_WALLS
    low, high = np.minimum(low, here) - _MARGIN, np.maximum(high, here) + _MARGIN
    return (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))


def _nice(length: float) -> float:
    """The next length of 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(length))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= length)


def _vector(count: int) -> Callable[[str], tuple[float, ...]]:
    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)):
            raise argparse.ArgumentTypeError(f"{text!r} is not {count} numbers with commas")
        return values

    return read
