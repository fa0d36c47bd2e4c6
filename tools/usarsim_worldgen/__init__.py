"""Generators of the shipped worlds. What they write is committed; a test compares the two.

Each world has a module with a function `build`. Everything is drawn from fixed seeds, so a world
comes out the same on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from usarsim_worldgen import arena, empty, office, plant, proving_ground, smoke_corridor
from usarsim_worldgen.sheet import GeneratedWorld

__all__ = ["GENERATORS", "differences", "files", "write"]

GENERATORS: Mapping[str, Callable[[], GeneratedWorld]] = {
    "arena": arena.build,
    "empty": empty.build,
    "office": office.build,
    "plant": plant.build,
    "proving_ground": proving_ground.build,
    "smoke_corridor": smoke_corridor.build,
}


def files(name: str) -> dict[str, str]:
    """File names and texts of a world."""
    world = GENERATORS[name]()
    return {"scene.xml": world.scene.xml(), "world.toml": world.toml()}


def write(name: str, directory: Path) -> None:
    """Write a world's folder into a directory of worlds."""
    folder = directory / name
    folder.mkdir(parents=True, exist_ok=True)
    for file_name, text in files(name).items():
        (folder / file_name).write_text(text, encoding="utf-8")


def differences(name: str, directory: Path) -> list[Path]:
    """Files of a world that are missing or not what the generator makes."""
    expected = {directory / name / file_name: text for file_name, text in files(name).items()}
    return [
        path
        for path, text in expected.items()
        if not path.is_file() or path.read_text(encoding="utf-8") != text
    ]
