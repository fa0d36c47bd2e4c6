"""SIGINT and SIGTERM at many moments of many commands; a second server on the same port."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from signalled import HANG, Ending, signalled
from test_e2e_import import level

from usarsim_server.testing import SIDE_PORTS

PORTS = [f"--{key.replace('_', '-')}=off" for key in SIDE_PORTS] + ["--port=0"]
MOMENTS = (0.0, 0.05, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5)
"""s after the program took over its signals: while it imports modules, loads, runs."""


def check(ending: Ending, code: int) -> None:
    """The program ended soon and quietly, unless it was faster than the signal."""
    assert ending.seconds < HANG
    assert "Traceback" not in ending.errors, ending
    assert ending.early or ending.code == code, ending


@pytest.mark.parametrize("delay", MOMENTS)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_serve_ends_with_code_0(delay: float, number: signal.Signals) -> None:
    """Whenever it is told to."""
    ending = signalled(["serve", "--world", "arena", *PORTS], delay, number)
    assert not ending.early, ending
    check(ending, 0)


@pytest.mark.parametrize("delay", [0.3, 1.0, 3.0])
def test_impatience_changes_nothing(delay: float) -> None:
    """Ctrl-C again and again is one Ctrl-C."""
    check(signalled(["serve", "--world", "empty", *PORTS], delay, times=4), 0)


@pytest.mark.parametrize("delay", MOMENTS)
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
@pytest.mark.parametrize("delay", [0.0, 0.3, 1.2])
def test_others_end_with_code_130(
    arguments: list[str], delay: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands that would have ended by themselves say that they were interrupted."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Room.t3d").write_text(level())
    ending = signalled(arguments, delay)
    if ending.code != 130 and not ending.early:  # the signal came behind the last line
        command = [sys.executable, "-m", "usarsim_server", *arguments]
        whole = subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)
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
        done = subprocess.run(
            [sys.executable, "-m", "usarsim_server", "serve", "--world", "no-such-world"]
            + [one for one in PORTS if not one.startswith(flag)]
            + [flag, str(port)],
            capture_output=True,
            text=True,
            timeout=HANG,
            check=False,
        )
    assert done.returncode == 2
    assert done.stdout == ""
    [line] = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert f"port {port} is already in use" in line
    assert f"(pid {os.getpid()})" in line, "the program that has it"
    assert f"{flag} N" in line


def test_clients_wait_for_the_world() -> None:
    """The port is open before the world is loaded; who comes so early is greeted afterwards."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    off = [one for one in PORTS if not one.startswith("--port")]
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
