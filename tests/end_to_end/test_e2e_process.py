"""The `usarsim serve` process: READY, ports, signals, exit codes.

SIGINT and SIGTERM at many moments of many commands; a second server on the same port.
"""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from held_ports import held_port
from lanes import slow_but
from signalled import HANG, Ending, finished, signalled
from test_e2e_import import level

from usarsim_server.testing import SIDE_PORTS, ServerProcess


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_cleanly(number: signal.Signals) -> None:
    """SIGINT and SIGTERM end it with code 0, one line on stdout, no traceback."""
    with ServerProcess("--world", "empty") as server:
        assert re.search(r"^READY control=127\.0\.0\.1:\d+$", server.errors, re.MULTILINE)
        client = server.client()
        client.send("INIT {ClassName P3AT} {Location 0,0,-0.3}")
        client.wait_for("STA")
        assert server.end(number) == 0
        assert server.line() == "", "no more on standard output"
        assert "Traceback" not in server.errors


def test_a_busy_control_port_is_one_clear_error() -> None:
    """A taken control port ends it with code 2 and one line that names port and cure."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = finished("serve", "--world", "empty", "--port", str(port))
    assert result.returncode == 2
    assert result.stdout == ""
    errors = [line for line in result.stderr.splitlines() if line.startswith("error:")]
    assert len(errors) == 1
    assert str(port) in errors[0]
    assert "--port" in errors[0]


@pytest.mark.parametrize(
    ("arguments", "named"),
    slow_but(
        lambda case: case[1] in {"--speed", "no-such-world"},
        [
            (["--speed", "backwards"], "--speed"),
            (["--dialect", "klingon"], "--dialect"),
            (["--max-robots", "9999"], "--max-robots"),
            (["--world", "no-such-world"], "no-such-world"),
            (["--robots", "/no/such/folder"], "/no/such/folder"),
            (["--timestep", "0"], "--timestep"),
        ],
    ),
)
def test_bad_options_are_one_clear_error(arguments: list[str], named: str) -> None:
    """A wrong option ends it with code 2 and a line that names it, without a traceback."""
    result = finished("serve", "--world", "empty", *PORTS, *arguments)
    assert result.returncode == 2
    assert named in result.stderr
    assert "Traceback" not in result.stderr


def test_a_bad_robot_file_is_one_clear_error(tmp_path: Path) -> None:
    """A robot file that cannot be used ends it with code 2 and names file, key and cure."""
    (tmp_path / "Broken.toml").write_text(
        'name = "Broken"\nextends = "P2AT"\nkind = "hovercraft"\n'
    )
    result = finished("serve", "--world", "empty", "--robots", str(tmp_path), "--port", "0")
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


@pytest.mark.slow
def test_robots_of_a_user(tmp_path: Path) -> None:
    """A file in the folder of --robots adds a class that can be spawned by its name."""
    (tmp_path / "MyRover.toml").write_text('name = "MyRover"\nextends = "P3AT"\n')
    with ServerProcess("--world", "empty", "--robots", str(tmp_path)) as server:
        client = server.client()
        client.send("INIT {ClassName USARBot.myrover}\r\nGETGEO {Type Robot}")
        assert "{Name MyRover}" in client.wait_for("GEO")


@pytest.mark.slow
def test_it_ends_cleanly_with_busy_robots() -> None:
    """A server full of sensing robots ends with code 0: no thread is left inside native code."""
    for _ in range(2):
        with ServerProcess("--world", "arena", "--max-robots", "32") as server:
            clients = [server.client() for _ in range(16)]
            for index, client in enumerate(clients):
                client.send(f"INIT {{ClassName P3AT}} {{Start RobotStart{index % 16 + 1}}}")
            for client in clients:
                client.wait_for("SEN")
            assert server.end() == 0, server.errors


PORTS = [f"--{key.replace('_', '-')}=off" for key in SIDE_PORTS] + ["--port=0"]
MOMENTS = (0.0, 0.05, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5)
"""s after the program took over its signals: while it imports modules, loads, runs."""


def check(ending: Ending, code: int) -> None:
    """The program ended soon and quietly, unless it was faster than the signal."""
    assert ending.seconds < HANG
    assert "Traceback" not in ending.errors, ending
    assert ending.early or ending.code == code, ending


@pytest.mark.parametrize(
    ("delay", "number"),
    slow_but(
        lambda case: case[0] in MOMENTS[::3],
        [(delay, (signal.SIGINT, signal.SIGTERM)[n % 2]) for n, delay in enumerate(MOMENTS)],
    ),
)
def test_serve_ends_with_code_0(delay: float, number: signal.Signals) -> None:
    """Whenever it is told to, by one signal or the other."""
    ending = signalled(["serve", "--world", "arena", *PORTS], delay, number)
    assert not ending.early, ending
    check(ending, 0)


@pytest.mark.slow
@pytest.mark.parametrize("delay", slow_but((1.0).__eq__, [0.3, 1.0, 3.0]))
def test_impatience_changes_nothing(delay: float) -> None:
    """Ctrl-C again and again is one Ctrl-C."""
    check(signalled(["serve", "--world", "empty", *PORTS], delay, times=4), 0)


@pytest.mark.slow
@pytest.mark.parametrize("delay", slow_but(MOMENTS[::3].__contains__, MOMENTS))
def test_serving_a_map_ends_with_code_0(
    delay: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also while the map is imported."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "Room.t3d").write_text(level())
    check(signalled(["serve", "--world", str(tmp_path / "Room.t3d"), *PORTS], delay), 0)


@pytest.mark.parametrize(
    "arguments",
    [
        ["import", "Room.t3d", "--out", "out", "--fresh", "--preview"],
        ["bench", "quick"],
        ["conformance", "--self"],
        ["worlds"],
        ["snapshot", "--world", "arena", "arena.png"],
        ["robots", "--page", "page"],
        ["doctor"],
        ["replay", "no.rec"],
    ],
    ids=lambda arguments: arguments[0],
)
@pytest.mark.parametrize("delay", slow_but((0.3).__eq__, [0.0, 0.3, 1.2]))
def test_others_end_with_code_130(
    arguments: list[str], delay: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands that would have ended by themselves say that they were interrupted."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Room.t3d").write_text(level())
    ending = signalled(arguments, delay)
    if ending.code != 130 and not ending.early:  # the signal came behind the last line
        whole = finished(*arguments)
        told = whole.returncode, whole.stdout, whole.stderr
        assert (ending.code, ending.output, ending.errors) == told
    else:
        check(ending, 130)
    assert not list(tmp_path.glob("cache/usarsim/imports/.new-*")), "left behind"


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.2])
def test_record_ends_with_code_0(delay: float, tmp_path: Path) -> None:
    """A signal is how a recording ends."""
    check(
        signalled(["record", str(tmp_path / "a"), "--listen", "0", "--to", "127.0.0.1:9"], delay), 0
    )


@pytest.mark.parametrize("flag", ["--port", "--image-port", "--wireless-port"])
def test_a_second_server_says_so_before_it_loads(flag: str, tmp_path: Path) -> None:
    """The port, the program that has it and the cure; the world is not even looked for."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        others = [one for one in PORTS if not one.startswith(flag)]
        done = finished("serve", "--world", "no-such-world", *others, flag, str(port))
    assert done.returncode == 2
    assert done.stdout == ""
    [line] = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert f"port {port} is already in use" in line
    assert f"(pid {os.getpid()})" in line, "the program that has it"
    assert f"{flag} N" in line


@pytest.mark.slow
def test_clients_wait_for_the_world() -> None:
    """The port is open before the world is loaded; who comes so early is greeted afterwards."""
    off = [one for one in PORTS if not one.startswith("--port")]
    with held_port() as port:
        process = subprocess.Popen(
            [sys.executable, "-m", "usarsim_server", "serve", *off, f"--port={port}"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            while (client := socket.socket()).connect_ex(("127.0.0.1", port)):
                client.close()
                assert process.poll() is None
                time.sleep(0.01)
            with client:
                client.settimeout(HANG)
                assert client.recv(1000).startswith(b"NFO {Gametype")
            assert process.stdout is not None
            assert process.stdout.readline().startswith("READY control=")
        finally:
            process.kill()
            process.communicate()
