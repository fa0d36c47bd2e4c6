"""`usarsim snapshot`: a picture of a world, with robots or without, into a PNG file."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usarsim_server.base import logs
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cli.common import Subparsers, add_command, table, written

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from usarsim_server.assembly import Assembly
    from usarsim_server.cameras.view import View
    from usarsim_server.simulation.snapshot import Snapshot


_EPILOG = (
    "Places are in the wire frame, as INIT takes them: x forward, y right, z down, in metres and "
    "radians. Views: six numbers, x,y,z,x,y,z, from where and to where; top, overview, start; a "
    "camera of the scene by its name; or ROBOT/CAMERA, what a camera of a robot sees. Join what "
    "begins with a minus sign to its option: --view=-3,0,-2,0,0,0. A depth "
    "image has 16 bits of millimetres along the viewing axis, 0 where there is nothing. A "
    "segmentation has a colour for every object; the list of colours is printed."
)
_MODES = ("rgb", "depth", "segmentation")
_RENDERERS = ("auto", "egl", "osmesa", "rays")
_SHADOWS, _SAMPLES = 2048, 4
_FARTHEST = 65535
"""mm that a depth image can hold."""


def add_parser(subparsers: Subparsers) -> None:
    """Add `snapshot` to the command line."""
    parser = add_command(subparsers, "snapshot", "draw a picture of a world", run, epilog=_EPILOG)
    parser.add_argument("file", metavar="OUT.png", type=Path, help="file to write")
    parser.add_argument(
        "--world", metavar="NAME|PATH", default="arena", help="world to draw (default arena)"
    )
    parser.add_argument(
        "--view", default="overview", help="from where (default overview); see below"
    )
    parser.add_argument(
        "--size", metavar="WxH", type=_size, default=(960, 720), help="pixels (default 960x720)"
    )
    parser.add_argument(
        "--fov",
        metavar="DEG",
        type=_number(1.0, 170.0, "degrees"),
        help="horizontal field of view (default the view's)",
    )
    parser.add_argument("--mode", choices=_MODES, default="rgb", help="what to draw (default rgb)")
    parser.add_argument(
        "--robot",
        metavar="CLASS[@x,y,z[,yaw]]",
        action="append",
        default=[],
        help="put a robot there, or at the next start pose; may be repeated",
    )
    parser.add_argument(
        "--robots",
        metavar="DIR",
        action="append",
        default=[],
        help="folder with further robot files; may be repeated",
    )
    parser.add_argument(
        "--after",
        metavar="S",
        type=_number(0.0, 3600.0, "s"),
        default=1.0,
        help="simulated seconds to let pass first (default 1)",
    )
    parser.add_argument(
        "--renderer", choices=_RENDERERS, default="auto", help="what draws (default auto)"
    )
    parser.add_argument("--headlights", action="store_true", help="the robots' lamps are lit")


def run(arguments: argparse.Namespace) -> int:
    """Draw and write the picture.

    Raises:
        UsarsimError: for a world, robot, view or file that cannot be used.
    """
    from usarsim_server.app import assemble
    from usarsim_server.cameras.backend import Quality
    from usarsim_server.cameras.painter import Painter, PainterOptions, check_renderer
    from usarsim_server.settings import Settings

    logs.configure("warning")
    check_renderer(arguments.renderer)
    settings = Settings(
        world=arguments.world,
        robots=tuple(Path(folder) for folder in arguments.robots),
        speed=math.inf,
        port=None,
        image_port=None,
        groundtruth_port=None,
        wireless_port=None,
        truth_port=None,
    )
    assembly = assemble(settings)
    try:
        for number, text in enumerate(arguments.robot):
            _place_robot(assembly, text, number)
        assembly.simulation.run_until(arguments.after)
        snapshot = assembly.simulation.look()
        view = _view(assembly, snapshot, arguments)
        painter = Painter(
            assembly.simulation.compiled,
            PainterOptions(arguments.renderer, Quality(_SHADOWS, _SAMPLES), assembly.world.smoke),
            lit=lambda robot: bool(arguments.headlights),
        )
        try:
            picture = painter.picture(view, snapshot)
        finally:
            painter.close()
        _write(arguments, assembly, snapshot, picture)
    finally:
        assembly.stop()
    return 0


def _place_robot(assembly: Assembly, text: str, number: int) -> None:
    from usarsim_server.simulation.frames import pose_from_wire

    name, at_, place = text.partition("@")
    description = assembly.robots.describe(name)
    if description is None:
        raise UsarsimError(f"--robot: there is no class {name!r} (`usarsim robots` lists them)")
    if at_:
        try:
            x, y, z, *rest = (float(part) for part in place.split(","))
            (yaw,) = rest or (0.0,)
        except ValueError:
            raise UsarsimError(
                f"--robot: {place!r} is no place (write CLASS@x,y,z or CLASS@x,y,z,yaw)"
            ) from None
        pose = pose_from_wire((x, y, z), (0.0, 0.0, yaw))
    else:
        starts = assembly.world.starts
        pose = starts[number % len(starts)].pose
    assembly.robots.spawn(description, None, pose)


def _view(assembly: Assembly, snapshot: Snapshot, arguments: argparse.Namespace) -> View:
    from usarsim_server.cameras.posed_model import Stage
    from usarsim_server.cameras.spectators import find_viewpoint, named_viewpoints
    from usarsim_server.cameras.view import View

    width, height = arguments.size
    stage = Stage(assembly.simulation.compiled(snapshot))
    stage.show(snapshot)
    owner, slash, camera = arguments.view.rpartition("/")
    seen = assembly.board.find(camera, owner) if slash else None
    pose = None if seen is None else stage.place(seen)
    cut = math.inf
    if seen is not None and pose is not None:
        fov = seen.fov
    else:
        known = named_viewpoints(stage, assembly.world, width / height, open_roofs=True)
        found = find_viewpoint(arguments.view, known)
        pose, fov, cut = found.pose, found.fov, found.cut
    if arguments.fov is not None:
        fov = math.radians(arguments.fov)
    return View(pose, fov, width, height, arguments.mode, cut)


def _write(
    arguments: argparse.Namespace, assembly: Assembly, snapshot: Snapshot, picture: NDArray[Any]
) -> None:
    import numpy as np

    from usarsim_server.cameras.encoding import encode_png

    if arguments.mode == "depth":
        millimetres = np.where(np.isfinite(picture), np.rint(1000.0 * picture), 0.0)
        picture = np.where(millimetres > _FARTHEST, 0, millimetres).astype(np.uint16)
    elif arguments.mode == "segmentation":
        picture, rows = _objects(assembly, snapshot, picture)
        print(table(("COLOUR", "PIXELS", "OBJECT"), rows))
    with written(arguments.file) as file:
        file.write(encode_png(picture))


def _objects(
    assembly: Assembly, snapshot: Snapshot, geoms: NDArray[Any]
) -> tuple[NDArray[Any], list[tuple[str, int, str]]]:
    """A colour for every object that is seen, and the list of them, largest first."""
    import hashlib

    import numpy as np

    from usarsim_server.simulation.objects import geom_names

    names = geom_names(assembly.simulation.compiled(snapshot).model)
    colors = np.zeros((*geoms.shape, 3), np.uint8)
    counts: dict[str, tuple[str, int]] = {}
    for geom, count in zip(*np.unique(geoms[geoms >= 0], return_counts=True), strict=True):
        facts = assembly.robots.object_facts(names[geom] or "", snapshot)
        name = facts.name if facts is not None else names[geom] or f"geom {geom}"
        digest = hashlib.sha256(name.encode()).digest()
        color = [64 + part % 192 for part in digest[:3]]
        colors[geoms == geom] = color
        shown = "#" + bytes(color).hex()
        counts[name] = shown, counts.get(name, (shown, 0))[1] + int(count)
    rows = [(color, count, name) for name, (color, count) in counts.items()]
    return colors, sorted(rows, key=lambda row: (-row[1], row[2]))


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,4})[xX](\d{1,4})", text)
    if found is None or not all(1 <= int(side) <= 4096 for side in found.groups()):
        raise argparse.ArgumentTypeError(f"{text!r} is no size: write WxH such as 640x480")
    return int(found[1]), int(found[2])


def _number(low: float, high: float, unit: str) -> Callable[[str], float]:
    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is no number") from None
        if not low <= value <= high:
            problem = f"must be from {low:g} to {high:g} {unit}, not {text}"
            raise argparse.ArgumentTypeError(problem)
        return value

    return read
