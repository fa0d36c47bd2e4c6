"""Writes a run as one HTML file that needs nobody: no server, no network, no second file."""

from __future__ import annotations

import base64
import re
from html import escape
from pathlib import Path
from typing import Any

from usarsim_mission.errors import RunLogError
from usarsim_mission.rescoring import rescore
from usarsim_mission.runlog import SCORE, RunFolder
from usarsim_mission.sharing.contents import LEVELS, Detail, Shown
from usarsim_mission.sharing.scenery import read_scenery
from usarsim_mission.sharing.story import Story
from usarsim_server.base.errors import at
from usarsim_server.base.files import read_regular, reason, write_text
from usarsim_server.base.toml import read_toml
from usarsim_server.protocol.json_text import parse_json

SHARED = "share.html"
LIMIT = 5_000_000
"""Bytes of the file, at most."""
PARTS = ("share.html", "share.css", "share.js")
"""Of the page, beside the console's: the frame, its style and its program."""
_GAPS = re.compile(r"(<!--title-->|/\*style\*/|<!--run-->|/\*program\*/)")
DAMAGED = (LookupError, TypeError, ValueError, AttributeError, OverflowError)
"""What a record that says something impossible raises."""
_STUDY = "study.toml"
_ABOVE = 4  # folders above a run in which the study's can be


def share(folder: Path, out: Path, page: Path, blind: bool = False) -> tuple[int, Detail]:
    """Write a run as one file.

    Args:
        folder: of the run. out: file to write. page: folder of the built page.
        blind: name no condition; a run of a blind study names none in any case.

    Returns:
        Bytes of the file, and how much of the run is in it.

    Raises:
        RunLogError: the run cannot be read, or the file not be written.
    """
    html, style, program = (_part(page / name) for name in PARTS)
    shown = _read(folder, blind or is_blind(folder))
    frame = _GAPS.split(html)
    parts = {
        "<!--title-->": escape(shown.title),
        "/*style*/": style,
        "/*program*/": program.replace("</script", "<\\/script"),
    }
    for detail in LEVELS:
        parts["<!--run-->"] = base64.b64encode(shown.packed(detail)).decode()
        text = "".join(parts.get(one, one) for one in frame)
        if len(text.encode()) <= LIMIT:
            break
    else:
        problem = f"cannot be made smaller than {len(text) / 1e6:.1f} MB"
        raise RunLogError(at(folder, problem, "share a shorter run"))
    try:
        write_text(out, text)
    except OSError as error:
        cure = "name another file with --out"
        raise RunLogError(at(out, f"cannot be written: {reason(error)}", cure)) from error
    return len(text.encode()), detail


def is_blind(folder: Path) -> bool:
    """Whether a run lies in the folder of a blind study, or of one that cannot be read."""
    for above in list(folder.resolve().parents)[:_ABOVE]:
        if (above / _STUDY).exists():
            try:
                study = read_toml(above / _STUDY, RunLogError)
            except RunLogError:
                return True
            return study.get("blind", False) is not False
    return False


def _part(path: Path) -> str:
    try:
        return read_regular(path).decode()
    except OSError as error:
        cure = "build the page: python hatch_build.py, or make page"
        raise RunLogError(at(path, f"cannot be read: {reason(error)}", cure)) from error


def _read(folder: Path, blind: bool) -> Shown:
    run, story = RunFolder(folder), Story()
    mission, world = run.world()
    for record in run.records():
        try:
            story.take(record)
        except DAMAGED as error:
            problem = f"record {record['seq']} ({record['kind']}) is damaged: {error}"
            raise RunLogError(at(folder, problem, "take an unchanged copy")) from None
    if not story.times:
        problem = "has no truth: nobody has moved"
        raise RunLogError(at(folder, problem, "name a run that has begun"))
    damage = [f"The log was cut off: {name} ends within a line." for name in run.cut]
    if run.missing:
        damage.append(f"{run.missing} records of the log are missing.")
    result = _result(folder)
    if result is None:
        damage.append("The run was broken off; the points are those that follow from its log.")
        result = rescore(folder).result
    return Shown(mission, world, story, result, read_scenery(folder), damage, blind)


def _result(folder: Path) -> dict[str, Any] | None:
    """What `score.json` tells; None without one."""
    path = folder / SCORE
    if not path.exists():
        return None
    try:
        result = dict(parse_json(read_regular(path)))
        ended, victims = dict(result["ended"]), [dict(one) for one in result["victims"]]
        dict(result["values"]), float(result["total"]), result["rules"]
        if {"began", "why"} <= set(ended) and all("name" in one for one in victims):
            return result
    except OSError as error:
        cure = "check its rights"
        raise RunLogError(at(path, f"cannot be read: {reason(error)}", cure)) from error
    except (ValueError, TypeError, KeyError):
        pass
    raise RunLogError(at(path, "is no result", "write it anew: usarsim mission score --write"))
