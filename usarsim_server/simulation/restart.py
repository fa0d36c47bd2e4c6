"""Puts the scene back to how it was when the world began, while time goes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from usarsim_server.simulation.model import WAKE

if TYPE_CHECKING:  # which uses this
    from usarsim_server.simulation.engine import Engine


def restart(engine: Engine) -> None:
    """Put back what hangs or lies loose in the scene, at rest, let everything that goes by itself
    begin anew, and forget what robots and things were told. Physics thread, between two steps."""
    model, data, parts = engine.world.model, engine.data, engine.parts
    for slot in engine.active.values():
        parts.release(slot, data)
        parts.sleep.let_drive(slot, parts.drives(slot))
    taken = {int(model.body_treeid[body]) for one in engine.world.layouts for body in one.bodies}
    for tree in range(model.ntree):
        if tree not in taken:
            engine.put_away(tree)
    parts.machines.restart(engine.time)
    parts.moving.restart(engine.time)
    parts.belts.restart()
    data.qvel[data.qvel == 0.0] = WAKE  # what stood on a lift or before a door may sleep
