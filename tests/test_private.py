"""Files that are nobody else's business have mode 0600; tokens stay out of command lines."""

from __future__ import annotations

import ast
import stat
from pathlib import Path
from typing import Any

import pytest

import usarsim_server
from usarsim_operator.recording import Writer
from usarsim_operator.tokens import kept_tokens
from usarsim_record import record_command
from usarsim_server.base.errors import SettingsError, UsarsimError
from usarsim_server.base.files import write_text
from usarsim_server.base.private import secret
from usarsim_server.cli import main
from usarsim_server.options import load_settings
from usarsim_study.folder import append_form

TOKEN = "0123456789abcdef"


def mode(path: Path) -> int:
    """Who may do what."""
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize("rights", [0o644, 0o640, 0o604, 0o660])
def test_a_token_that_others_read_is_refused(rights: int, tmp_path: Path) -> None:
    """By `serve`, its settings file, `watch` and `console`; the error names the cure."""
    path = tmp_path / "token"
    path.write_text(TOKEN)
    path.chmod(rights)
    told = rf"others may read this token \(chmod 600 {path}\)"
    with pytest.raises(UsarsimError, match=told):
        secret(str(path))
    for given in (str(path), "token"):
        sheet = tmp_path / "lab.toml"
        sheet.write_text(f'scene_port = 0\nscene_token = "{given}"\n')
        with pytest.raises(SettingsError, match=told):
            load_settings({}, sheet)
    path.chmod(0o600)
    assert secret(str(path)) == load_settings({}, sheet).scene_token == TOKEN


def test_a_token_may_be_a_text() -> None:
    """What is no file is the token itself."""
    assert secret(f" {TOKEN} ") == TOKEN
    assert secret("") == ""


def test_what_is_secret_or_personal_is_private(tmp_path: Path) -> None:
    """Tokens, recordings of the console, and what people answered, also over an older file."""
    kept_tokens(tmp_path / "tokens")
    Writer(tmp_path / "recording", {})
    append_form(tmp_path / "forms", [{"form": "sus"}])
    (tmp_path / "data").write_text("old")
    (tmp_path / "data").chmod(0o644)
    write_text(tmp_path / "data", "new", private=True)
    assert {one.name: mode(one) for one in tmp_path.iterdir()} == dict.fromkeys(
        ("tokens", "recording", "forms", "data"), 0o600
    )


def test_a_recording_of_a_session_is_private(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What `usarsim record` writes may hold tokens of the scene port."""
    seen: list[int] = []

    async def recorded(links: Any, writer: Any, host: str, fresh: Path, file: Path) -> int:
        seen.append(mode(fresh))
        return 0

    monkeypatch.setattr(record_command, "_record", recorded)
    words = ["--listen", "0", "--to", "127.0.0.1:1", str(tmp_path / "session")]
    assert main(["record", *words]) == 0
    assert seen == [0o600]


def test_no_child_gets_a_token_by_its_command_line() -> None:
    """What programs start beside themselves names a file."""
    root = Path(usarsim_server.__file__).parents[1]
    found = []
    for path in [*root.glob("usarsim_server/**/*.py"), *root.glob("tools/**/*.py")]:
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text if "--scene-token=" in text else "")):
            if isinstance(node, ast.JoinedStr) and "--scene-token=" in ast.unparse(node):
                found.append((path.name, ast.unparse(node)))
    assert found == [("programs.py", "f'--scene-token={secret}'")]
