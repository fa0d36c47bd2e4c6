"""Kernels are compiled once for all workers of a test run."""

from __future__ import annotations

import fcntl
import threading
from collections.abc import Iterator
from typing import Any
from unittest import mock

import pytest


@pytest.fixture(scope="session", autouse=True)
def _kernels_are_compiled_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The worker that needs a kernel first compiles it, for seconds; the others wait meanwhile and
    read it from disk."""
    try:
        from numba.core.dispatcher import Dispatcher
    except ImportError:  # then there is nothing to compile
        yield
        return
    compile_ = Dispatcher.compile
    base = tmp_path_factory.getbasetemp()
    # Workers have folders of their own in a common one.
    door = (base.parent if base.name.startswith("popen-") else base) / "kernels.lock"
    one_thread, inside = threading.RLock(), []

    def compiled(self: Any, signature: Any) -> Any:
        with one_thread, door.open("w") as lock:
            if not inside:  # a kernel has others compiled that it calls
                fcntl.flock(lock, fcntl.LOCK_EX)
            inside.append(self)
            try:
                return compile_(self, signature)
            finally:
                inside.pop()

    with mock.patch.object(Dispatcher, "compile", compiled):
        yield
