"""Command line of the world generators: `python -m world_generators [name] [--check|--pictures]`.

Pictures for the documentation are drawn by the server's own picture program, run once per world,
with software rendering if nothing else was asked for.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from usarsim_server.base.launch import python
from world_generators import GENERATORS, differences, files

_ROOT = Path(__file__).resolve().parents[1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Write worlds, compare them with what is written, or draw them; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m world_generators", description="Generate the shipped worlds."
    )
    parser.add_argument("name", nargs="*", help=f"default: {', '.join(GENERATORS)}")
    parser.add_argument("--check", action="store_true", help="only compare; exit code 1 if stale")
    parser.add_argument("--pictures", action="store_true", help="only draw what is written")
    parser.add_argument("--into", type=Path, help="folder, instead of worlds/ or docs/images/")
    chosen = parser.parse_args(arguments)
    for name in chosen.name:
        if name not in GENERATORS:
            parser.error(f"no generator for {name!r}; there are {', '.join(GENERATORS)}")
    code = 0
    for name in chosen.name or GENERATORS:
        if chosen.pictures:
            folder = chosen.into or _ROOT / "docs" / "images"
            code = max(code, _draw(name, folder / f"world_{name}.png"))
        elif chosen.check:
            for path in differences(name, chosen.into or _ROOT / "worlds"):
                print(f"{path} differs from what its generator makes", file=sys.stderr)
                code = 1
        else:
            _write(name, chosen.into or _ROOT / "worlds")
    return code


def _write(name: str, directory: Path) -> None:
    """Write a world's folder into a directory of worlds."""
    folder = directory / name
    folder.mkdir(parents=True, exist_ok=True)
    for file_name, text in files(name).items():
        (folder / file_name).write_text(text, encoding="utf-8")


def _draw(name: str, picture: Path) -> int:
    program = python("-m", "usarsim_server.worlds.scene", name, str(picture))
    environment = {"MUJOCO_GL": "egl", **os.environ}
    return subprocess.run(program, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
