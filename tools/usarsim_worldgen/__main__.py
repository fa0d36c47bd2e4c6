"""Command line of the world generators: `python -m usarsim_worldgen [name] [--check]`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from usarsim_worldgen import GENERATORS, differences, write

_WORLDS = Path(__file__).resolve().parents[2] / "worlds"


def main(arguments: Sequence[str] | None = None) -> int:
    """Write worlds, or compare them with what is written; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m usarsim_worldgen", description="Generate the shipped worlds."
    )
    parser.add_argument("name", nargs="*", help=f"default: {', '.join(GENERATORS)}")
    parser.add_argument("--check", action="store_true", help="only compare; exit code 1 if stale")
    parser.add_argument("--into", type=Path, default=_WORLDS, help="folder of world folders")
    chosen = parser.parse_args(arguments)
    for name in chosen.name:
        if name not in GENERATORS:
            parser.error(f"no generator for {name!r}; there are {', '.join(GENERATORS)}")
    stale = 0
    for name in chosen.name or GENERATORS:
        if not chosen.check:
            write(name, chosen.into)
            continue
        for path in differences(name, chosen.into):
            print(f"{path} differs from what its generator makes", file=sys.stderr)
            stale = 1
    return stale


if __name__ == "__main__":
    sys.exit(main())
