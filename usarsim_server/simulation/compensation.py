"""Contact compensation: sliding contacts must not push bodies off the ground.

A slipping contact of MuJoCo's soft friction cone turns tangential motion into normal motion: a
skid-steered robot that turns hops, and its yaw rate depends on the time step. While a contact
slips, the solver sees its normal row as if its reference acceleration were higher by the friction
coefficient times the norm of its tangential residual, the acceleration along the surface less the
tangential reference. Lowering the normal reference by as much removes that coupling (robots
reference 4.2). It has to be done between the two halves of every step, for the elliptic cone only.

The acceleration of the step is not known yet; that of the last one stands in for it. Without it a
body that brakes on its own friction would be let down by mu times its deceleration: a block on
ground of mu 1 would sink in by 3.5 mm and slide 7 % too far at 1 ms. The loop through the solver
is stable, with a gain of mu^2 / (1 + mu^2). The last acceleration may only lessen the correction:
after an impact it says nothing about what comes next.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

__all__ = ["compensate"]

Array = NDArray[np.float64]


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
    reference = data.efc_aref
    acceleration = np.empty(data.nefc)
    mujoco.mj_mulJacVec(data.model, data, acceleration, data.qacc_warmstart)
    start = rows[0]
    if start >= 0 and 3 * count == data.nefc - start and contact.dim.max() == 3:
        # All contacts are active and of dimension three: their rows are one block at the end.
        block = reference[start:].reshape(count, 3)
        moved = acceleration[start:].reshape(count, 3)
        slip = _slip(block[:, 1], block[:, 2], moved[:, 1], moved[:, 2])
        block[:, 0] -= contact.friction[:, 0] * slip
        return
    frictional = (rows >= 0) & (contact.dim > 2)
    normal = rows[frictional]
    if normal.size == 0:
        return
    one, two = normal + 1, normal + 2
    slip = _slip(reference[one], reference[two], acceleration[one], acceleration[two])
    reference[normal] -= contact.friction[frictional, 0] * slip


def _slip(first: Array, second: Array, moved_first: Array, moved_second: Array) -> Array:
    """Norms of the tangential residuals, none longer than the references themselves."""
    squares = first * first + second * second
    first, second = first - moved_first, second - moved_second
    slip: Array = np.sqrt(np.minimum(squares, first * first + second * second))
    return slip
