"""`usarsim doctor`: options, exit codes, and whole runs on sound and on broken machines."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from usarsim_doctor import examination
from usarsim_doctor.registry import Check, Context, Finding, Mark
from usarsim_server.cli import main

ROOT = Path(__file__).parents[2]
PORTS_OFF = [
    *("--port=0", "--image-port=off", "--groundtruth-port=off", "--wireless-port=off"),
    "--truth-port=off",
]


@pytest.fixture
def marks(monkeypatch: pytest.MonkeyPatch) -> list[Mark]:
    """Stand-ins for the checks: one that finds these marks, and one that is fine."""
    found: list[Mark] = []

    def look(context: Context) -> Iterator[Finding]:
        for mark in found:
            yield Finding("thing", mark, f"port {context.settings.port}", context.serve({}))

    def measure(context: Context) -> Iterator[Finding]:
        yield Finding("rate", Mark.OK, "fast", values={"rate": 5.0})

    checks = (Check("a", "Things", 1, look), Check("b", "Rates", 2, measure))
    monkeypatch.setattr(examination, "all_checks", lambda: checks)
    return found


@pytest.mark.parametrize(
    ("found", "code"),
    [
        ([], 0),
        ([Mark.OK, Mark.NOTE], 0),
        ([Mark.WARNING, Mark.OK], 0),
        ([Mark.PROBLEM, Mark.OK], 1),
    ],
)
def test_only_problems_make_the_exit_code_1(
    found: list[Mark], code: int, marks: list[Mark], capsys: pytest.CaptureFixture[str]
) -> None:
    """Warnings are allowed: a server that runs, if not well, is exit code 0."""
    marks.extend(found)
    assert main(["doctor"]) == code
    assert ("can run the server" in capsys.readouterr().out) is (code == 0)


def test_a_report_for_machines_is_all_there_is_on_standard_output(
    marks: list[Mark], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """`--json -` prints JSON only; `--json FILE` writes the same beside the table."""
    marks.append(Mark.PROBLEM)
    assert main(["doctor", "--json", "-"]) == 1
    alone = json.loads(capsys.readouterr().out)
    file = tmp_path / "report.json"
    assert main(["doctor", "--json", str(file)]) == 1
    assert "Things\n" in capsys.readouterr().out
    beside = json.loads(file.read_text())
    assert {**alone, "taken": 0} == {**beside, "taken": 0}
    assert alone["can_run"] is False


def test_a_pipe_gets_no_colours(marks: list[Mark], capsys: pytest.CaptureFixture[str]) -> None:
    """Escape sequences are for terminals."""
    marks.append(Mark.WARNING)
    main(["doctor"])
    assert "\x1b" not in capsys.readouterr().out


def test_options_are_those_of_serve(
    marks: list[Mark], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The file and the options reach the checks, and the commands that these advise."""
    config = tmp_path / "lab.toml"
    config.write_text("port = 4000\n")
    marks.append(Mark.WARNING)
    main(["doctor", "--config", str(config), "--world", "office"])
    out = capsys.readouterr().out
    assert "port 4000" in out
    assert f"usarsim serve --config {config} --world office\n" in out


def test_bad_options_are_exit_code_2(
    marks: list[Mark], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """As with `serve`: one error line, and nothing is examined."""
    assert main(["doctor", "--port", "70000"]) == 2
    assert capsys.readouterr().err.startswith("error: --port: 70000 is out of range")
    with pytest.raises(SystemExit) as caught:
        main(["doctor", "--fast"])
    assert caught.value.code == 2
    assert main(["doctor", "--json", str(tmp_path / "no/such/file")]) == 2
    assert "cannot be written" in capsys.readouterr().err


def examined(
    *arguments: str, alone: bool = False, libraries: Path | None = None
) -> tuple[int, dict[str, dict[str, Any]]]:
    """Run the real thing; its exit code, and its findings by check and subject.

    Args:
        arguments: of the command.
        alone: without the other commands.
        libraries: folder whose modules hide the installed ones.
    """
    paths = [
        str(libraries) if libraries else "",
        str(ROOT),
        str(ROOT / "tools"),
        os.environ.get("PYTHONPATH", ""),
    ]
    module = ["usarsim_doctor.command"] if alone else ["usarsim_server", "doctor"]
    command = [sys.executable, "-m", *module, *arguments, "--json", "-"]
    done = subprocess.run(
        [*command, "--world", "empty", "--renderer", "rays"],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        check=False,
    )
    assert "Traceback" not in done.stderr
    document = json.loads(done.stdout)
    findings = {
        f"{section['key']}/{finding['subject']}": finding
        for section in document["checks"]
        for finding in section["findings"]
    }
    return done.returncode, findings


@pytest.mark.slow
def test_a_taken_port_is_found_with_its_process() -> None:
    """The whole command, and a program beside it that listens: its number, and exit code 1."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        number = listening.getsockname()[1]
        ports = [f"--port={number}", *PORTS_OFF[1:]]
        code, findings = examined(*ports)
    assert code == 1
    finding = findings[f"ports/{number}"]
    assert finding["mark"] == "problem"
    assert finding["values"]["taken_by"] == os.getpid()
    assert f"(pid {os.getpid()})" in finding["text"]
    assert finding["cure"].startswith("usarsim serve --world empty --image-port off")
    assert findings["server/start"]["mark"] == "ok"
    assert findings["versions/mujoco"]["mark"] == "ok"
    assert "arena" in findings["files/worlds"]["text"]


@pytest.mark.slow
def test_broken_libraries_are_lines_of_the_report(tmp_path: Path) -> None:
    """One kills its process, one raises: each is a problem with a command, all else goes on."""
    (tmp_path / "embreex.py").write_text(f"import os; os.kill(os.getpid(), {signal.SIGKILL:d})\n")
    (tmp_path / "numpy.py").write_text("raise ImportError('built for another processor')\n")
    code, findings = examined(*PORTS_OFF, alone=True, libraries=tmp_path)
    assert code == 1
    embreex, numpy = findings["versions/embreex"], findings["versions/numpy"]
    assert embreex["text"] == "cannot be imported: the process was ended by SIGKILL"
    assert "--force-reinstall" in embreex["cure"]
    assert "built for another processor" in numpy["text"]
    assert findings["versions/pillow"]["mark"] == "ok"
    assert findings["files/worlds and robots"]["mark"] == "warning"
    assert findings["server/start"]["mark"] == "problem"
    assert findings["ports/any"]["mark"] == "ok"
