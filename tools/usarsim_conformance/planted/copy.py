"""A copy of the server with a few edits: links to everything else."""

from __future__ import annotations

import ast
import importlib.util
import shutil
import tomllib
from collections.abc import Iterable
from pathlib import Path

from usarsim_conformance.planted.faults import Edit

_DATA = "usarsim_server/data.py"
"""Finds robots and worlds from where it lies, so it is copied and not linked."""


class PlantError(Exception):
    """A fault that cannot be planted: its text is not there, or nothing changes."""


def _origin(file: str) -> Path:
    """Where a file, or folder, of the server really is."""
    first, _, rest = file.partition("/")
    found = importlib.util.find_spec("usarsim_server")
    assert found is not None
    assert found.origin is not None
    package = Path(found.origin).parent
    if first == "usarsim_server":
        return package / rest
    if first in ("robots", "worlds"):
        # A wheel carries them inside the package; in a source tree they lie beside it.
        packaged = package / "_data" / first
        return (packaged if packaged.is_dir() else package.parent / first) / rest
    raise PlantError(f"{file}: neither in usarsim_server nor in robots nor in worlds")


def edited(edits: Iterable[Edit]) -> dict[str, str]:
    """Text of every edited file, by path.

    Raises:
        PlantError: if a text to replace does not stand exactly once, or the file means the same
            afterwards.
    """
    texts: dict[str, str] = {}
    for edit in edits:
        path = _origin(edit.file)
        if not path.is_file():
            raise PlantError(f"{edit.file} does not exist")
        before = texts.get(edit.file) or path.read_text(encoding="utf-8")
        count = before.count(edit.old)
        if count != 1:
            raise PlantError(f"{edit.file}: {edit.old!r} stands there {count} times, not once")
        after = before.replace(edit.old, edit.new)
        if _meaning(edit.file, before) == _meaning(edit.file, after):
            raise PlantError(f"{edit.file}: {edit.new!r} changes nothing")
        texts[edit.file] = after
    return texts


def edited_copy(edits: Iterable[Edit], folder: Path) -> None:
    """Lay out the server in a folder, with edits; `folder` then belongs on PYTHONPATH.

    Raises:
        PlantError: see `edited`.
    """
    texts = edited(edits)
    texts.setdefault(_DATA, _origin(_DATA).read_text(encoding="utf-8"))
    for top in ("usarsim_server", "robots", "worlds"):
        _lay_out(top, folder, texts)


def _lay_out(path: str, folder: Path, texts: dict[str, str]) -> None:
    target = folder / path
    if path in texts:
        target.write_text(texts[path], encoding="utf-8")
        return
    origin = _origin(path)
    if origin.is_dir() and any(file.startswith(path + "/") for file in texts):
        target.mkdir()
        for entry in origin.iterdir():
            if entry.name not in ("__pycache__", "_data"):
                _lay_out(f"{path}/{entry.name}", folder, texts)
        return
    if origin.is_file() and path.startswith("robots/") and origin.suffix != ".toml":
        # A robot file may name a body only beside it, and links do not count.
        shutil.copyfile(origin, target)
        return
    target.symlink_to(origin)


def _meaning(file: str, text: str) -> object:
    try:
        if file.endswith(".py"):
            return ast.dump(ast.parse(text))
        if file.endswith(".toml"):
            return tomllib.loads(text)
    except (SyntaxError, tomllib.TOMLDecodeError) as error:
        raise PlantError(f"{file}: cannot be read after the edit: {error}") from None
    return text
