"""The rays of a batch in one call of compiled code, during which other threads may go on.

Where there is a C compiler and Embree can be called (`embree.py`), `rays.c` does all of it: rays
that lie beside one another look for the spheres in their cone, the nearest first; each ray meets
the bodies in those that it passes, in the frame of each, and what stands, as far as no body is
nearer. Elsewhere, and with `USARSIM_NATIVE=0`, numpy and Embree do the same in several passes over
all rays (`cast.py`). Both give the same numbers to the bit.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

from usarsim_server.base.logs import Log
from usarsim_server.simulation.frames import Numbers
from usarsim_server.simulation.native.compiling import load
from usarsim_server.simulation.rays.embree import library
from usarsim_server.simulation.rays.query import RayBatch
from usarsim_server.simulation.rays.records import FixedRecord, MovingRecord, WorkRecord
from usarsim_server.simulation.rays.triangles import Surfaces

SOURCE = Path(__file__).with_name("rays.c")

NOTHING_MOVES = MovingRecord(**dict.fromkeys(MovingRecord.KINDS)), None
"""What moves, and which of it fans do not see, where only what never moves counts."""

_log = Log("simulation")


class RayCode:
    """The compiled code."""

    def __init__(self, code: ctypes.CDLL, embree: ctypes.CDLL) -> None:
        """Look up the functions.

        Raises:
            AttributeError: if one is missing.
        """
        self._cast = code.cast_rays
        self._cast.argtypes = (ctypes.c_void_p,)
        self._intersect = ctypes.cast(embree.rtcIntersect1, ctypes.c_void_p).value

    def cast(
        self, batch: RayBatch, fixed: FixedRecord, moving: MovingRecord, own: Numbers | None
    ) -> Surfaces:
        """What all rays of a batch meet first within their ranges, see `cast.py`.

        Args:
            batch: the rays. fixed, moving: what they may meet.
            own: (f,) the tree that a fan does not see, -1 for none; None if there are no trees.
        """
        count, normals = len(batch.directions), None
        if batch.facing.any():
            normals = np.zeros((count, 3))
        found = Surfaces(np.empty(count), np.empty(count, dtype=np.intp), normals)
        work = WorkRecord(
            intersect=self._intersect,
            fixed=fixed,
            moving=moving,
            fans=len(batch.fans),
            begins=batch.begins,
            point_begins=batch.point_begins,
            points=batch.points,
            directions=batch.directions,
            ranges=batch.fan_ranges,
            own=own,
            through_glass=batch.fans_through_glass,
            facing=batch.facing,
            distances=found.distances,
            normals=normals,
            met=found.geoms,
        )
        if self._cast(ctypes.addressof(work)):
            raise MemoryError(f"no room for rays of {len(batch.fans)} fans")
        return found


@cache
def ray_code() -> RayCode | None:
    """The compiled code; None where it cannot be had."""
    embree = library()
    if embree is None:
        return None
    try:
        return RayCode(load(ctypes.CDLL, SOURCE, "-O3", "-lm"), embree)
    except (OSError, AttributeError) as error:
        _log.info("rays are not compiled; numpy does the same, slower", reason=str(error))
        return None
