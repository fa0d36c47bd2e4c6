"""On what a figure was taken: without that it means little."""

from __future__ import annotations

import os
import platform
import re
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import psutil

_PACKAGES = ("mujoco", "numpy", "embreex")


@dataclass(frozen=True, slots=True)
class Machine:
    """A computer and the software that matters.

    Attributes:
        processor: model name.
        cores: that the machine has.
        usable_cores: that this process may use.
        memory: bytes.
        system: kernel and architecture.
        python: implementation and version.
        packages: versions by distribution name; "none" for what is not installed.
        load: programs ready to run, mean of the last minute, before measuring began.
    """

    processor: str
    cores: int
    usable_cores: int
    memory: int
    system: str
    python: str
    packages: dict[str, str]
    load: float

    def facts(self) -> list[tuple[str, str]]:
        """Name and value of everything, for people."""
        return [
            ("Processor", self.processor),
            ("Cores", f"{self.usable_cores} of {self.cores}"),
            ("Memory", f"{self.memory / 2**30:.1f} GiB"),
            ("System", self.system),
            ("Python", self.python),
            *((name, version) for name, version in self.packages.items()),
            ("Load before", f"{self.load:.2f}"),
        ]


def describe_machine(server_version: str) -> Machine:
    """This machine, now.

    Args:
        server_version: of the server that is measured.
    """
    return Machine(
        processor=_processor(),
        cores=os.cpu_count() or 1,
        usable_cores=len(os.sched_getaffinity(0)),
        memory=psutil.virtual_memory().total,
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        python=f"{platform.python_implementation()} {platform.python_version()}",
        packages={"usarsim-server": server_version} | {name: _version(name) for name in _PACKAGES},
        load=os.getloadavg()[0],
    )


def _processor() -> str:
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.M)
    except OSError:
        found = None
    return found[1].strip() if found else platform.processor() or "unknown"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "none"
