"""What Linux says about processes and the machine is read rightly."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import psutil
import pytest

from usarsim_bench import procfs
from usarsim_bench.errors import BenchError
from usarsim_bench.machine import describe_machine
from usarsim_bench.procfs import Usage, busy_seconds, load_between, usage


def look(wall: float, cpu: float, own: float, busy: float | None) -> Usage:
    """A look with some numbers that matter and others that do not."""
    return Usage(wall, cpu, 0, 1, 1, own, busy)


CHILD = """
import threading
stop = threading.Event()
print("ready", flush=True)
input()
file = open("/dev/null")
thread = threading.Thread(target=stop.wait, daemon=True)
thread.start()
print("grown", flush=True)
input()
"""


@pytest.fixture
def child() -> Iterator[subprocess.Popen[str]]:
    """A process that opens a file and starts a thread when it is sent a line."""
    process = subprocess.Popen(
        [sys.executable, "-c", CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process
        process.kill()


class TestUsage:
    def test_agrees_with_psutil(self, child: subprocess.Popen[str]) -> None:
        """Memory, threads, descriptors and processor time are those that psutil finds."""
        process = psutil.Process(child.pid)
        # A fresh interpreter may still gain pages between two looks: ours lies between psutil's.
        least = process.memory_info().rss
        found, times = usage(child.pid), process.cpu_times()
        most = process.memory_info().rss
        assert 0.98 * least <= found.resident <= 1.02 * most
        assert found.threads == process.num_threads()
        assert found.descriptors == process.num_fds()
        assert found.cpu == pytest.approx(times.user + times.system, abs=0.02)

    def test_counts_descriptors_and_threads(self, child: subprocess.Popen[str]) -> None:
        """One file and one thread more are seen as such."""
        before = usage(child.pid)
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write("\n")
        child.stdin.flush()
        assert child.stdout.readline() == "grown\n"
        after = usage(child.pid)
        assert after.descriptors == before.descriptors + 1
        assert after.threads == before.threads + 1

    def test_processor_time_grows_with_work(self) -> None:
        """A tenth of a second of computing is seen, in the process and in the whole machine."""
        before = usage(os.getpid())
        while time.process_time() < before.own_cpu + 0.1:
            pass
        after = usage(os.getpid())
        assert after.cpu - before.cpu >= 0.05
        assert after.own_cpu - before.own_cpu >= 0.1
        assert after.busy is not None
        assert before.busy is not None
        assert after.busy - before.busy >= 0.05

    def test_name_with_blanks_and_parentheses(self, tmp_path: object) -> None:
        """The command name, which may contain anything, does not shift the fields."""
        program = os.path.join(str(tmp_path), "a) b (c")
        os.symlink("/bin/sleep", program)
        process = subprocess.Popen([program, "30"])
        try:
            assert usage(process.pid).threads == 1
        finally:
            process.kill()
            process.wait()

    def test_of_a_process_that_is_gone(self) -> None:
        """A process that ended is an error that names it."""
        process = subprocess.Popen(["true"])
        process.wait()
        with pytest.raises(BenchError, match=f"process {process.pid} is gone"):
            usage(process.pid)

    def test_without_machine_statistics(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A system that hides /proc/stat is no error; the share of others is unknown then."""
        monkeypatch.setattr(procfs, "_busy", lambda: None)
        before = usage(os.getpid())
        time.sleep(0.01)
        assert load_between(before, usage(os.getpid())).others is None


class TestBusySeconds:
    def test_of_a_known_line(self) -> None:
        """Idle and waiting for disks are not work; what guests used is not counted twice."""
        tick = 1.0 / os.sysconf("SC_CLK_TCK")
        line = "cpu  1000 200 300 999999 888888 10 20 30 777 666"
        assert busy_seconds(line) == pytest.approx((1000 + 200 + 300 + 10 + 20 + 30) * tick)


class TestLoad:
    def test_is_divided_among_process_own_and_others(self) -> None:
        """Two cores busy for ten seconds: 6 s, 1 s, and the rest somebody else's."""
        load = load_between(look(0.0, 1.0, 2.0, 100.0), look(10.0, 7.0, 3.0, 120.0))
        assert (load.process, load.own, load.others) == pytest.approx((0.6, 0.1, 1.3))

    def test_others_are_never_negative(self) -> None:
        """Rounding of the kernel's counters does not show as a negative load."""
        assert load_between(look(0.0, 0.0, 0.0, 0.0), look(1.0, 1.0, 0.5, 1.49)).others == 0.0

    def test_needs_two_moments(self) -> None:
        """No time, no load."""
        with pytest.raises(ValueError, match="two moments"):
            load_between(look(1.0, 0.0, 0.0, 0.0), look(1.0, 1.0, 0.0, 0.0))


class TestMachine:
    def test_says_what_figures_depend_on(self) -> None:
        """Processor, cores, Python and the versions of all that computes are named."""
        machine = describe_machine("1.2.3")
        facts = dict(machine.facts())
        assert facts["usarsim-server"] == "1.2.3"
        assert facts["mujoco"][0].isdigit()
        assert facts["Processor"]
        assert 1 <= machine.usable_cores <= machine.cores
        assert machine.memory == psutil.virtual_memory().total

    def test_names_what_is_not_installed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """A missing package is told as none, not an error."""
        monkeypatch.setattr("usarsim_bench.machine._PACKAGES", ("no-such-package-at-all",))
        assert describe_machine("0").packages["no-such-package-at-all"] == "none"
