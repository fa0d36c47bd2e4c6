"""Looks at the missions of a study: what cannot be, and whether layouts are equally hard."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from usarsim_mission.scenario.check import findings
from usarsim_mission.scenario.reader import find_mission, read_scenario
from usarsim_mission.scenario.resolving import stage
from usarsim_operator.impairment import read_plan
from usarsim_server.base.errors import UsarsimError, at, problem_and_advice
from usarsim_server.base.files import is_regular
from usarsim_server.base.toml import read_text
from usarsim_study.assignment import Cell
from usarsim_study.errors import StudyError
from usarsim_study.lines import line_of
from usarsim_study.misread import misread
from usarsim_study.study_file import ALIKE, Study, alike, begun

NEAR = 2.0
"""m from a victim at which a robot has reached it."""


@dataclass(frozen=True, slots=True)
class Place:
    """A layout under one or several conditions. ways: m from the nearest start, by victim."""

    layout: str
    mission: str
    ways: tuple[float, ...]

    @property
    def mean_way(self) -> float:
        """m; 0 without victims."""
        return fmean(self.ways) if self.ways else 0.0


def mission_file(name: str, folder: Path) -> Path:
    """A mission: a file from the study's folder, any file, or a shipped one.

    Raises:
        UsarsimError: there is none.
    """
    beside = folder / name
    return beside if is_regular(beside) else find_mission(name)


def look(study: Study, path: Path) -> tuple[Place, ...]:
    """Stage every mission of a study.

    Args:
        study: as it was read.
        path: its file.

    Raises:
        StudyError: a mission cannot be, such as with a victim that nobody can reach, or layouts
            differ; with the line of the study file.
    """
    text = read_text(path, StudyError)
    found: dict[tuple[str, str], Place] = {}
    for number, layout in enumerate(study.layout, start=1):
        for condition in study.condition:
            name, seed = study.mission_of(Cell(condition.name, layout.name))
            if (layout.name, name) in found:
                continue
            where = f"[[layout]] {number} ({layout.name}): mission"
            try:
                staged = stage(read_scenario(mission_file(name, path.parent)), seed=seed)
                wrong = findings(staged)
            except UsarsimError as error:
                wrong = [error]
            if wrong:
                raise _told(path, text, where, wrong[0], "mend the mission")
            lost = [one.entry.name for one in staged.robots if misread(one.entry.name)]
            if lost and not begun(path.parent):
                problem = f"{name} has a robot {lost[0]!r}, in a table {misread(lost[0])} to pandas"
                raise _error(path, text, where, problem, "give it another name in the mission")
            if condition.robots is not None and condition.robots > len(staged.robots):
                place = f"[[condition]] {study.condition.index(condition) + 1} ({condition.name})"
                problem = f"{name} has {len(staged.robots)} robots, not {condition.robots}"
                raise _error(path, text, f"{place}: robots", problem, "write a smaller number")
            ways = [staged.reached.way_to(one.pose.position, NEAR) for one in staged.victims]
            found[layout.name, name] = Place(layout.name, name, tuple(map(float, ways)))
    if all(one.path_length is None for one in study.layout):
        for condition in study.condition:
            _compare(study, condition.name, found, path, text)
    _look_at_files(study, path, text)
    _look_at_training(study, path, text)
    return tuple(found.values())


def _look_at_files(study: Study, path: Path, text: str) -> None:
    """Refuse files of conditions that say nothing that can be used, and a consent that is gone."""
    for number, condition in enumerate(study.condition, start=1):
        if condition.impair:
            try:
                read_plan(path.parent / condition.impair)
            except UsarsimError as error:
                where = f"[[condition]] {number} ({condition.name}): impair"
                raise _told(path, text, where, error, "mend the file") from None
    if study.consent_file and not is_regular(path.parent / study.consent_file):
        problem = f"{study.consent_file} is not there"
        cure = 'name a text file beside the study file, or write consent = """ and the text'
        raise _error(path, text, "consent", problem, cure)


def _look_at_training(study: Study, path: Path, text: str) -> None:
    """Refuse a training that nobody could do, or pass."""
    if (training := study.training) is None:
        return
    where = "[training]: mission"
    try:
        staged = stage(read_scenario(mission_file(training.mission, path.parent)))
        wrong = findings(staged)
    except UsarsimError as error:
        wrong = [error]
    if wrong:
        raise _told(path, text, where, wrong[0], "mend the mission")
    if training.victims > len(staged.victims):
        problem = f"{training.mission} has {len(staged.victims)} victims, not {training.victims}"
        raise _error(path, text, "[training]: victims", problem, "write a smaller number")


def _compare(
    study: Study, condition: str, found: dict[tuple[str, str], Place], path: Path, text: str
) -> None:
    """Refuse layouts of one condition whose mean ways differ."""
    places = [
        found[layout.name, study.mission_of(Cell(condition, layout.name))[0]]
        for layout in study.layout
    ]
    least, most = (pick(places, key=lambda one: one.mean_way) for pick in (min, max))
    if not alike(least.mean_way, most.mean_way):
        number = [layout.name for layout in study.layout].index(most.layout) + 1
        raise _error(
            path,
            text,
            f"[[layout]] {number} ({most.layout}): mission",
            f"victims are {most.mean_way:.1f} m away on average, in {least.layout} "
            f"{least.mean_way:.1f} m",
            f"choose seeds or places that differ by at most {100 * ALIKE:.0f} %",
        )


def _told(path: Path, text: str, where: str, error: UsarsimError, advice: str) -> StudyError:
    """The error of another file, told at the line that names it."""
    problem, cure = problem_and_advice(str(error))
    return _error(path, text, where, problem, cure or advice)


def _error(path: Path, text: str, where: str, problem: str, cure: str) -> StudyError:
    line = line_of(text, where)
    place = where if line is None else f"line {line}: {where}"
    return StudyError(at(path, problem, cure, where=place))
