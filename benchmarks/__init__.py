"""Measurements for developers, taken from outside of a running server: `make bench ARGS=quick`.

Every figure is a ratio or a comparison taken within one run. The server is a process of its own;
the clients live in this one, so that their cost is not counted. Programs that a measurement starts
find these modules, and the attackers of `tests/hostile`, by PYTHONPATH.
"""

import os
import sys
from pathlib import Path

_ROOT = Path(__file__).parents[1]
_FOLDERS = [str(_ROOT), str(_ROOT / "tests")]

sys.path.extend(folder for folder in _FOLDERS if folder not in sys.path)
os.environ["PYTHONPATH"] = os.pathsep.join([*_FOLDERS, os.environ.get("PYTHONPATH", "")]).rstrip(
    os.pathsep
)
