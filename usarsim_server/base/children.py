"""Starts Python programs of this product in processes of their own.

Python looks for modules in the folder that one works in when a program is started by `-m` or `-c`.
A `pickle.py` or `mujoco.py` that lies there would be run instead of the real module. All programs
of the product are therefore started with `-P`; `PYTHONPATH` holds for them as for the parent.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_TIED = (
    "import ctypes, os, sys\n"
    "try: ctypes.CDLL(None).prctl(1, 15)\n"
    "except (OSError, AttributeError): pass\n"
    "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])\n"
)
"""Becomes the program in its arguments; prctl(2), PR_SET_PDEATHSIG."""
_SAFE = "PYTHONSAFEPATH"


def python(*words: str, tied: bool = False) -> list[str]:
    """The command line of a Python program, without the modules of the folder one works in.

    Args:
        words: of the command line after the interpreter, such as `-m` and a module.
        tied: the program gets SIGTERM when this process ends, however it ends (on Linux).
    """
    command = [sys.executable, "-P", *words]
    return [sys.executable, "-P", "-c", _TIED, *command[1:]] if tied else command


@contextmanager
def safe_pool() -> Iterator[None]:
    """Lets processes of `multiprocessing` that are started inside leave that folder alone, too."""
    before = os.environ.get(_SAFE)
    os.environ[_SAFE] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE]
        else:
            os.environ[_SAFE] = before
