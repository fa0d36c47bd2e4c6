"""The `usarsim serve` process: READY, ports, signals, exit codes."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from usarsim_server.testing import PATIENCE, ServerProcess


def _serve(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "usarsim_server.cli", "serve", "--world", "empty", *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_cleanly(number: signal.Signals) -> None:
    """SIGINT and SIGTERM end it with code 0, one line on stdout, no traceback."""
    with ServerProcess("--world", "empty") as server:
        assert re.fullmatch(r"READY control=127\.0\.0\.1:\d+\n", server.ready_line)
        client = server.client()
        client.send("INIT {ClassName P3AT} {Location 0,0,-0.3}")
        client.wait_for("STA")
        server.process.send_signal(number)
        assert server.process.wait(PATIENCE) == 0
        assert server.process.stdout is not None
        assert server.process.stdout.read() == ""
        server.stop()
        assert "Traceback" not in server.errors


def test_a_busy_control_port_is_one_clear_error() -> None:
    """A taken control port ends it with code 2 and one line that names port and cure."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = _serve("--port", str(port))
    assert result.returncode == 2
    assert result.stdout == ""
    errors = [line for line in result.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert str(port) in errors[0]
    assert "--port" in errors[0]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--speed", "backwards"], "--speed"),
        (["--dialect", "klingon"], "--dialect"),
        (["--max-robots", "9999"], "--max-robots"),
        (["--world", "no-such-world"], "no-such-world"),
        (["--robots", "/no/such/folder"], "/no/such/folder"),
        (["--timestep", "0"], "--timestep"),
    ],
)
def test_bad_options_are_one_clear_error(arguments: list[str], named: str) -> None:
    """A wrong option ends it with code 2 and a line that names it, without a traceback."""
    result = _serve(*arguments)
    assert result.returncode == 2
    assert named in result.stderr
    assert "Traceback" not in result.stderr


def test_a_bad_robot_file_is_one_clear_error(tmp_path: Path) -> None:
    """A robot file that cannot be used ends it with code 2 and names file, key and cure."""
    (tmp_path / "Broken.toml").write_text(
        'name = "Broken"\nextends = "P2AT"\nkind = "hovercraft"\n'
    )
    result = _serve("--robots", str(tmp_path), "--port", "0")
    assert result.returncode == 2
    assert "Broken.toml" in result.stderr
    assert "kind" in result.stderr
    assert "Traceback" not in result.stderr


def test_every_option_can_stand_in_the_file(tmp_path: Path) -> None:
    """Settings come from TOML, and the command line wins."""
    config = tmp_path / "lab.toml"
    config.write_text('world = "empty"\nport = 0\ndialect = "udk"\nmax_robots = 2\nseed = 4\n')
    with ServerProcess("--config", str(config)) as server:
        client = server.client()
        client.send("INIT {ClassName P2AT} {Location 0,0,-0.3}")
        assert re.search(r"\{Time \d+\.\d{4}\}", client.wait_for("STA")), "udk: four digits"


def test_robots_of_a_user(tmp_path: Path) -> None:
    """A file in the folder of --robots adds a class that can be spawned by its name."""
    (tmp_path / "MyRover.toml").write_text('name = "MyRover"\nextends = "P3AT"\n')
    with ServerProcess("--world", "empty", "--robots", str(tmp_path)) as server:
        client = server.client()
        client.send("INIT {ClassName USARBot.myrover}\r\nGETGEO {Type Robot}")
        assert "{Name MyRover}" in client.wait_for("GEO")


def test_it_ends_cleanly_with_busy_robots() -> None:
    """A server full of sensing robots ends with code 0: no thread is left inside native code."""
    for _ in range(3):
        with ServerProcess("--world", "arena", "--max-robots", "32") as server:
            clients = [server.client() for _ in range(16)]
            for index, client in enumerate(clients):
                client.send(f"INIT {{ClassName P3AT}} {{Start RobotStart{index % 16 + 1}}}")
            for client in clients:
                client.wait_for("SEN")
            assert server.stop() == 0, server.errors
