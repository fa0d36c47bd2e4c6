"""Camera pictures per second of a loop without any server: render, encode, and again.

`python -m usarsim_bench.instruments.frames --robots 4 --seconds 5` puts a team into a world and
lets time stand still; then one thread draws the cameras of all robots in turn with
`mujoco.Renderer`, in the quality of the server's default, and makes a JPEG of each picture with the
server's own codec. It prints one JSON object (`Frames`). That is what pictures delivered by a
server can be measured by.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from usarsim_bench.instruments.bare_renderer import BareRenderer
from usarsim_server.app import Assembly, assemble
from usarsim_server.cameras.encoding import encode_jpeg
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.view import Eye
from usarsim_server.errors import UsarsimError
from usarsim_server.protocol.images import NORMAL
from usarsim_server.settings import Settings
from usarsim_server.simulation.snapshot import Snapshot

SETTLE = 1.0
"""s of simulated time before pictures are taken."""
TILE = 320, 240


@dataclass(frozen=True, slots=True)
class Frames:
    """What the loop made.

    Attributes:
        renderer: platform of OpenGL; "rays" if there is none here, so that nothing was drawn.
        cameras: that took turns.
        pictures: per s of wall time.
        cores: processors kept busy meanwhile, by this process.
        octets: mean length of a JPEG.
    """

    renderer: str
    cameras: int
    pictures: float
    cores: float
    octets: float


def measure_frames(
    world: str, robot_class: str, folders: Sequence[Path], robots: int, seconds: float
) -> Frames:
    """Draw and encode for so many seconds of wall time.

    Args:
        world: name or folder.
        robot_class: of all robots; it carries cameras.
        folders: with further robot files.
        robots: how many, on the world's start poses in turn.
        seconds: wall time.

    Raises:
        UsarsimError: if the world or the class cannot be used, or carries no camera.
    """
    assembly = _assembly(world, robot_class, folders, robots)
    try:
        assembly.simulation.run_until(SETTLE)
        snapshot = assembly.simulation.look()
        painter = Painter(assembly.simulation.compiled, PainterOptions())
        renderer, eyes = painter.renderer, _eyes(assembly, painter, snapshot)
        painter.close()
        if not eyes:
            raise UsarsimError(f"{robot_class} carries no camera (name a class that does)")
        if renderer == "rays":
            return Frames(renderer, len(eyes), math.nan, math.nan, math.nan)
        compiled = assembly.simulation.compiled(snapshot)
        with BareRenderer(renderer, compiled, snapshot, eyes[0]) as bare:
            return _drawn(bare, renderer, eyes, seconds)
    finally:
        assembly.stop()


def _drawn(bare: BareRenderer, renderer: str, eyes: Sequence[Eye], seconds: float) -> Frames:
    quality = NORMAL.quality
    assert quality is not None  # a JPEG
    for eye in eyes:
        encode_jpeg(bare.draw(eye), quality, b"")
    pictures = octets = 0
    begun, spent = time.perf_counter(), time.process_time()
    while (elapsed := time.perf_counter() - begun) < seconds:
        octets += len(encode_jpeg(bare.draw(eyes[pictures % len(eyes)]), quality, b""))
        pictures += 1
    cores = (time.process_time() - spent) / elapsed
    return Frames(renderer, len(eyes), pictures / elapsed, cores, octets / pictures)


def _eyes(assembly: Assembly, painter: Painter, snapshot: Snapshot) -> list[Eye]:
    placed = (painter.place(view, snapshot, *TILE) for view in assembly.board.views)
    return [eye for eye in placed if eye is not None]


def _assembly(world: str, robot_class: str, folders: Sequence[Path], robots: int) -> Assembly:
    assembly = assemble(
        Settings(
            world=world,
            speed=math.inf,
            robots=tuple(folders),
            max_robots=robots,
            tile_size=TILE,
            port=None,
            image_port=None,
            groundtruth_port=None,
            wireless_port=None,
            truth_port=None,
        )
    )
    description = assembly.fleet.describe(robot_class)
    if description is None:
        raise UsarsimError(f"there is no robot class {robot_class!r} (see usarsim robots)")
    starts = assembly.world.starts
    for number in range(robots):
        assembly.fleet.spawn(description, None, starts[number % len(starts)].pose)
    return assembly


def main(arguments: Sequence[str]) -> int:
    """Measure, and print one JSON object."""
    parser = argparse.ArgumentParser(prog="python -m usarsim_bench.instruments.frames")
    parser.add_argument("--world", default="arena", help="name or folder (default arena)")
    parser.add_argument("--class", dest="robot_class", default="P3AT", metavar="NAME")
    parser.add_argument("--folder", type=Path, action="append", default=[], metavar="DIR")
    parser.add_argument("--robots", type=int, default=4, help="size of the team (default 4)")
    parser.add_argument("--seconds", type=float, default=5.0, help="wall time")
    given = parser.parse_args(arguments)
    frames = measure_frames(
        given.world, given.robot_class, given.folder, given.robots, given.seconds
    )
    print(json.dumps(asdict(frames)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
