"""usarsim-server: legacy USARSim controllers drive robots in a MuJoCo world.

The package is arranged as rooms; `docs/architecture.md` is the map of the house.
"""

import os

# Read by OpenBLAS and llvmpipe when they are loaded: idle worker threads of either spin on the
# second core and cost more than they bring for arrays and pictures as small as ours.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("LP_NUM_THREADS", "0")

# The library that this names is loaded as soon as mujoco is imported, which fails without it. What
# draws camera pictures is found out later and does not depend on it (`cameras/backend.py`).
_LIBRARIES = {"egl": "EGL", "osmesa": "OSMesa"}
_named = _LIBRARIES.get(os.environ.get("MUJOCO_GL", "").strip().lower())
if _named is not None:
    from ctypes.util import find_library

    if find_library(_named) is None:
        os.environ["MUJOCO_GL"] = "disable"

__version__ = "0.1.0"
