"""Who listens on a port, who keeps the machine busy, what the container leaves of it."""

from __future__ import annotations

import os
import socket
from pathlib import Path
from types import SimpleNamespace

import pytest

from usarsim_server import processes
from usarsim_server.doctor.checks import machine as system

NET_TCP = """\
  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:0BB8 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 4711 1
   1: 0100007F:0BB8 0100007F:CAFE 01 00000000:00000000 00:00000000 00000000     0        0 4712 1
   2: 0100007F:138B 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 4713 1
"""


@pytest.fixture
def proc(tmp_path: Path) -> Path:
    """A machine with two programs: 77 listens on port 3000, 78 has a connection to it."""
    (tmp_path / "net").mkdir()
    (tmp_path / "net/tcp").write_text(NET_TCP)
    for pid, inode, words in ((77, 4711, "/usr/bin/nc\0-l\x003000\0"), (78, 4712, "")):
        folder = tmp_path / str(pid)
        (folder / "fd").mkdir(parents=True)
        (folder / "fd/3").symlink_to(f"socket:[{inode}]")
        (folder / "cmdline").write_text(words)
        (folder / "comm").write_text("client\n")
    return tmp_path


def test_the_listener_of_a_port_is_named(proc: Path) -> None:
    """The program that listens is found by its socket, not the one that is connected."""
    owner = processes.port_owner(3000, proc)
    assert owner is not None
    assert owner.process == processes.Process(77, "nc -l 3000")
    assert owner.user == "root"


def test_a_listener_that_may_not_be_seen_has_a_user(proc: Path) -> None:
    """Where no program shows the socket, the table still tells whose it is; or there is nobody."""
    assert processes.port_owner(5003, proc) == processes.Owner(None, "root")
    assert processes.port_owner(51966, proc) is None


def test_our_own_socket_is_found() -> None:
    """In the real `/proc` a port of this process leads to this process."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        owner = processes.port_owner(listening.getsockname()[1])
    assert owner is not None
    assert owner.process is not None
    assert owner.process.pid == os.getpid()


def test_activity_is_the_difference_of_two_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two processors one was busy, nearly all of it with the program that is named."""
    me = os.getpid()
    looks = iter([{me: 1.0, 55: 0.1, 60: 2.0}, {me: 9.0, 55: 0.55, 60: 2.1, 61: 5.0}])
    monkeypatch.setattr(system, "_spent", lambda: next(looks))
    monkeypatch.setattr("psutil.cpu_count", lambda: 2)
    monkeypatch.setattr("psutil.cpu_percent", lambda seconds: 50.0)
    monkeypatch.setattr(system, "name", lambda proc, pid: f"program {pid}")
    seen = system.activity(0.5)
    assert (seen.processors, seen.busy) == (2, 1.0)
    assert seen.busiest is not None
    assert (seen.busiest.pid, seen.busiest.name) == (55, "program 55")
    assert seen.busiest.cores == pytest.approx(0.9)


def test_a_real_program_is_seen() -> None:
    """The parent of this process is among those that are watched."""
    assert os.getppid() in system._spent()
    assert system.activity(0.05).processors == os.cpu_count()


@pytest.mark.parametrize(
    ("file", "text", "most"),
    [
        ("cpu.max", "50000 100000\n", 0.5),
        ("cpu.max", "max 100000\n", None),
        ("cpu/cpu.cfs_quota_us", "25000\n", 0.25),
        ("cpu/cpu.cfs_quota_us", "-1\n", None),
    ],
)
def test_processors_are_bounded_by_the_container(
    file: str, text: str, most: float | None, tmp_path: Path
) -> None:
    """Both versions of control groups are understood; without a quota the affinity decides."""
    (tmp_path / "cpu").mkdir()
    (tmp_path / "cpu/cpu.cfs_period_us").write_text("100000\n")
    (tmp_path / file).write_text(text)
    assert system.cores(tmp_path) == (most or len(os.sched_getaffinity(0)))


def test_memory_is_bounded_by_the_container(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the container may still take counts, caches that would be given up do not."""
    memory = SimpleNamespace(available=6000 * 1024, total=8000 * 1024)
    monkeypatch.setattr("psutil.virtual_memory", lambda: memory)
    assert system.available_memory(tmp_path) == (6000 * 1024, 8000 * 1024)
    (tmp_path / "memory.max").write_text("4096000\n")
    (tmp_path / "memory.current").write_text("3000000\n")
    (tmp_path / "memory.stat").write_text("anon 5\ninactive_file 1000000\n")
    assert system.available_memory(tmp_path) == (2096000, 4096000)
