"""Lets MuJoCo read models from paths of any letters in any locale.

Its Python layer takes a text for a path and writes it as UTF-8. A name of a file need not be UTF-8,
and in the C locale Python keeps other letters than those of ASCII as bytes that no text has. So
MuJoCo gets the bytes of the path, as the operating system does.
"""

from __future__ import annotations

import os
from pathlib import Path

import mujoco


def read_spec(path: Path) -> mujoco.MjSpec:
    """Read a model file.

    Raises:
        ValueError: MuJoCo cannot read it.
    """
    return mujoco.MjSpec.from_file(path_bytes(path))


def path_bytes(path: Path | str) -> bytes:
    """A path as MuJoCo takes it, for attributes of a specification, too."""
    try:
        return os.fsencode(path)
    except UnicodeEncodeError:  # letters from the text of a file, in the C locale
        return text_bytes(str(path))


def text_bytes(text: str) -> bytes:
    """The text of a model, in which paths of any letters may stand."""
    return text.encode("utf-8", "surrogateescape")
