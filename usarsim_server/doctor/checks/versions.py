"""Python and the libraries: which are there, whether they work, whether they will do."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from usarsim_server import __version__
from usarsim_server.doctor.commands import pip
from usarsim_server.doctor.findings import Finding, Mark, problem_and_advice
from usarsim_server.doctor.isolation import Outcome, attempt
from usarsim_server.doctor.registry import Context, check
from usarsim_server.errors import UsarsimError

__all__ = ["OLDEST_PYTHON", "PACKAGES", "Package", "judge_package", "judge_python"]

OLDEST_PYTHON = (3, 11)
TIMEOUT = 60.0


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
def look(context: Context) -> Iterator[Finding]:
    """Import everything in a process that may die of it, and compare versions."""
    yield judge_python(sys.version_info[:3], sys.executable)
    place = str(Path(__file__).resolve().parents[3])
    yield Finding(
        "usarsim-server", Mark.OK, f"{__version__}, in {place}", values={"version": __version__}
    )
    names = {package: f"package:{package.module}" for package in PACKAGES}
    outcomes = attempt(tuple(names.values()), context.settings, TIMEOUT)
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
