"""Commands that mend things, written so that they can be pasted into this shell."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path


def pip(*arguments: str) -> str:
    """`pip install` for the very Python that runs this program."""
    return " ".join([_python(), "-m pip install", *map(_quoted, arguments)])


def root(command: str) -> str:
    """A command that only root may give."""
    return command if os.geteuid() == 0 else f"sudo {command}"


def _python() -> str:
    """The shortest name under which this shell finds our Python."""
    own = Path(sys.executable)
    for name in ("python", "python3"):
        found = shutil.which(name)
        if found is not None and Path(found) == own:
            return name
    try:
        return shlex.quote(str(own.relative_to(Path.cwd())))
    except ValueError:
        return shlex.quote(str(own))


def _quoted(argument: str) -> str:
    return argument if argument.startswith("-") else shlex.quote(argument)
