"""What another simulator has to say of itself to be compared, and where those are that do.

Every file in `peers/` defines `PEER`; no list has to be kept.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Literal

from usarsim_bench import peers

WORKLOADS = Path(next(iter(peers.__path__))) / "workloads"


@dataclass(frozen=True, slots=True)
class Peer:
    """Another simulator.

    Attributes:
        name: on the command line, and of its environment; a file name.
        title: for people.
        home: its page.
        packages: what pip is to install, with bounds of the versions that the workload was
            written for.
        python: oldest and newest minor version of Python 3 that they can be installed for.
        workload: file in `peers/workloads/` that does the work.
        against: what of ours it is compared with: `rovers` are wheeled robots with a laser inside
            one process, `humanoids` robots of many joints over sockets.
        same: what is the same on both sides, one or two sentences.
        different: what is not, and what is not compared at all.
        most: robots that it takes; None for any number.
        most_because: the reason for `most`.
        binary: whether only wheels will do; a package that takes long to compile should not be.
    """

    name: str
    title: str
    home: str
    packages: tuple[str, ...]
    python: tuple[int, int]
    workload: str
    against: Literal["rovers", "humanoids"]
    same: str
    different: str
    most: int | None = None
    most_because: str = ""
    binary: bool = True

    @property
    def script(self) -> Path:
        """The workload."""
        return WORKLOADS / self.workload


def find_peers(package: ModuleType = peers) -> Mapping[str, Peer]:
    """All peers of a package by name, sorted.

    Raises:
        ValueError: if a file has no `PEER`, or two have the same name.
    """
    found: dict[str, Peer] = {}
    for module in sorted(pkgutil.iter_modules(package.__path__), key=lambda one: one.name):
        if module.ispkg:
            continue
        name = f"{package.__name__}.{module.name}"
        peer = getattr(importlib.import_module(name), "PEER", None)
        if not isinstance(peer, Peer):
            raise ValueError(f"{name} defines no PEER (see usarsim_bench.peer)")
        if peer.name in found:
            raise ValueError(f"{name}: there is another peer called {peer.name!r}")
        found[peer.name] = peer
    return dict(sorted(found.items()))
