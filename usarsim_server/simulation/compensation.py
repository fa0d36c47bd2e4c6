"""Contact compensation: sliding contacts must not push bodies off the ground.

A slipping contact of MuJoCo's soft friction cone turns tangential motion into normal motion: a
skid-steered robot that turns hops, and its yaw rate depends on the time step. Lowering the
reference acceleration of a contact's normal row by the friction coefficient times the norm of its
tangential reference accelerations removes that coupling (robots reference 4.2). It has to be done
between the two halves of every step, for the elliptic cone only.
"""

from __future__ import annotations

import mujoco
import numpy as np

__all__ = ["compensate"]


def compensate(data: mujoco.MjData) -> None:
    """Remove the dilatancy of all active contacts of dimension three or more.

    To be called after `mj_step1` and before `mj_step2` of a model with the elliptic cone, whose
    constraint rows of a contact are one normal row followed by the tangential rows.
    """
    contact = data.contact
    rows = contact.efc_address
    count = rows.size
    if count == 0:
        return
    start = rows[0]
    if start >= 0 and 3 * count == data.nefc - start and contact.dim.max() == 3:
        # All contacts are active and of dimension three: their rows are one block at the end.
        block = data.efc_aref[start:].reshape(count, 3)
        first, second = block[:, 1], block[:, 2]
        block[:, 0] -= contact.friction[:, 0] * np.sqrt(first * first + second * second)
        return
    frictional = (rows >= 0) & (contact.dim > 2)
    normal = rows[frictional]
    if normal.size == 0:
        return
    reference = data.efc_aref
    first, second = reference[normal + 1], reference[normal + 2]
    coefficient = contact.friction[frictional, 0]
    reference[normal] -= coefficient * np.sqrt(first * first + second * second)
