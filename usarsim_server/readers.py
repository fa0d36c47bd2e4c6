"""Readers of settings that are more than a number or a word: paths, pairs, secrets."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path

from usarsim_server.base.addresses import bare_host
from usarsim_server.base.errors import UsarsimError, problem_and_advice
from usarsim_server.base.files import is_folder, is_regular, named
from usarsim_server.base.private import read_secret
from usarsim_server.base.tables import Table
from usarsim_server.protocol.images import IMAGE_TYPES, ImageType


def host(table: Table, key: str) -> str:
    """A host, without the brackets of an IPv6 address."""
    return bare_host(table.text(key))


def world(table: Table, key: str) -> str:
    """The name of a world, or an absolute path."""
    # A bare word is a shipped world; anything with a slash is a place seen from the file.
    world = table.text(key, lines=True)
    return str(path(table, key, world).absolute()) if "/" in world else world


def file(table: Table, key: str) -> Path:
    """The path of a file."""
    return path(table, key, table.text(key, lines=True))


def radio(table: Table, key: str) -> object:
    """A table as it stands, or the path of a file that holds one."""
    value = table.raw(key)
    return value if isinstance(value, Mapping) else file(table, key)


def texts(table: Table, key: str) -> tuple[str, ...]:
    """One text or a list of them, as they stand."""
    value = table.raw(key)
    entries = [value] if isinstance(value, str) else value
    if isinstance(entries, list) and all(isinstance(one, str) and one.strip() for one in entries):
        return tuple(entries)
    raise table.wrong(key, value, "a text, or a list of texts")


def folders(table: Table, key: str) -> tuple[Path, ...]:
    """One folder that exists, or a list of them."""
    found = tuple(path(table, key, one) for one in texts(table, key))
    for place in found:
        if not is_folder(place):
            problem = f"there is no folder {json.dumps(str(place))}"
            raise table.error(key, problem, "write an existing folder, or a list of them")
    return found


def path(table: Table, key: str, text: str) -> Path:
    """A path, seen from the folder of the file that names it."""
    if "\0" in text:
        raise table.error(key, "no file can have a NUL in its name", "write a path")
    folder = table.path.parent if isinstance(table.path, Path) else Path()
    # Not `Path.expanduser`, which raises where there is no such user.
    return folder / named(os.path.expanduser(text))


def image_type(table: Table, key: str) -> ImageType:
    """An encoding by name or number."""
    value = table.raw(key)
    if isinstance(value, str):
        return ImageType.named(value and table.choice(key, IMAGE_TYPES, any_case=True))
    return ImageType(table.count(key, low=0, high=2**31 - 1))


def pair(wanted: str, fits: Callable[[int, int], bool]) -> Callable[[Table, str], tuple[int, int]]:
    """The reader of two whole numbers with an x between them."""

    def read(table: Table, key: str) -> tuple[int, int]:
        value = table.raw(key)
        pair = re.fullmatch(r"([0-9]{1,5}) ?[xX] ?([0-9]{1,5})", str(value))
        if pair is None or not fits(int(pair[1]), int(pair[2])):
            raise table.wrong(key, value, wanted)
        return int(pair[1]), int(pair[2])

    return read


def samples(table: Table, key: str) -> int:
    """How many samples a pixel has."""
    value = table.raw(key)
    if isinstance(value, bool) or not isinstance(value, int) or value not in (0, 2, 4):
        raise table.wrong(key, value, "0, 2 or 4")
    return value


def secret(table: Table, key: str) -> str:
    """A text, or what stands in the file of that name, without blanks around it."""
    text = table.text(key).strip()
    place = path(table, key, text)
    if not is_regular(place):
        return text
    try:
        return read_secret(place)
    except UsarsimError as error:
        problem, cure = problem_and_advice(str(error))
        raise table.error(key, problem, cure or "name another file") from None
