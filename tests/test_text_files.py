"""Text files as editors save them: with a byte order mark, in UTF-16, in another encoding."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import pytest
from linehash import Stored

from usarsim_bench.figures import BenchError
from usarsim_conformance.command import _read as read_report
from usarsim_conformance.report import Report, as_json
from usarsim_doctor.robot_page import head_comment
from usarsim_exploration.mresim.team import read_team as read_mresim_team
from usarsim_mission.match.team import read_team
from usarsim_mission.scenario.reader import find_mission, read_scenario
from usarsim_operator.roles import Role
from usarsim_operator.tokens import kept_tokens
from usarsim_record.recording import RecordError
from usarsim_record.recording import read as read_recording
from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.files import data_directory
from usarsim_server.base.private import secret
from usarsim_server.base.toml import read_toml
from usarsim_server.options import load_settings
from usarsim_server.worlds.loader import load_world
from usarsim_server.worlds.scene import build_scene
from usarsim_study.assignment import read_allocation
from usarsim_study.study_file import find_study, read_study

ROBOT = (data_directory("robots") / "P3AT.toml").read_text(encoding="utf-8")
RECORDING = '{"usarsim_recording": 1, "taken": "2026", "links": [{"listen": 1, "to": "h:2"}]}\n'
TOKENS = "".join(f'{role.value} = "{role.value}-0123456789abcdef"\n' for role in Role)
REPORT = as_json(
    Report(
        name="a",
        server={},
        taken=datetime(2026, 1, 1),
        seconds=0.0,
        dialects=(),
        rules=(),
        results=(),
    )
)
MRESIM = """\
1 ComStation 388 298 0 0 60 1000 BaseStation 1 0
2 Rex 389 298 1.57 20 60 1000 Relay 1 3
"""


def token(path: Path) -> object:
    """A file with one token."""
    path.chmod(0o600)
    return secret(str(path))


def private(path: Path) -> object:
    """A file of tokens, which others may not read."""
    path.chmod(0o600)
    return kept_tokens(path)


def world(path: Path) -> object:
    """A world whose `world.toml` this is."""
    folder = path.with_name("yard")
    shutil.copytree(data_directory("worlds") / "arena", folder, dirs_exist_ok=True)
    path.replace(folder / "world.toml")
    return load_world(folder)


def scene(path: Path) -> object:
    """A world whose `scene.xml` this is."""
    folder = path.with_name("yard")
    shutil.copytree(data_directory("worlds") / "empty", folder, dirs_exist_ok=True)
    path.replace(folder / "scene.xml")
    return build_scene(load_world(folder))


FILES: dict[str, tuple[str, Callable[[Path], object]]] = {
    "settings": ('world = "arena"\n', lambda path: load_settings({}, path)),
    "team": ('name = "A"\npolicy = "hold"\n', read_team),
    "mission": (find_mission("arena-search").read_text(encoding="utf-8"), read_scenario),
    "robot": (ROBOT, lambda path: read_toml(path, UsarsimError)),
    "robot page": ("# It rolls.\n", head_comment),
    "world": (
        (data_directory("worlds") / "arena" / "world.toml").read_text(encoding="utf-8"),
        world,
    ),
    "scene": (
        (data_directory("worlds") / "empty" / "scene.xml").read_text(encoding="utf-8"),
        scene,
    ),
    "token": ("0123456789abcdef\n", token),
    "recording": (RECORDING, read_recording),
    "stored hashes": ('{"environment": {}, "hashes": {}}', Stored.read),
    "list of assignments": ("number,trial,condition,layout\n1,1,a,b\n", read_allocation),
    "team of MRESim": (MRESIM, read_mresim_team),
    "report of the kit": (REPORT, read_report),
    "tokens": (TOKENS, private),
    "study": (
        find_study("rsarsim").read_text(encoding="utf-8"),
        lambda path: read_study(path, path.parent),
    ),
}
"""What users write or edit, and what reads it."""


@pytest.mark.parametrize("kind", FILES)
def test_a_byte_order_mark_is_skipped(kind: str, tmp_path: Path) -> None:
    """Notepad and Excel begin each file of UTF-8 with it; ends of lines are CR LF."""
    text, read = FILES[kind]
    path = tmp_path / "saved"
    path.write_bytes(text.encode("utf-8-sig").replace(b"\n", b"\r\n"))
    read(path)


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("codec", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_one_error(kind: str, codec: str, tmp_path: Path) -> None:
    """It names the file and the cure."""
    text, read = FILES[kind]
    path = tmp_path / "saved"
    mark = "\ufeff" if codec != "utf-16" else ""
    path.write_bytes((mark + text).encode(codec))
    with pytest.raises((UsarsimError, BenchError, RecordError)) as caught:
        read(path)
    assert "is in UTF-16 (save the file as UTF-8)" in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize("kind", FILES)
def test_other_encodings_are_one_error(kind: str, tmp_path: Path) -> None:
    """It names the file, the line and the cure."""
    text, read = FILES[kind]
    path = tmp_path / "saved"
    path.write_bytes(text.encode() + b"# gr\xfcn\n")
    with pytest.raises((UsarsimError, BenchError, RecordError)) as caught:
        read(path)
    line = text.count("\n") + 1
    assert f"line {line}: byte 0xFC is not UTF-8 (save the file as UTF-8)" in str(caught.value)
    assert str(tmp_path) in str(caught.value)
