"""usarsim-server: legacy USARSim controllers drive robots in a MuJoCo world.

The package is arranged as rooms; `docs/architecture.md` is the map of the house.
"""

import os

# Read by OpenBLAS and llvmpipe when they are loaded: idle worker threads of either spin on the
# second core and cost more than they bring for arrays and pictures as small as ours.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("LP_NUM_THREADS", "0")

__version__ = "0.1.0"
