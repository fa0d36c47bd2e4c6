"""The `usarsim` command: subcommands found by file, errors in one line, exit codes."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import usarsim_server
from usarsim_server import cli
from usarsim_server.base.errors import WorldError
from usarsim_server.cli import build_parser, main
from usarsim_server.options import OPTIONS
from usarsim_server.settings import Settings


@pytest.fixture
def app(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A stand-in for the server; `app.seen` lists the settings that it was run with."""
    module = ModuleType("usarsim_server.app")
    module.seen = []

    def run(settings: Settings) -> int:
        module.seen.append(settings)
        return module.act()

    module.run = run
    module.act = lambda: 0
    monkeypatch.setitem(sys.modules, "usarsim_server.app", module)
    monkeypatch.setattr(usarsim_server, "app", module, raising=False)
    monkeypatch.setattr("usarsim_server.base.logs.configure", lambda level: None)
    return module


def commands() -> dict[str, argparse.ArgumentParser]:
    """The parsers of all subcommands by name."""
    [action] = [
        action
        for action in build_parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    ]
    return action.choices


# The command as a whole


def test_each_file_with_a_parser_is_a_subcommand() -> None:
    """Subcommands are found by their files; helpers of the folder are none."""
    assert {"serve", "worlds", "robots"} <= set(commands())
    assert not {"common", "__main__"} & set(commands())


def test_new_file_is_a_new_subcommand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Dropping a file into the folder is all it takes to add a command."""
    (tmp_path / "greet.py").write_text(
        '"""`usarsim greet`: say hello."""\n'
        "from usarsim_server.cli.common import add_command\n"
        "def add_parser(subparsers):\n"
        "    add_command(subparsers, 'greet', 'say hello', run)\n"
        "def run(arguments):\n"
        "    print('hello')\n"
        "    return 3\n"
    )
    monkeypatch.setattr(cli, "__path__", [*cli.__path__, str(tmp_path)])
    try:
        assert main(["greet"]) == 3
    finally:
        sys.modules.pop("usarsim_server.cli.greet", None)
        vars(cli).pop("greet", None)
    assert capsys.readouterr().out == "hello\n"


@pytest.mark.parametrize("name", ["serve", "worlds", "robots"])
def test_every_subcommand_explains_itself(name: str, capsys) -> None:
    """`--help` of each command ends with code 0 and a description."""
    with pytest.raises(SystemExit) as caught:
        main([name, "--help"])
    assert caught.value.code == 0
    assert f"usage: usarsim {name}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("serv", "usarsim: unknown command 'serv' (did you mean serve?)"),
        ("xyzzy", "usarsim: unknown command 'xyzzy' (known are "),
        ("--wrld", "usarsim: the following arguments are required: COMMAND (see usarsim --help)"),
        ("help serv", "usarsim: unknown command 'serv' (did you mean serve?)"),
        ("serve --fast", "usarsim serve: unknown option --fast (see usarsim serve --help)"),
        ("serve --por 1", "usarsim serve: unknown option --por (did you mean --port?)"),
        ("serve --wrld=a", "usarsim serve: unknown option --wrld (did you mean --world?)"),
        ("serve --port", "usarsim serve: argument --port: expected one argument (see "),
        ("worlds a b", "usarsim worlds: too many words: b (see usarsim worlds --help)"),
        ("mission rum", "usarsim mission: unknown command 'rum' (did you mean run?)"),
        ("mission list --sed 1", "usarsim mission list: unknown option --sed"),
        ("mission league a --mission mission -x", "usarsim mission league: unknown option"),
    ],
)
def test_a_wrong_line_is_one_line_with_a_cure(line: str, told: str, capsys) -> None:
    """An unknown command or option, at any depth: the nearest one is named; exit code 2."""
    with pytest.raises(SystemExit) as caught:
        main(line.split())
    assert caught.value.code == 2
    out, err = capsys.readouterr()
    assert not out
    assert err.startswith(f"error: {told}"), err
    assert err.count("\n") == 1


@pytest.mark.parametrize("line", ["", "help", "--help"])
def test_the_overview_names_every_command_once(line: str, capsys) -> None:
    """`usarsim` alone says what to type first, and shows all commands in groups."""
    with pytest.raises(SystemExit) as caught:
        main(line.split())
    assert caught.value.code == 0
    first, _, listed = capsys.readouterr().out.partition("\nTry and look\n")
    assert "usarsim serve" in first
    names = [row.split()[0] for row in listed.splitlines() if row.startswith("  ")]
    assert sorted(name for name in names if not name.startswith("-")) == sorted(commands())
    assert "More" not in listed


@pytest.mark.parametrize("option", ["--version", "-V"])
def test_version_is_that_of_the_package(option: str, capsys) -> None:
    """`usarsim --version` prints one line with the version."""
    with pytest.raises(SystemExit):
        main([option])
    assert capsys.readouterr().out == f"usarsim-server {usarsim_server.__version__}\n"


def test_user_error_is_one_line_and_exit_code_2(app: ModuleType, capsys) -> None:
    """An error that a user can mend is one `error:` line on standard error, no traceback."""

    def act() -> int:
        raise WorldError("yard: no such world (known: arena)")

    app.act = act
    assert main(["serve", "--port", "0"]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "error: yard: no such world (known: arena)\n")


def test_defect_is_not_hidden(app: ModuleType) -> None:
    """An exception that is not meant for users keeps its traceback."""

    def act() -> int:
        raise ZeroDivisionError

    app.act = act
    with pytest.raises(ZeroDivisionError):
        main(["serve", "--port", "0"])


def test_interrupted_listing_has_the_code_of_the_shell(monkeypatch) -> None:
    """Ctrl-C in a command that is no server ends it with 130 and without traceback."""

    def interrupt(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("usarsim_server.robots.catalog.load_catalog", interrupt)
    assert main(["robots"]) == 130


def test_command_line_runs_as_a_module_and_survives_a_closed_pipe() -> None:
    """`python -m usarsim_server robots | true` is no error and prints no traceback."""
    reader, writer = os.pipe()
    os.close(reader)
    found = [str(Path(cli.__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, found))}
    done = subprocess.run(
        [sys.executable, "-m", "usarsim_server", "robots"],
        stdout=writer,
        stderr=subprocess.PIPE,
        env=environment,
        timeout=300,
        check=False,
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")


# serve


def test_serve_runs_the_server_with_its_settings(app: ModuleType) -> None:
    """The exit code is the server's, the settings are those of the command line."""
    app.act = lambda: 7
    assert main(["serve", "--port", "0", "--speed", "max"]) == 7
    [settings] = app.seen
    assert settings.port == 0
    assert settings.speed == float("inf")


def test_serve_sets_the_log_level_first(app: ModuleType, monkeypatch) -> None:
    """The level is in force before the world is loaded."""
    levels = []
    monkeypatch.setattr("usarsim_server.base.logs.configure", levels.append)
    app.act = lambda: len(levels)
    assert main(["serve", "--port", "0", "--log-level", "debug"]) == 1
    assert levels == ["debug"]


def test_bad_settings_are_exit_code_2(app: ModuleType, tmp_path: Path, capsys) -> None:
    """A bad option or a bad file is one error line, and no server is made."""
    assert main(["serve", "--port", "70000"]) == 2
    assert capsys.readouterr().err.startswith("error: --port: 70000 is out of range")
    config = tmp_path / "lab.toml"
    config.write_text("spede = 1\n")
    assert main(["serve", "--config", str(config)]) == 2
    assert capsys.readouterr().err == (
        f"error: {config}: line 1: spede: unknown key (did you mean speed?)\n"
    )
    assert app.seen == []


def test_serve_gives_the_signal_handler_back(app: ModuleType) -> None:
    """A program that embeds the command finds its own SIGTERM handler afterwards."""

    def mine(number: int, frame: object) -> None:
        pass

    before = signal.signal(signal.SIGTERM, mine)
    try:
        assert main(["serve", "--port", "0"]) == 0
        assert signal.getsignal(signal.SIGTERM) is mine
    finally:
        signal.signal(signal.SIGTERM, before)


def test_help_of_serve_names_every_option_with_its_default(capsys) -> None:
    """The help is made from the table of settings and mentions what only the file can set."""
    with pytest.raises(SystemExit):
        main(["serve", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    for option in OPTIONS:
        assert (option.flag if option.metavar else option.key) in text
    assert "port of robot control (default 3000)" in text
    assert "port of the older wireless simulation (default off)" in text
