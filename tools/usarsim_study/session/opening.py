"""Opens the folder of a study for sessions: copies what belongs to it, and picks who comes next."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from datetime import date
from pathlib import Path

from usarsim_mission.scenario.description import beside
from usarsim_mission.scenario.reader import read_scenario
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import held, is_regular, reason, write_text
from usarsim_server.base.toml import read_text, toml_text
from usarsim_study.assignment import ALLOCATION
from usarsim_study.errors import StudyError
from usarsim_study.folder import Participant, StudyFolder
from usarsim_study.layouts import look
from usarsim_study.study_file import FILE, SHIPPED, Study, find_study, read_study


def open_folder(name: str, out: Path | None) -> StudyFolder:
    """The folder in which a study is run; made and filled if it is not there.

    Before the first session its missions are looked at, which takes seconds.

    Args:
        name: of a shipped study, a study file, or a study's folder.
        out: the folder; None: that of the study file.

    Raises:
        UsarsimError: there is no such study, it or a file of it cannot be used, or the folder holds
            another study.
    """
    path = find_study(name)
    if out is None:
        if path.parent == SHIPPED or path.name != FILE:
            raise StudyError(f"{path}: where do its sessions go? (name a folder: --out DIR)")
        out = path.parent
    study = read_study(path, out)
    target = out / FILE
    try:
        if target.exists():
            if target.read_bytes() != path.read_bytes():
                cure = f"go on with that one: study run {out}; or name another folder"
                raise StudyError(at(out, "holds another study", cure))
        else:
            look(study, path)
            out.mkdir(parents=True, exist_ok=True)
            for file in _files(study):
                _copy(path.parent, file, out)
            write_text(target, read_text(path, StudyError))
    except OSError as error:
        cure = "name a folder that can be written"
        raise StudyError(at(out, f"cannot be made: {reason(error)}", cure)) from None
    folder = StudyFolder(out)
    if not (out / ALLOCATION).exists() and target == path:
        look(study, path)
    folder.begin()
    consent_of(folder)
    return folder


def consent_of(folder: StudyFolder) -> str:
    """The text to agree to; empty: there is none.

    Raises:
        UsarsimError: the file is not there.
    """
    name = folder.study.consent_file
    if not name:
        return folder.study.consent.strip()
    return read_text(folder.path / name, StudyError).strip()


@contextlib.contextmanager
def next_participant(
    folder: StudyFolder, code: str | None = None, *, scripted: bool = False
) -> Iterator[Participant]:
    """Who sits at the desk now; nobody else leads that participant meanwhile.

    The one of a code, or whoever was interrupted, or somebody new. Scripted participants go on with
    no person's session, nor a person with theirs.

    Raises:
        StudyError: there is no such participant, who has ended or sits at another desk, or the
            list of assignments is used up.
        OSError: the folder cannot be written.
    """
    while True:
        for one in folder.participants():
            if (one.status, one.scripted) == ("running", scripted) and code in (None, one.code):
                with held(folder.place(one.code)) as ours:
                    # Whoever held it until now may have ended it.
                    now = {other.code: other for other in folder.participants()}[one.code]
                    if ours and now.status == "running":
                        yield now
                        return
        if code is not None:
            known = {one.code: one for one in folder.participants()}
            there = known.get(code)
            if there is None:
                told = "is not there"
            elif there.status != "running":
                told = f"has ended: {there.status}"
            elif there.scripted != scripted:
                told = "is made by code" if there.scripted else "is a person"
            else:
                told = "sits at another desk"
            raise StudyError(f"{folder.path}: participant {code} {told} (see participants/)")
        folder.admit(date.today().isoformat(), scripted=scripted)


def _files(study: Study) -> list[str]:
    """What a study file names, as it names it."""
    names = [study.consent_file, *(one.mission for one in study.layout)]
    names += [name for one in study.condition for name in (one.mission, one.impair)]
    names += [study.training.mission] if study.training is not None else []
    return [one for one in dict.fromkeys(names) if one]


def _copy(home: Path, name: str, out: Path) -> None:
    """Copy a file that a study names, if it lies there; missions keep their worlds and rules.

    Raises:
        UsarsimError: it cannot be read, or lies outside of the study's folder.
    """
    path = home / name
    if Path(name).is_absolute() or not is_regular(path):
        return
    target = out / name
    if not target.resolve().is_relative_to(out.resolve()):
        cure = "move it beside the study file, or name it by its whole path"
        raise UsarsimError(at(path, "lies outside of the study's folder", cure))
    target.parent.mkdir(parents=True, exist_ok=True)
    text = read_text(path, StudyError)
    if path.suffix == ".toml" and "usar-mission/" in text:
        scenario = read_scenario(path)
        content = {**(scenario.content or {})}
        for key, value in (("world", scenario.world), ("scoring", scenario.scoring)):
            there = beside(scenario, value)
            if there.exists():
                content[key] = str(there.absolute())
        text = toml_text(content)
    write_text(target, text)
