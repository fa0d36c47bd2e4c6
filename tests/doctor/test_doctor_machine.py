"""The machine: where a warning begins, who keeps it busy, who has the ports."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from usarsim_doctor.checks import machine as system
from usarsim_doctor.checks.machine import (
    Activity,
    judge_activity,
    judge_cores,
    judge_descriptors,
    judge_memory,
)
from usarsim_doctor.checks.machine import look_at_ports as look
from usarsim_doctor.registry import Context, Finding, Mark
from usarsim_server import processes
from usarsim_server.processes import Process
from usarsim_server.settings import Settings

HERE = Context(Settings(), (("--world", "office"),))
MIB = 1 << 20


def test_one_processor_is_few() -> None:
    """With a single processor fewer pictures are advised; two are enough."""
    finding = judge_cores(1.0, HERE)
    assert finding.mark is Mark.WARNING
    assert finding.cure == "usarsim serve --world office --camera-rate 5"
    assert judge_cores(2.0, HERE).mark is Mark.OK


@pytest.mark.parametrize(
    ("free", "mark"),
    [(300 * MIB, Mark.PROBLEM), (700 * MIB, Mark.WARNING), (2048 * MIB, Mark.OK)],
)
def test_memory_has_two_limits(free: int, mark: Mark) -> None:
    """Below what a server takes is a problem, little above it a warning."""
    finding = judge_memory(free, 4096 * MIB)
    assert finding.mark is mark
    assert (finding.cure is None) is (mark is Mark.OK)
    assert finding.values == {"available_bytes": free, "total_bytes": 4096 * MIB}


def test_a_program_that_keeps_the_machine_busy_is_named() -> None:
    """It is told to stand back by its number; nothing is advised that would end it."""
    busy = judge_activity(Activity(2, 1.1, Process(4242, "blender scene", 1.0)), 1.3)
    assert busy.mark is Mark.WARNING
    assert "1.1 of 2 processors" in busy.text
    assert "blender scene (pid 4242)" in busy.text
    assert (busy.cure or "").endswith("renice -n 19 -p 4242")


def test_many_small_programs_are_nobodys_fault() -> None:
    """Where nobody stands out, a way to look is advised; a little work is no warning."""
    crowd = judge_activity(Activity(8, 4.0, Process(7, "sh", 0.2)), 4.0)
    assert (crowd.mark, crowd.cure) == (Mark.WARNING, "top -o %CPU")
    assert judge_activity(Activity(8, 1.0, Process(7, "sh", 1.0)), 4.0).mark is Mark.OK
    assert judge_activity(Activity(2, 0.0, None), 0.0).mark is Mark.OK


def test_few_descriptors_are_a_warning() -> None:
    """The limit must hold the control connections of the settings and all the rest."""
    assert judge_descriptors(256, 64).mark is Mark.WARNING
    assert judge_descriptors(1024, 64).mark is Mark.OK
    assert judge_descriptors(1024, 1024).cure == "ulimit -n 4096"
    assert judge_descriptors(-1, 1024).mark is Mark.OK


SIDE_PORTS = (
    *("image_port", "groundtruth_port", "wireless_port", "truth_port", "comserver_port"),
    "scene_port",
)


def quiet_port(first: int) -> socket.socket:
    """A listening socket on a port that no program gets which asks for any free one."""
    for number in range(first, first + 1000):
        try:
            return socket.create_server(("127.0.0.1", number))
        except OSError:
            continue
    raise AssertionError("no port is free")


@pytest.fixture
def taken() -> Iterator[int]:
    """A port that this process listens on."""
    with quiet_port(21000) as listening:
        yield listening.getsockname()[1]


def seen(given: tuple[tuple[str, str], ...] = (), **settings: object) -> dict[str, Finding]:
    """Findings by option, for settings whose other ports are any or off."""
    ports: dict[str, object] = {"port": 0, **dict.fromkeys(SIDE_PORTS)}
    context = Context(Settings(**{**ports, **settings}), given)  # type: ignore[arg-type]
    return {str(finding.values.get("option", "")): finding for finding in look(context)}


def test_free_ports_are_free_and_others_off() -> None:
    """A port that can be opened is ok, one that is switched off a note, and all of them appear."""
    found = seen()
    assert found["--port"].mark is Mark.OK
    assert {one.mark for option, one in found.items() if option != "--port"} == {Mark.NOTE}
    assert set(found) == {"--port", *(f"--{key.replace('_', '-')}" for key in SIDE_PORTS)}


def test_a_taken_control_port_is_a_problem_with_its_process(taken: int) -> None:
    """Who has it is named by its number, and another port that is free is advised."""
    finding = seen((("--world", "office"), ("--port", str(taken))), port=taken)["--port"]
    assert finding.mark is Mark.PROBLEM
    assert finding.values["taken_by"] == os.getpid()
    assert "this very program" in finding.text
    assert finding.cure is not None
    command, _, other = finding.cure.rpartition(" ")
    assert command == "usarsim serve --world office --port"
    with socket.create_server(("127.0.0.1", int(other))):
        pass


def test_a_taken_side_port_is_a_warning_unless_asked_for(taken: int) -> None:
    """The server goes on without a port that is a mere default, as `serve` does."""
    default = seen(image_port=taken)["--image-port"]
    assert default.mark is Mark.WARNING
    assert "goes on without" in default.text
    wanted = seen(image_port=taken, written=frozenset({"image_port"}))["--image-port"]
    assert wanted.mark is Mark.PROBLEM


def test_two_services_with_one_port_are_found_out(taken: int) -> None:
    """The second one is told of the first, and one command mends that and everything else."""
    with quiet_port(24000) as free:
        number = free.getsockname()[1]
    found = seen(groundtruth_port=number, truth_port=number, image_port=taken)
    clash, image = found["--truth-port"], found["--image-port"]
    assert found["--groundtruth-port"].mark is Mark.OK
    assert "--groundtruth-port has the same port" in clash.text
    assert clash.cure == image.cure
    assert clash.cure is not None
    words = clash.cure.split()
    assert words[2::2] == ["--image-port", "--truth-port"]
    assert len({str(number), str(taken), *words[3::2]}) == 4


def test_a_host_of_another_machine_is_one_problem() -> None:
    """An address that is not ours spoils all ports, and is told once (RFC 5737 example net)."""
    [finding] = look(Context(Settings(host="192.0.2.1", port=0)))
    assert finding.mark is Mark.PROBLEM
    assert "192.0.2.1 is not an address of this machine" in finding.text
    assert finding.advice == "give --host one that is, or 0.0.0.0 for all of them"


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
