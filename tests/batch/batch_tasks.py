"""Runs that do as they are told, for tests of who plays them."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass

from usarsim_batch.tasks import Played, Row, provenance


@dataclass(frozen=True)
class Told:
    """A run. how: what it does; seconds: it takes."""

    key: str
    how: str = "well"
    seconds: float = 0.0

    def facts(self) -> Row:
        """See `Task`."""
        return {"name": self.key}

    def log(self) -> str:
        """See `Task`."""
        return ""


def play(task: Told) -> Played:
    """Do it."""
    time.sleep(task.seconds)
    if task.how == "crashes":
        print("last words", file=sys.stderr, flush=True)
        os.kill(os.getpid(), signal.SIGSEGV)
    if task.how == "hangs":
        time.sleep(1e6)
    if task.how == "eats":
        eaten = b"x" * (400 << 20)
        time.sleep(1e6 if eaten else 0)
    return Played(task.facts() | {"value": len(task.key)}, {"s": time.process_time()}, provenance())
