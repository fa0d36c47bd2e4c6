"""An environment as a world folder of the server: the same walls, of bricks, 2 m high.

x counts to the right and y up from the lower left corner of the map, m. Rectangles that cover
exactly the cells of walls become boxes. Starts and base stand where they do on the grid.
"""

from __future__ import annotations

from pathlib import Path

from usarsim_exploration.environment import Cell
from usarsim_exploration.worlds import furniture
from usarsim_exploration.worlds.mjcf import Scene
from usarsim_exploration.worlds.sheet import GeneratedWorld, Start
from usarsim_exploration.worlds.slicing import EXTRA
from usarsim_exploration.worlds.world import World
from usarsim_maps.grids.grid import rectangles
from usarsim_server.base.files import write_text
from usarsim_server.worlds.loader import SCENE, SHEET

HEIGHT = 2.0


def write_world(world: World, folder: Path) -> None:
    """Make a world folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in world_files(world, folder.name).items():
        write_text(folder / name, text)


def world_files(world: World, name: str) -> dict[str, str]:
    """Names and texts of the files of a world folder."""
    cell, (rows, columns) = world.environment.cell, world.environment.shape
    wide, deep = columns * cell, rows * cell
    middle, extent = (wide / 2, deep / 2, 0.5), max(wide, deep) / 2
    scene = Scene(name, center=middle, extent=extent)
    sheet = GeneratedWorld(
        name=name,
        title=world.title,
        description=f"The environment {world.environment.name} of the exploration benchmark.",
        scene=scene,
        lower=(0.0, 0.0, -2.0),
        upper=(wide, deep, 50.0),
    )
    furniture.checkered_floor(scene, "concrete", (0.62, 0.64, 0.66), (0.68, 0.70, 0.72))
    furniture.daylight(scene)
    scene.material("brick", (0.78, 0.72, 0.64))
    eye = (wide / 2, deep / 2 - 1.2 * extent, 2.4 * extent)
    scene.camera("overview", eye, (wide / 2, deep / 2, 0.0), 42.0)
    scene.section("floor")
    scene.floor("concrete")
    scene.section("walls")
    for wall in rectangles(world.environment.walls[::-1] != 0):
        lower = (wall.left * cell, wall.low * cell, 0.0)
        scene.block("wall", lower, (wall.right * cell, wall.high * cell, HEIGHT), "brick")

    def place(one: Cell) -> tuple[float, float]:
        return round((one[0] + 0.5) * cell, 4), round((rows - one[1] - 0.5) * cell, 4)

    for number, start in enumerate(world.starts, start=1):
        sheet.starts.append(Start(f"RobotStart{number}", (*place(start), 0.0)))
    x, y = place(world.base)
    extra = f"\n[extra.{EXTRA}]\nbase = [{x}, {y}]\ncell = {cell}\n"
    return {SCENE: scene.xml(), SHEET: sheet.toml() + extra}
