"""`usarsim study`: its commands, and what they load."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import pytest

from usarsim_server import cli
from usarsim_study.command import COMMANDS
from usarsim_study.study_file import SHIPPED, read_study


def test_help_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    """`usarsim study` alone says what there is."""
    assert cli.main(["study"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in COMMANDS)


def test_list_names_every_shipped_study(capsys: pytest.CaptureFixture[str]) -> None:
    """One line each, with its title."""
    assert cli.main(["study", "list"]) == 0
    heads, *rows = capsys.readouterr().out.splitlines()
    assert heads.split()[0] == "NAME"
    assert [row.split()[0] for row in rows] == [one.stem for one in SHIPPED.glob("*.toml")]
    assert all(read_study(SHIPPED / f"{row.split()[0]}.toml").title in row for row in rows)


def test_only_what_judges_needs_the_extra() -> None:
    """To read the command line and check a study loads neither scipy nor matplotlib."""
    program = (
        "import sys\n"
        "from usarsim_server import cli\n"
        "assert cli.main(['study', 'check', '--without-missions', 'rsarsim']) == 0\n"
        "print(sorted({'scipy', 'matplotlib', 'mujoco'} & set(sys.modules)), file=sys.stderr)"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert told.stderr.strip() == "[]"


@pytest.mark.parametrize("command", [["report", "."], ["power"]])
def test_missing_extra_has_a_cure(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line that names the extra."""
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *more: None if name == "scipy" else real(name)
    )
    assert cli.main(["study", *command]) == 2
    assert "usarsim-server[study]" in capsys.readouterr().err
