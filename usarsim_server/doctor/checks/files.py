"""Worlds and robot files: how many there are, and which of them are broken."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_server.data import data_directory
from usarsim_server.doctor.commands import pip
from usarsim_server.doctor.findings import Finding, Mark, problem_and_advice
from usarsim_server.doctor.registry import Context, check
from usarsim_server.errors import UsarsimError

if TYPE_CHECKING:
    from usarsim_server.robots.loader import RobotFile

__all__ = ["PLUGIN_GROUPS", "judge_plugin", "judge_robots", "judge_worlds"]

PLUGIN_GROUPS = (
    "usarsim_server.sensors",
    "usarsim_server.effectors",
    "usarsim_server.families",
    "usarsim_server.propagation",
    "usarsim_maps.readers",
)


@check("files", "Worlds and robots", order=40, apart=True)
def look(context: Context) -> Iterator[Finding]:
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

    Any file that cannot be read keeps the server from starting.
    """
    from usarsim_server.robots.roster import Roster

    layers: list[list[RobotFile]] = []
    broken: list[Finding] = []
    for number, folder in enumerate(folders):
        files, findings = _read(folders, number, folder)
        layers.append(files)
        broken.extend(findings)
    if not broken:
        try:
            Roster(layers)  # which knows whether two of them want the same name
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
    from usarsim_server.robots.loader import Library

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
