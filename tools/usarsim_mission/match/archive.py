"""The archive of a run: one ZIP with all that is needed to score it again, the same every time."""

from __future__ import annotations

import zipfile
from pathlib import Path

from usarsim_mission.errors import RunLogError
from usarsim_server.base.errors import at
from usarsim_server.base.files import check_links, reason

ARCHIVE = "run.zip"
_TIME = (1980, 1, 1, 0, 0, 0)
"""Of all members: equal runs make equal archives."""


def write_archive(folder: Path) -> Path:
    """Pack a run into `run.zip` in its folder; returns it.

    Raises:
        RunLogError: it cannot be written.
    """
    check_links(folder, RunLogError)
    path = folder / ARCHIVE
    members = sorted(
        one
        for one in folder.rglob("*")
        if one.is_file() and one != path and not one.name.startswith(".")
    )
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
            for one in members:
                about = zipfile.ZipInfo(one.relative_to(folder).as_posix(), _TIME)
                about.compress_type = zipfile.ZIP_DEFLATED
                file.writestr(about, one.read_bytes())
    except OSError as error:
        raise RunLogError(
            at(path, f"cannot be written: {reason(error)}", "make room on the disk")
        ) from error
    return path
