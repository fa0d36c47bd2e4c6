"""Draws the documentation's pictures: `python -m usarsim_worldgen.picture [name ...]`.

The server's own picture program is run once per world, with software rendering if nothing else
was asked for, and the pictures land in `docs/images`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from usarsim_worldgen import GENERATORS

_ROOT = Path(__file__).resolve().parents[2]


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the pictures of all or some worlds; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m usarsim_worldgen.picture", description="Draw the shipped worlds."
    )
    parser.add_argument("name", nargs="*", help=f"default: {', '.join(GENERATORS)}")
    parser.add_argument("--into", type=Path, default=_ROOT / "docs" / "images")
    chosen = parser.parse_args(arguments)
    environment = {"MUJOCO_GL": "egl", **os.environ}
    worst = 0
    for name in chosen.name or GENERATORS:
        picture = chosen.into / f"world_{name}.png"
        program = [sys.executable, "-m", "usarsim_server.worlds.scene", name, str(picture)]
        worst = max(worst, subprocess.run(program, env=environment, check=False).returncode)
    return worst


if __name__ == "__main__":
    sys.exit(main())
