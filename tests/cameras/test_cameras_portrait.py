"""Portraits: a robot fills the picture, whatever its size, place and heading."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from camera_fakes import cart, scenery

from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.spectators import extent, portrait_view
from usarsim_server.simulation.frames import Pose, quaternion_from_rpy
from usarsim_server.simulation.layout import RobotLayout
from usarsim_server.simulation.simulation import Simulation, SimulationOptions


def staged(pose: Pose) -> tuple[Stage, RobotLayout]:
    """A stage with a cart at a pose."""
    simulation = Simulation(scenery, SimulationOptions(speed=math.inf, max_robots=1))
    robot, _ = simulation.spawn(cart(), pose)
    snapshot = simulation.look()
    stage = Stage(simulation.compiled(snapshot))
    stage.show(snapshot)
    return stage, snapshot.layouts[robot]


CHASSIS = ((-0.25, 0.25), (-0.2, 0.2), (-0.1, 0.1))
HEAD = ((0.05, 0.15), (-0.05, 0.05), (0.25, 0.35))
POSES = [
    Pose((0.0, 0.0, 0.1)),
    Pose((-3.0, 2.0, 0.1), quaternion_from_rpy(0.0, 0.0, 2.0)),
]


def _corners(box: tuple[tuple[float, float], ...]) -> list[tuple[float, ...]]:
    return list(itertools.product(*box))


@pytest.mark.parametrize("pose", POSES)
def test_extent_is_that_of_the_body_in_its_own_frame(pose: Pose) -> None:
    """The size of a cart does not depend on where it stands and where it looks."""
    low, high = extent(*staged(pose))
    assert low == pytest.approx((-0.25, -0.2, -0.1), abs=1e-6)
    assert high == pytest.approx((0.25, 0.2, 0.35), abs=1e-6)


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize(("width", "height"), [(240, 180), (100, 300), (300, 100)])
def test_a_portrait_just_holds_its_robot(pose: Pose, width: int, height: int) -> None:
    """All corners are inside the picture, one of them close to an edge; it is seen from ahead."""
    stage, layout = staged(pose)
    view = portrait_view(stage, layout, width, height)
    corners = [*_corners(CHASSIS), *_corners(HEAD)]
    seen = np.array(
        [(view.pose.inverse() @ pose @ Pose((x, y, z))).position for x, y, z in corners]
    )
    assert (seen[:, 0] > 0.0).all()
    slope = math.tan(view.fov / 2.0)
    across = np.abs(seen[:, 1] / seen[:, 0]).max() / slope
    upward = np.abs(seen[:, 2] / seen[:, 0]).max() / (slope * height / width)
    assert 0.85 < max(across, upward) < 1.0
    camera = (pose.inverse() @ view.pose).position
    assert camera[0] > 0.0, "ahead"
    assert camera[1] < 0.0, "to the right"
    assert camera[2] > 0.0, "above"


def test_what_cannot_be_seen_has_no_extent() -> None:
    """A body that is clear as air; its portrait shows the place where it stands."""
    stage, layout = staged(POSES[0])
    stage.model.geom_rgba[layout.geoms, 3] = 0.0
    stage.model.geom_matid[layout.geoms] = -1
    low, high = extent(stage, layout)
    assert not low.any()
    assert not high.any()
    view = portrait_view(stage, layout, 240, 180)
    ahead = view.pose.inverse() @ POSES[0]
    assert ahead.position[0] > 0.5
    assert ahead.position[1:] == pytest.approx((0.0, 0.0), abs=1e-6)
