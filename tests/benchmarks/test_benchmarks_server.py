"""Processes, loads and the machine."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import psutil
import pytest

from benchmarks.server import Usage, busy_seconds, load_between, usage
from usarsim_bench.figures import BenchError


def look(wall: float, cpu: float, own: float, busy: float) -> Usage:
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
        assert after.busy - before.busy >= 0.05

    def test_of_a_process_that_is_gone(self) -> None:
        """A process that ended is an error that names it."""
        process = subprocess.Popen(["true"])
        process.wait()
        with pytest.raises(BenchError, match=f"process {process.pid} is gone"):
            usage(process.pid)


class TestBusySeconds:
    def test_of_known_times(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Idle and waiting for disks are not work; what guests used is not counted twice."""
        told = {
            "user": 10.0,
            "system": 3.0,
            "steal": 0.5,
            "idle": 99.0,
            "iowait": 8.0,
            "guest": 7.0,
        }
        none = dict.fromkeys(psutil.cpu_times()._fields, 0.0)
        times = psutil.cpu_times()._replace(**{**none, **told})
        monkeypatch.setattr(psutil, "cpu_times", lambda: times)
        assert busy_seconds() == 13.5


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
