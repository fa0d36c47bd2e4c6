"""What is installed: Python and the libraries, worlds and robots, OpenGL.

Only what needs no library is imported with this file, so that one that is missing or ends its
process is one line of the report.
"""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

import usarsim_server
from usarsim_doctor.isolation import Outcome, attempt
from usarsim_doctor.mending import pip, root
from usarsim_doctor.registry import Context, Finding, Mark, check
from usarsim_server import __version__
from usarsim_server.base.errors import UsarsimError, problem_and_advice
from usarsim_server.base.files import data_directory
from usarsim_server.settings import Settings

if TYPE_CHECKING:
    from usarsim_server.robots.catalog import RobotFile

# -- Python and the libraries ----------------------------------------------------------------------

OLDEST_PYTHON = (3, 11)
VERSIONS_TIMEOUT = 60.0


@dataclass(frozen=True, slots=True)
class Package:
    """A library that the server uses."""

    name: str  # of the distribution
    module: str  # that is imported
    requirement: str  # as `pyproject.toml` has it
    purpose: str  # what it is for; of an optional one, what cannot be done without it
    optional: bool = False  # the server runs without it


_MESHES = "maps in 3MF, OFF and XAML cannot be imported"
_LEARNING = "exploration cannot be learned (usarsim_exploration.gym)"

PACKAGES = (
    Package("mujoco", "mujoco", "mujoco>=3.16,<4", "the physics"),
    Package("numpy", "numpy", "numpy>=1.26", "arrays"),
    Package("embreex", "embreex", "embreex>=4.4.0", "the rays of range sensors"),
    Package("opencv-python-headless", "cv2", "opencv-python-headless>=4.9", "camera pictures"),
    Package("mapbox_earcut", "mapbox_earcut", "mapbox_earcut>=2.0", "polygons of worlds"),
    Package("pillow", "PIL", "pillow>=10.1", "textures, and pictures in files"),
    Package(
        *("psutil", "psutil", "psutil>=6"),
        "batches cannot be played, and this machine's memory and load not be looked at",
        optional=True,
    ),
    Package(*("PyYAML", "yaml", "PyYAML>=6"), "grid maps of ROS cannot be imported", optional=True),
    Package(
        *("aiohttp", "aiohttp", "aiohttp>=3.11"),
        "the operator console in the browser cannot be served",
        optional=True,
    ),
    Package(
        *("usd-core", "pxr", "usd-core>=24.8"),
        "maps of Unreal 4 and 5 (.usd, .usda, .usdc, .usdz) cannot be imported",
        optional=True,
    ),
    Package(
        "ufbx", "ufbx", "ufbx>=0.0.5", "maps and meshes in FBX cannot be imported", optional=True
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
    Package(
        *("meshopt", "meshopt", "meshopt>=0.1"),
        "glTF compressed by meshopt cannot be imported",
        optional=True,
    ),
    Package(
        *("scipy", "scipy", "scipy>=1.15"),
        "studies of operators and runs of exploration cannot be analysed",
        optional=True,
    ),
    Package(
        *("matplotlib", "matplotlib", "matplotlib>=3.8"),
        "reports of studies and of exploration cannot be drawn",
        optional=True,
    ),
    Package(
        *("distributed", "distributed", "distributed>=2026.8"),
        "batches cannot be played on a Dask cluster",
        optional=True,
    ),
    Package("numba", "numba", "numba>=0.61", "exploration takes longer", optional=True),
    Package("gymnasium", "gymnasium", "gymnasium>=1.4", _LEARNING, optional=True),
    Package("pettingzoo", "pettingzoo", "pettingzoo>=1.27", _LEARNING, optional=True),
)


@check("versions", "Versions", order=10)
def look_at_versions(context: Context) -> Iterator[Finding]:
    """Import everything in a process that may die of it, and compare versions."""
    yield judge_python(sys.version_info[:3], sys.executable)
    place = str(Path(usarsim_server.__file__).resolve().parents[1])
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
    # Of `lxml.etree` Python misses `lxml`; a part of what is there that is missing is a fault.
    if outcome.missing is not None and outcome.missing == package.module.partition(".")[0]:
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


# -- worlds, robots, plug-ins ----------------------------------------------------------------------

PLUGIN_GROUPS = (
    "usarsim_server.sensors",
    "usarsim_server.effectors",
    "usarsim_server.families",
    "usarsim_server.propagation",
    "usarsim_maps.readers",
)


@check("files", "Worlds and robots", order=40, apart=True)
def look_at_files(context: Context) -> Iterator[Finding]:
    """Read every world and every robot file that a server could use."""
    yield from judge_worlds(data_directory("worlds"))
    yield from judge_robots([data_directory("robots"), *context.settings.robots])
    for group in PLUGIN_GROUPS:
        for point in entry_points(group=group):
            yield judge_plugin(point)


def judge_worlds(folder: Path) -> Iterator[Finding]:
    """Load all worlds of a folder."""
    from usarsim_server.worlds.loader import SHEET, load_world

    names, broken = [], []
    for place in sorted(one.parent for one in folder.glob(f"*/{SHEET}")):
        try:
            names.append(load_world(place).name)
        except UsarsimError as error:
            problem, advice = problem_and_advice(str(error))
            broken.append(Finding(place.name, Mark.WARNING, problem, advice=advice))
    values = {"worlds": names}
    if names:
        yield Finding("worlds", Mark.OK, f"{len(names)}: {', '.join(names)}", values=values)
    else:
        cure = pip("--force-reinstall", "--no-deps", "usarsim-server")
        yield Finding("worlds", Mark.PROBLEM, f"there are none in {folder}", cure, values=values)
    yield from broken


def judge_robots(folders: Sequence[Path]) -> Iterator[Finding]:
    """Read all robot files; the first folder is that of the shipped ones.

    Any file that cannot be read keeps the server from starting, or a shipped class from being used.
    """
    from usarsim_server.robots.catalog import RobotCatalog

    layers: list[list[RobotFile]] = []
    broken: list[Finding] = []
    for number, folder in enumerate(folders):
        files, findings = _read(folders, number, folder)
        layers.append(files)
        broken.extend(findings)
    if not broken:
        try:
            RobotCatalog(layers)  # which knows whether two of them want the same name
        except UsarsimError as error:
            broken.append(_broken("robot files", error))
    shipped, own = len(layers[0]), sum(map(len, layers[1:]))
    text = f"{shipped} classes" + (f", {own} of your own" if len(folders) > 1 else "")
    values = {"shipped": shipped, "own": own, "broken": len(broken)}
    yield Finding("robots", Mark.OK if shipped else Mark.PROBLEM, text, values=values)
    yield from broken


def _read(
    folders: Sequence[Path], number: int, folder: Path
) -> tuple[list[RobotFile], list[Finding]]:
    from usarsim_server.robots.catalog import Library

    files: list[RobotFile] = []
    broken: list[Finding] = []
    library = None
    for path in sorted(folder.glob("*.toml")):
        try:
            # After an error a library is in the middle of a file, so the next one is a new one.
            library = library or Library(folders)
            files.append(library.load(path, number))
        except UsarsimError as error:
            broken.append(_broken(path.name, error))
            library = None
    return files, broken


def _broken(subject: str, error: UsarsimError) -> Finding:
    problem, advice = problem_and_advice(str(error))
    return Finding(subject, Mark.PROBLEM, problem, advice=advice)


def judge_plugin(point: EntryPoint) -> Finding:
    """Load a plug-in of another package."""
    package = point.dist.name if point.dist is not None else "its package"
    subject = f"plug-in {point.name}"
    try:
        point.load()
    except Exception as error:  # it is somebody else's code
        text = f"{point.value} cannot be loaded: {type(error).__name__}: {error}"
        cure = pip("--force-reinstall", package)
        return Finding(subject, Mark.WARNING, " ".join(text.split()), cure)
    return Finding(subject, Mark.OK, f"{point.value}, of {package}")


# -- OpenGL ----------------------------------------------------------------------------------------

GRAPHICS_TIMEOUT = 30.0
SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software rasterizer")
"""Words in GL_RENDERER of programs that draw on the processor (Mesa 3D documentation, drivers)."""
WITHOUT = "pictures are cast with rays, which takes about four times as long"
"""As measured in `docs/cameras.md`."""


@dataclass(frozen=True, slots=True)
class Device:
    """A graphics card that the system knows."""

    path: str  # of its file
    usable: bool  # we may use it


@dataclass(frozen=True, slots=True)
class Drawing:
    """What the server would draw with."""

    tried: tuple[tuple[str, str], ...]
    """Ways to have OpenGL that were tried, and why they do not work."""
    platform: str | None  # the way that works; None for none
    renderer: str = ""  # GL_RENDERER of it; empty if it would not say
    cards: tuple[Device, ...] = ()  # what the system knows


@check("graphics", "Graphics", order=50)
def look_at_graphics(context: Context) -> Iterator[Finding]:
    """Try what the server would try, in the same order."""
    from usarsim_server.cameras.backend import platforms_to_try, works

    settings = context.settings
    tried = []
    platform = None
    for one in platforms_to_try(settings.renderer):
        reason = works(one)
        if reason is None:
            platform = one
            break
        tried.append((one, reason))
    renderer = ""
    if platform is not None:
        name = f"gl:{platform}"
        said = attempt([name], settings, GRAPHICS_TIMEOUT)[name].values
        renderer = str(said.get("renderer", ""))
    yield from judge_drawing(Drawing(tuple(tried), platform, renderer, devices()), settings)


def devices(folder: Path = Path("/dev")) -> tuple[Device, ...]:
    """Graphics cards that could be drawn with: render nodes of the kernel, NVIDIA's own files."""
    found = [*sorted(folder.glob("dri/renderD*")), *sorted(folder.glob("nvidia[0-9]*"))]
    return tuple(Device(str(path), os.access(path, os.R_OK | os.W_OK)) for path in found)


def is_software(renderer: str) -> bool:
    """Whether a GL_RENDERER draws on the processor."""
    return any(word in renderer.lower() for word in SOFTWARE)


def judge_drawing(drawing: Drawing, settings: Settings) -> Iterator[Finding]:
    """What to say of it."""
    if settings.renderer == "rays":
        values = {"backend": "rays", "hardware": False}
        yield Finding("pictures", Mark.OK, "rays on the processor, as asked for", values=values)
    elif drawing.platform is None:
        yield _no_opengl(drawing, settings)
    else:
        yield from _opengl(drawing)


def _opengl(drawing: Drawing) -> Iterator[Finding]:
    software = is_software(drawing.renderer)
    where = "software, on the processor" if software else "hardware"
    if not drawing.renderer:
        where = "it would not say what it draws with"
    said = f": {drawing.renderer}" if drawing.renderer else ""
    values = {
        "backend": drawing.platform,
        "renderer": drawing.renderer,
        "hardware": bool(drawing.renderer) and not software,
    }
    text = f"OpenGL by {drawing.platform}, {where}{said}"
    yield Finding("pictures", Mark.OK, text, values=values)
    if software and drawing.cards:
        yield _idle_card(drawing)


def _idle_card(drawing: Drawing) -> Finding:
    """There is a graphics card, but nobody draws with it."""
    names = ", ".join(card.path for card in drawing.cards)
    values = {"devices": [card.path for card in drawing.cards]}
    text = f"{names} is there but does not draw"
    closed = [card for card in drawing.cards if not card.usable]
    if len(closed) == len(drawing.cards):
        text += ": this user may not open it"
        cure = root("usermod -aG render,video $USER") + "  # then log in again"
    elif drawing.platform != "egl":
        text += f": only EGL can use it ({dict(drawing.tried).get('egl', 'which was not tried')})"
        cure = root(_packages()["egl"])
    elif "nvidia" in names:
        text += ": NVIDIA's EGL driver is missing (in a container, its graphics capability)"
        cure = "docker run --gpus all -e NVIDIA_DRIVER_CAPABILITIES=all ..."
        if not Path("/.dockerenv").exists():
            cure = root("apt-get install libnvidia-gl-" + _nvidia_release())
    else:
        text += ": its driver is missing"
        cure = root(_packages()["egl"])
    return Finding("graphics card", Mark.NOTE, text, cure, values=values)


def _nvidia_release() -> str:
    """Main number of the driver of the kernel; packages of the libraries are called after it."""
    try:
        words = Path("/sys/module/nvidia/version").read_text().split(".")
    except OSError:
        return "XXX"
    return words[0].strip()


def _no_opengl(drawing: Drawing, settings: Settings) -> Finding:
    reasons = "; ".join(f"{platform}: {reason}" for platform, reason in drawing.tried)
    values = {"backend": "rays", "hardware": False, "tried": dict(drawing.tried)}
    cure = root(_packages()[_best(drawing, settings)])
    if settings.renderer != "auto":
        text = f"--renderer {settings.renderer} does not work here: {reasons}"
        # Nothing is drawn, and so nothing checked, without the port for images.
        mark = Mark.PROBLEM if settings.image_port is not None else Mark.WARNING
        return Finding("pictures", mark, text, cure, values=values)
    text = f"no OpenGL, {WITHOUT}" + (f" ({reasons})" if reasons else "")
    return Finding("pictures", Mark.WARNING, text, cure, values=values)


def _packages() -> Mapping[str, str]:
    """The command that installs each way to have OpenGL."""
    from usarsim_server.cameras.backend import INSTALL

    return INSTALL


def _best(drawing: Drawing, settings: Settings) -> str:
    """What to install: one small package, or what a graphics card needs."""
    if settings.renderer in _packages():
        return settings.renderer
    tried: Sequence[str] = [platform for platform, _ in drawing.tried]
    if drawing.cards or "osmesa" not in tried:
        return "egl"
    return "osmesa"
