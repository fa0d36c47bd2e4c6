"""`usarsim explore list`: the strategies, environments and radio models that there are."""

from __future__ import annotations

import argparse
import json

from usarsim_server.cli.common import Subparsers, add_command, facts


def add_parser(subparsers: Subparsers) -> None:
    """Add `list`."""
    text = "list strategies, environments and radio models"
    parser = add_command(subparsers, "list", text, run)
    parser.add_argument("--json", action="store_true", help="for programs")


def run(arguments: argparse.Namespace) -> int:
    """Print them."""
    from usarsim_exploration import worlds
    from usarsim_exploration.radio import radio_names
    from usarsim_exploration.strategy import TYPES

    found = {
        "strategies": TYPES.names(),
        "environments": worlds.names(),
        "radio_models": radio_names(),
    }
    if arguments.json:
        print(json.dumps(found, indent=1))
    else:
        print(facts((key.replace("_", " "), ", ".join(names)) for key, names in found.items()))
    return 0
