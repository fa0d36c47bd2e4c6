"""`usarsim import`: turn a map of another program into a world folder."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

from usarsim_server.base.errors import MapImportError, SettingsError, at
from usarsim_server.base.files import write_text
from usarsim_server.cli.common import Subparsers, add_command
from usarsim_server.world_cost import MAX_MEMORY, MAX_PIECES, MOST, WorldLimits

_EPILOG = (
    "The world folder is DIR/NAME. Facts that the map lacks stand in a sidecar file, "
    "MAP.usarsim.toml beside the map or --sidecar FILE; see docs/import.md. "
    "`usarsim serve --world SOURCE` imports on the fly."
)

_SCALE = "scale", "write the number of units that make a metre, such as 250"
_HEIGHT = "height of a wall", "write metres from 0.01 to 100"
_COUNT = "number of this kind", f"write a whole number from 1 to {MOST}"
"""What they are, and how to write them."""


def add_parser(subparsers: Subparsers) -> None:
    """Add `import` to the command line."""
    parser = add_command(
        subparsers,
        "import",
        "turn a map (Unreal, Gazebo, USD, glTF, OBJ, ...) into a world folder",
        run,
        epilog=_EPILOG,
    )
    parser.add_argument("source", metavar="SOURCE", type=Path, help="the map")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path(), help="where the world folder is made"
    )
    parser.add_argument("--name", metavar="N", help="name of the world (default the file's)")
    parser.add_argument(
        "--scale", metavar="UU_PER_M", help="units of the map per metre (default by format)"
    )
    parser.add_argument("--up", choices=("Z", "Y"), help="axis that points up (default by format)")
    parser.add_argument("--mirror", action="store_true", help="reflect the map: y becomes -y")
    parser.add_argument(
        "--assets",
        metavar="DIR",
        type=Path,
        action="append",
        default=[],
        help="folder with the meshes, textures and models that the map names; may be repeated",
    )
    parser.add_argument(
        "--allow-outside",
        action="store_true",
        help="read what the map names wherever it lies, not only beside it and in --assets",
    )
    parser.add_argument("--sidecar", metavar="FILE", type=Path, help="additions and overrides")
    parser.add_argument(
        "--placeholders", action="store_true", help="a box stands in for every missing mesh"
    )
    parser.add_argument(
        "--wall-height", metavar="M", help="height of walls of occupancy grids (default 2 m)"
    )
    parser.add_argument(
        "--max-pieces", metavar="N", help=f"most pieces of the world (default {MAX_PIECES})"
    )
    parser.add_argument(
        "--max-world-memory",
        metavar="MIB",
        help=f"most memory of its compiled model (default {MAX_MEMORY})",
    )
    parser.add_argument(
        "--report", metavar="FILE", type=Path, help="write the report: JSON if it ends with .json"
    )
    parser.add_argument(
        "--preview", action="store_true", help="draw six pictures into NAME/preview"
    )
    parser.add_argument("--fresh", action="store_true", help="import again, whatever is remembered")


def run(arguments: argparse.Namespace) -> int:
    """Import, print the report.

    Raises:
        MapImportError: the map, the sidecar or a folder cannot be used.
        SettingsError: an option has no meaning.
    """
    from usarsim_maps.convert import Request, import_map
    from usarsim_maps.reader import ImportOptions
    from usarsim_maps.terminal import ProgressBar

    request = Request(
        source=arguments.source,
        out=arguments.out,
        name=arguments.name,
        options=ImportOptions(
            scale=_number("--scale", arguments.scale, 1e-9, 1e9, *_SCALE),
            up=arguments.up,
            mirror=arguments.mirror,
            assets=tuple(arguments.assets),
            placeholders=arguments.placeholders,
            wall_height=_number("--wall-height", arguments.wall_height, 0.01, 100.0, *_HEIGHT),
            allow_outside=arguments.allow_outside,
            limits=WorldLimits(
                _whole("--max-pieces", arguments.max_pieces, MAX_PIECES),
                _whole("--max-world-memory", arguments.max_world_memory, MAX_MEMORY),
            ),
        ),
        sidecar=arguments.sidecar,
        fresh=arguments.fresh,
    )
    with ProgressBar() as bar:
        result = import_map(request, bar)
    print(result.report.text())
    print()
    if arguments.report is not None:
        text = result.report.text()
        if arguments.report.suffix.lower() == ".json":
            text = json.dumps(result.report.data(), indent=1)
        _write(arguments.report, text + "\n")
    if arguments.preview:
        from usarsim_maps.build.preview import write_previews
        from usarsim_server.worlds.loader import load_world

        for path in write_previews(load_world(result.folder), result.folder / "preview"):
            print(f"picture    {path}")
    print(f"world      {result.folder}" + (" (remembered)" if result.cached else ""))
    return 0


def _number(
    option: str, text: str | None, low: float, high: float, what: str, cure: str
) -> float | None:
    """The value of an option within limits, None if it was not given."""
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise SettingsError(at(option, f"{text!r} is no {what}", cure))
    return value


def _whole(option: str, text: str | None, default: int) -> int:
    """The value of an option that is a whole number, or its default."""
    value = _number(option, text, 1.0, float(MOST), *_COUNT)
    return default if value is None else int(value)


def _write(path: Path, text: str) -> None:
    try:
        write_text(path, text)
    except OSError as error:
        problem = f"cannot be written: {error.strerror}"
        raise MapImportError(at(path, problem, "give another --report")) from error
