"""One run of a batch, and what comes of it."""

from __future__ import annotations

import platform
import re
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import usarsim_server

Row = dict[str, Any]


class Task(Protocol):
    """A run to be played, anywhere: it can be pickled."""

    @property
    def key(self) -> str:
        """Names it in its batch."""

    def facts(self) -> Row:
        """How results name it."""

    def log(self) -> str:
        """The end of what programs said that it started; empty: there is nothing of the kind."""


T = TypeVar("T", bound=Task)


class Played(NamedTuple):
    """What came of a run. row: of results, the same wherever and whenever it runs.

    Attributes:
        timing: processor seconds and the like; no result.
        about: with what and where it was played (see `provenance`), and the end of its log, if it
            came to no end by itself.
    """

    row: Row
    timing: Mapping[str, float] = {}
    about: Mapping[str, object] = {}

    @property
    def error(self) -> str:
        """Why it failed; empty: it did not."""
        return str(self.row.get("error", ""))


Run = Callable[[T], Played]


def failed(task: Task, text: str, log: str = "") -> Played:
    """A run that came to no end.

    Args:
        task: of the run. text: why. log: the end of what its process said.
    """
    log = "\n".join(filter(None, (log, task.log())))
    about: Row = {**provenance(), **({"log": log} if log else {})}
    return Played(task.facts() | {"error": text}, {}, about)


@cache
def provenance() -> dict[str, object]:
    """Version, commit, versions of libraries, and the processor of this machine."""
    folder = Path(usarsim_server.__file__).parents[1]
    commit = ""
    with suppress(OSError, subprocess.SubprocessError):
        if (folder / ".git").exists():  # not that of a project which the package is installed in
            command = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=40"]
            commit = subprocess.run(command, capture_output=True, text=True, timeout=5).stdout
    libraries = {}
    for one in metadata.requires("usarsim-server") or ():
        name = re.split(r"[^\w.-]", one, maxsplit=1)[0]
        with suppress(metadata.PackageNotFoundError):
            libraries[name] = metadata.version(name)
    model = None
    with suppress(OSError):
        model = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.M)
    return {
        "version": metadata.version("usarsim-server"),
        "commit": commit.strip(),
        "libraries": {"python": platform.python_version(), **libraries},
        "processor": model[1] if model else platform.machine(),
    }


def differences(
    one: object, other: object, place: str = ""
) -> Iterator[tuple[str, object, object]]:
    """Where two rows differ: place, and both values."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys([*one, *other]):
            inner = f"{place}.{key}" if place else str(key)
            yield from differences(one.get(key), other.get(key), inner)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for number, pair in enumerate(zip(one, other, strict=True)):
            yield from differences(*pair, f"{place}[{number}]")
    elif one != other or type(one) is not type(other):
        yield place, one, other
