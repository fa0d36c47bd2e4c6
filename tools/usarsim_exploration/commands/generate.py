"""`usarsim explore generate`: environments of one's own."""

from __future__ import annotations

import argparse
from pathlib import Path

from usarsim_exploration.commands.worlds import OUT, tell, write
from usarsim_server.cli.common import Subparsers, add_command

_OPTIONS = ("columns", "rows", "rooms", "doors", "loops", "clutter")


def add_parser(subparsers: Subparsers) -> None:
    """Add `generate`."""
    parser = add_command(subparsers, "generate", "make an environment from a seed", run)
    parser.add_argument("kind", metavar="KIND", help="such as office; a wrong one lists all")
    for name in _OPTIONS:
        parser.add_argument(f"--{name}", metavar="N", help=_help(name))
    parser.add_argument("--seed", metavar="N", default="1", help="another one, another building")
    parser.add_argument("--json", action="store_true", help="for programs")
    parser.add_argument("--out", metavar="PATH", type=Path, required=True, help=OUT)


def _help(name: str) -> str:
    from usarsim_exploration.worlds.generators import Shape
    from usarsim_server.base.fields import keys

    key = next(one for one in keys(Shape) if one.name == name)
    return f"{key.help}, {key.wanted} (default {key.default()})"


def run(arguments: argparse.Namespace) -> int:
    """Make, write, and say what it is."""
    from usarsim_exploration.worlds.catalogue import Recipe
    from usarsim_exploration.worlds.generators import KINDS, Shape
    from usarsim_server.base.errors import SettingsError, at
    from usarsim_server.base.tables import Table, suggest

    kind = arguments.kind
    if kind not in KINDS:
        cure = suggest(kind, sorted(KINDS))
        raise SettingsError(at("usarsim explore generate", f"no generator {kind!r}", cure))
    given = {name: value for name in _OPTIONS if (value := getattr(arguments, name)) is not None}
    table = Table(
        {name: _number(value) for name, value in {**given, "seed": arguments.seed}.items()},
        "usarsim explore generate",
        SettingsError,
    )
    seed = table.count("seed", 1, low=0, high=2**63 - 1)
    shape = table.read(Shape)
    world = Recipe(kind, f"Generated {kind}", shape, seed).make(arguments.out.stem)
    write(world, arguments.out)
    tell([world], as_json=arguments.json)
    return 0


def _number(text: str) -> object:
    """As it would stand in a file."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
