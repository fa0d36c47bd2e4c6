"""C code that is compiled once for each user, kept in the user's cache, and loaded from there."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path
from stat import S_ISDIR

OPTIONS = ("-O2", "-fPIC", "-shared", "-ffp-contract=off")
"""Without contraction: a product and a sum are rounded one after the other, as numpy does it."""
COMPILING = 30.0
"""s of wall time after which the compiler counts as lost."""


def load(kind: type[ctypes.CDLL], source: Path, *words: str) -> ctypes.CDLL:
    """The compiled code of a source.

    Args:
        kind: `ctypes.CDLL` lets other threads have the interpreter meanwhile, `ctypes.PyDLL` not.
        source: of the code, which needs no more than the standard library and the words.
        words: for the compiler: where headers are, which libraries belong to it.

    Raises:
        OSError: there is none; the text says why.
    """
    if os.environ.get("USARSIM_NATIVE") == "0":
        raise OSError("USARSIM_NATIVE is 0")
    if os.name != "posix":
        raise OSError("not for this system")
    try:
        return kind(str(_compiled(source, *words)))
    except (RuntimeError, subprocess.SubprocessError) as error:
        raise OSError(str(error)) from error


def _compiled(source: Path, *words: str) -> Path:
    """The file of the compiled code, made if it is not there yet."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise OSError("no C compiler (cc)")
    made_of = (source.read_bytes(), *(one.encode() for one in (*OPTIONS, *words, compiler)))
    name = hashlib.sha256(b"|".join((*made_of, platform.machine().encode()))).hexdigest()[:16]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "usarsim" / source.stem
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    state = folder.lstat()
    if not S_ISDIR(state.st_mode) or state.st_uid != os.getuid() or state.st_mode & 0o022:
        raise OSError(f"{folder}: others may write there")
    file = folder / f"{name}.so"
    if not file.exists():
        with tempfile.TemporaryDirectory(dir=folder) as made:
            target = Path(made, file.name)
            subprocess.run(
                (compiler, *OPTIONS, str(source), *words, "-o", str(target)),
                check=True,
                capture_output=True,
                timeout=COMPILING,
            )
            target.replace(file)  # whole or not at all, whoever else does the same
    return file
