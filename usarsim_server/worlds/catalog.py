"""Which worlds there are, and where a world named by the user lies."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from pathlib import Path

from usarsim_server.data import data_directory
from usarsim_server.errors import WorldError
from usarsim_server.files import is_regular
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.loader import SHEET, load_world

__all__ = ["DEFAULT_WORLD", "find_world", "list_worlds"]

DEFAULT_WORLD = "arena"
"""The world of a server that was told nothing."""


def find_world(name_or_path: str, extra: Sequence[Path] = ()) -> Path:
    """Return the folder of a world.

    Args:
        name_or_path: path of a world folder (anything with a separator, or a folder that holds
            a `world.toml`), or a world's name, in any case.
        extra: folders of worlds that are searched before the shipped ones.

    Raises:
        WorldError: if there is none; the message lists the names that would do.
    """
    path = Path(name_or_path).expanduser()
    if is_regular(path / SHEET):
        return path
    if len(path.parts) != 1 or path.is_absolute():
        raise WorldError(
            f"{name_or_path}: not a world folder (cure: name a folder that holds {SHEET}; "
            "docs/worlds.md says how to make one)"
        )
    known = {folder.name: folder for folder in reversed(list(_folders(extra)))}
    by_lower = {name.lower(): folder for name, folder in known.items()}
    found = known.get(name_or_path) or by_lower.get(name_or_path.lower())
    if found is None:
        close = difflib.get_close_matches(name_or_path.lower(), by_lower, n=1)
        hint = f"did you mean {by_lower[close[0]].name}? " if close else ""
        names = ", ".join(sorted(known)) or "none"
        raise WorldError(f"{name_or_path}: no such world (cure: {hint}known worlds: {names})")
    return found


def list_worlds(extra: Sequence[Path] = ()) -> list[WorldDescription]:
    """Load all worlds of the extra folders and the shipped ones, sorted by name.

    A world in an extra folder hides a shipped one of the same name.

    Raises:
        WorldError: if one of them is broken.
    """
    known = {folder.name: folder for folder in reversed(list(_folders(extra)))}
    return [load_world(known[name]) for name in sorted(known)]


def _folders(extra: Sequence[Path]) -> Iterator[Path]:
    """World folders in order of precedence."""
    for directory in (*extra, data_directory("worlds")):
        if directory.is_dir():
            yield from (
                folder for folder in sorted(directory.iterdir()) if is_regular(folder / SHEET)
            )
