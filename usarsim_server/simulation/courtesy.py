"""Letting others have the interpreter during long work in the background.

Whoever computes without pause, in Python or in native code that keeps the interpreter, makes every
other thread wait for half a millisecond or more, each time it needs the interpreter; the physics
needs it several times a step.
"""

from __future__ import annotations

import time

__all__ = ["breathe"]

PAUSE = 0.0005
"""s of wall time, in which others get on."""


def breathe() -> None:
    """Stand back for a moment; to be called about once a millisecond."""
    time.sleep(PAUSE)
