"""The machine: processors, memory, how busy it is, how many sockets it allows.

Python and the libraries: which are there, whether they work, whether they will do.

The server as a whole: put together with the given settings, without opening a port.
"""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from usarsim_server import __version__
from usarsim_server.doctor import system
from usarsim_server.doctor.isolation import Outcome, attempt, pip, root
from usarsim_server.doctor.registry import Context, Finding, Mark, check, problem_and_advice
from usarsim_server.errors import UsarsimError

WATCHED = 0.4
"""s of wall time for which the machine is watched."""
BUSY = 0.25
"""Part of the processors that others may use before that is worth a warning."""
RENICED = 0.5
"""Processors that a program must use to be named as the one to slow down."""
NEEDED = 512 << 20
"""Bytes: a server with sixteen robots and all ports takes 370 MiB (`usarsim bench memory`)."""
COMFORTABLE = 1 << 30
FILES = 200
"""Descriptors beside the control connections: side channels, relays, the server itself."""
_GIB = float(1 << 30)


@check("machine", "Machine", order=20)
def look_at_machine(context: Context) -> Iterator[Finding]:
    """Ask `/proc`."""
    cores = system.cores()
    yield judge_cores(cores, context)
    yield judge_memory(*system.available_memory())
    yield judge_activity(system.activity(WATCHED), os.getloadavg()[0])
    yield judge_descriptors(system.descriptor_limit(), context.settings.connections)


def judge_cores(cores: float, context: Context) -> Finding:
    """What to say of so many processors."""
    values = {"cores": cores}
    if cores >= 1.5:
        return Finding("processors", Mark.OK, f"{cores:g}", values=values)
    text = f"{cores:g}: physics, sensors and cameras share it; watch few cameras"
    return Finding(
        "processors", Mark.WARNING, text, context.serve({"--camera-rate": 5}), values=values
    )


def judge_memory(free: int, total: int) -> Finding:
    """What to say of so many bytes."""
    values = {"available_bytes": free, "total_bytes": total}
    text = f"{free / _GIB:.1f} GiB available of {total / _GIB:.1f}"
    if free >= COMFORTABLE:
        return Finding("memory", Mark.OK, text, values=values)
    mark = Mark.PROBLEM if free < NEEDED else Mark.WARNING
    text += f": a server with sixteen robots wants {NEEDED >> 20} MiB, large maps more"
    return Finding("memory", mark, text, "ps -eo pid,rss,args --sort=-rss | head", values=values)


def judge_activity(seen: system.Activity, load: float) -> Finding:
    """What to say of what other programs do.

    Args:
        seen: just now.
        load: mean number of programs that wanted a processor during the last minute.
    """
    values: dict[str, object] = {
        "busy_cores": round(seen.busy, 2),
        "machine_cores": seen.processors,
        "load_1min": round(load, 2),
    }
    text = (
        f"other programs use {seen.busy:.1f} of {seen.processors} processors now; "
        f"load of the last minute {load:.1f}"
    )
    if seen.busy <= BUSY * seen.processors:
        return Finding("load", Mark.OK, text, values=values)
    cure = "top -o %CPU"
    if seen.busiest is not None and seen.busiest.cores >= RENICED:
        program = seen.busiest
        values["busiest"] = {"pid": program.pid, "name": program.name}
        text += f"; most of all {program.name} (pid {program.pid}), which could stand back"
        cure = root(f"renice -n 19 -p {program.pid}")
    return Finding("load", Mark.WARNING, text, cure, values=values)


def judge_descriptors(limit: int, connections: int) -> Finding:
    """What to say of a limit of open files, for so many control connections."""
    values = {"open_files": limit}
    endless = limit < 0
    if endless or limit >= connections + FILES:
        text = "no limit" if endless else f"{limit} may be open"
        return Finding("sockets, files", Mark.OK, text, values=values)
    text = f"only {limit} may be open: clients will have to wait"
    return Finding("sockets, files", Mark.WARNING, text, "ulimit -n 4096", values=values)


OLDEST_PYTHON = (3, 11)
VERSIONS_TIMEOUT = 60.0


@dataclass(frozen=True, slots=True)
class Package:
    """A library that the server uses.

    Attributes:
        name: of the distribution.
        module: that is imported.
        requirement: as `pyproject.toml` has it.
        purpose: what it is for; of an optional one, what cannot be done without it.
        optional: the server runs without it.
    """

    name: str
    module: str
    requirement: str
    purpose: str
    optional: bool = False


_MESHES = "maps in 3MF, OFF and XAML cannot be imported"

PACKAGES = (
    Package("mujoco", "mujoco", "mujoco>=3.16,<4", "the physics"),
    Package("numpy", "numpy", "numpy>=1.26", "arrays"),
    Package("embreex", "embreex", "embreex>=4.4.0", "the rays of range sensors"),
    Package("opencv-python-headless", "cv2", "opencv-python-headless>=4.9", "camera pictures"),
    Package("pillow", "PIL", "pillow>=10.1", "textures, and pictures in files"),
    Package(
        *("usd-core", "pxr", "usd-core>=24.8"),
        "maps of Unreal 4 and 5 (.usd, .usda, .usdc, .usdz) cannot be imported",
        optional=True,
    ),
    Package("trimesh", "trimesh", "trimesh>=4.5", _MESHES, optional=True),
    Package("lxml", "lxml.etree", "lxml>=5", _MESHES, optional=True),
    Package("networkx", "networkx", "networkx>=3", _MESHES, optional=True),
    Package(
        "DracoPy",
        "DracoPy",
        "DracoPy>=2",
        "glTF compressed by Draco cannot be imported",
        optional=True,
    ),
)


@check("versions", "Versions", order=10)
def look_at_versions(context: Context) -> Iterator[Finding]:
    """Import everything in a process that may die of it, and compare versions."""
    yield judge_python(sys.version_info[:3], sys.executable)
    place = str(Path(__file__).resolve().parents[3])
    yield Finding(
        "usarsim-server", Mark.OK, f"{__version__}, in {place}", values={"version": __version__}
    )
    names = {package: f"package:{package.module}" for package in PACKAGES}
    outcomes = attempt(tuple(names.values()), context.settings, VERSIONS_TIMEOUT)
    for package, name in names.items():
        yield judge_package(package, outcomes[name])


def judge_python(version: tuple[int, ...], executable: str) -> Finding:
    """What to say of a version of Python."""
    text = f"{'.'.join(map(str, version))}, {executable}"
    values = {"version": ".".join(map(str, version)), "machine": platform.machine()}
    if version[:2] >= OLDEST_PYTHON:
        return Finding("Python", Mark.OK, text, values=values)
    oldest = ".".join(map(str, OLDEST_PYTHON))
    cure = f"python{oldest} -m venv .venv && .venv/bin/pip install ."
    return Finding("Python", Mark.PROBLEM, f"{text}: older than {oldest}", cure, values=values)


def judge_package(package: Package, outcome: Outcome) -> Finding:
    """What to say of a library after the trial to import it."""
    bad = Mark.NOTE if package.optional else Mark.PROBLEM
    if outcome.missing is not None and outcome.missing.partition(".")[0] == package.module:
        text = f"{'optional, ' if package.optional else ''}not installed: {_loss(package)}"
        return Finding(package.name, bad, text, pip(package.requirement))
    if outcome.failure is not None:
        # Optional or not: what is installed should work.
        mark = Mark.WARNING if package.optional else Mark.PROBLEM
        cure = pip("--force-reinstall", package.requirement)
        return Finding(package.name, mark, f"cannot be imported: {outcome.failure}", cure)
    version = str(outcome.values.get("version", ""))
    values = {"version": version}
    refusal = _refusal(package, version)
    if refusal is not None:
        mark = Mark.WARNING if package.optional else Mark.PROBLEM
        return Finding(package.name, mark, refusal, pip(package.requirement), values=values)
    return Finding(package.name, Mark.OK, version or "of an unknown version", values=values)


def _loss(package: Package) -> str:
    return package.purpose if package.optional else f"needed for {package.purpose}"


def _refusal(package: Package, version: str) -> str | None:
    """Why a version will not do; None if it will."""
    if package.name == "mujoco":
        # The server's own judgement, which knows of releases that diverge.
        try:
            from usarsim_server.simulation.model import check_mujoco_version

            check_mujoco_version(version)
        except UsarsimError as error:
            return problem_and_advice(str(error))[0]
        except ImportError:
            pass  # another library is missing, which stands in a line of its own
    bounds = dict(re.findall(r"(>=|<)([\d.]+)", package.requirement))
    if version and _numbers(version) < _numbers(bounds[">="]):
        return f"{version} is older than {bounds['>=']}"
    if version and "<" in bounds and _numbers(version) >= _numbers(bounds["<"]):
        return f"{version} is too new, {bounds['<']} and later will not do"
    return None


def _numbers(version: str) -> tuple[int, ...]:
    """The numbers at the start of a version, as many as there are."""
    found = re.match(r"\d+(\.\d+)*", version)
    return tuple(int(part) for part in found[0].split(".")) if found else ()


TIMEOUT = 90.0


@check("server", "Server", order=60)
def look_at_server(context: Context) -> Iterator[Finding]:
    """Let another process put it together."""
    settings = context.settings
    if Path(settings.world).expanduser().is_file():
        text = f"{settings.world} is a map, which the server imports when it starts"
        cure = f"usarsim import {settings.world}"
        yield Finding("world", Mark.NOTE, f"{text}; this shows how that goes", cure)
        return
    yield from judge(attempt(["server"], settings, TIMEOUT)["server"])


def judge(outcome: Outcome) -> Iterator[Finding]:
    """What to say after the trial."""
    if outcome.failure is not None:
        text = outcome.failure if outcome.told else f"a defect, {outcome.failure}"
        yield Finding("start", Mark.PROBLEM, f"would not start: {text}", advice=outcome.advice)
        return
    values = outcome.values
    seconds = float(values["seconds"])
    text = f"would start, in {seconds:.1f} s, with the world {values['world']}"
    yield Finding("start", Mark.OK, text, values={"world": values["world"], "start_s": seconds})
    broken = values["broken"]
    if values["tried"] > len(broken):
        text = f"{values['tried'] - len(broken)} of your own can be put into the world"
        yield Finding("robots", Mark.OK, text)
    for robot in broken:
        text = f"cannot be put into the world: {robot['problem']}"
        yield Finding(robot["name"], Mark.WARNING, text, advice=robot["advice"])
