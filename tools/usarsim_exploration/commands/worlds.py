"""`usarsim explore worlds`: the environments that come along, and what becomes of any map."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_server.cli.common import Subparsers, add_command, table

if TYPE_CHECKING:
    from usarsim_exploration.worlds import World

OUT = "map.png or map.txt, else the folder of a world for the server"
_EPILOG = (
    "WORLD is a shipped environment, a picture, a text map, the YAML file of a ROS map, or a world "
    "folder, which is cut at the height of a scanner."
)


def add_parser(subparsers: Subparsers) -> None:
    """Add `worlds`."""
    text = "list environments, or write one as a picture, text or physics world"
    parser = add_command(subparsers, "worlds", text, run, epilog=_EPILOG)
    parser.add_argument("world", metavar="WORLD", nargs="?", help="default: all shipped ones")
    parser.add_argument("--compat", action="store_true", help="read maps as MRESim does")
    parser.add_argument("--json", action="store_true", help="for programs")
    parser.add_argument("--out", metavar="PATH", type=Path, help=f"write WORLD: {OUT}")


def run(arguments: argparse.Namespace) -> int:
    """Print one line per environment."""
    from usarsim_exploration import worlds
    from usarsim_exploration.worlds.pictures import Rules
    from usarsim_server.base.errors import SettingsError

    if arguments.out and not arguments.world:
        raise SettingsError("--out: no world is named (cure: usarsim explore worlds WORLD --out)")
    chosen = [arguments.world] if arguments.world else worlds.names()
    found = [worlds.find(one, Rules(compat=arguments.compat)) for one in chosen]
    for note in (note for one in found for note in one.notes):
        print(note, file=sys.stderr)
    if arguments.out:
        write(found[0], arguments.out)
    tell(found, as_json=arguments.json)
    return 0


def write(world: World, path: Path) -> None:
    """As a picture, as text, or as a physics world, by the name."""
    from usarsim_exploration.worlds.physics import write_world
    from usarsim_exploration.worlds.pictures import save_map

    if path.suffix.lower() in (".png", ".txt"):
        path.parent.mkdir(parents=True, exist_ok=True)
        save_map(world.environment, path)
    else:
        write_world(world, path)


def tell(found: list[World], *, as_json: bool) -> None:
    """One line for each."""
    facts = [
        {
            "name": one.environment.name,
            "title": one.title,
            "columns": one.environment.shape[1],
            "rows": one.environment.shape[0],
            "cell": one.environment.cell,
            "free": one.environment.free,
            "base": one.base,
            "starts": one.starts,
            "digest": one.digest,
        }
        for one in found
    ]
    if as_json:
        print(json.dumps(facts, indent=1))
        return
    rows = [
        (
            one["name"],
            f"{one['columns']} x {one['rows']}",
            one["free"],
            len(place.starts),
            one["title"],
        )
        for one, place in zip(facts, found, strict=True)
    ]
    print(table(("NAME", "CELLS", "FREE", "STARTS", "TITLE"), rows))
