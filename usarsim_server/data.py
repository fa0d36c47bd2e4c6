"""Where the shipped worlds and robots lie."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

_PACKAGE = Path(__file__).resolve().parent


def data_directory(kind: Literal["worlds", "robots"]) -> Path:
    """Return the folder of shipped data.

    An installed wheel carries it inside the package; in a source tree it lies beside the package.
    """
    packaged = _PACKAGE / "_data" / kind
    return packaged if packaged.is_dir() else _PACKAGE.parent / kind
