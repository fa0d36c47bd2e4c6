"""Rooms whose walls are one mesh: imported maps are made of them."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from camera_fakes import Geom, MakePainter, Yard, scenery

from usarsim_server.cameras.view import View, looking
from usarsim_server.simulation.simulation import Simulation, SimulationOptions

CORNERS = [(x, y, z) for x in (-3.0, 3.0) for y in (-3.0, 3.0) for z in (-0.5, 3.0)]
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


class _Indoors(Yard):
    """The yard with a closed magenta room around its middle, which is one mesh."""

    def __init__(self) -> None:
        def room() -> mujoco.MjSpec:
            spec = scenery()
            faces = [face for a, b, c, d in QUADS for face in ((a, b, c), (a, c, d))]
            spec.add_mesh(
                name="room",
                uservert=np.ravel(CORNERS).tolist(),
                userface=np.ravel([face[::-1] for face in faces]).tolist(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            )
            spec.worldbody.add_geom(
                type=Geom.mjGEOM_MESH,
                meshname="room",
                rgba=[0.8, 0.1, 0.8, 1.0],
                group=2,
                contype=0,
                conaffinity=0,
            )
            return spec

        self.simulation = Simulation(room, SimulationOptions())


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.5, 4.0])
def test_a_room_is_seen_from_within(make_painter: MakePainter, bearing: float) -> None:
    """Who stands in a room sees its walls all around, and no sky through them."""
    yard = _Indoors()
    ahead = (2.0 * math.cos(bearing), 2.0 * math.sin(bearing), 1.2)
    painter = make_painter(of=yard)
    picture = painter.picture(
        View(looking((0.0, 0.0, 1.0), ahead), width=80, height=60), yard.look()
    )
    red, green, blue = np.moveaxis(np.asarray(picture, dtype=int), -1, 0)
    walls = (red > 2 * green) & (abs(red - blue) < 10)
    floor = (abs(red - green) < 10) & (abs(green - blue) < 10)
    assert (walls | floor).all()
    assert walls.mean() > 0.5
