"""Pictures from inside a room of one mesh, near things, of better quality, by two painters."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from camera_fakes import (
    HEIGHT,
    RED_BOX,
    WIDTH,
    Geom,
    MakePainter,
    Yard,
    camera,
    eye_at,
    is_red,
    seen,
)

from usarsim_server.cameras.backend import NEAR, Quality
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.cameras.view import View, looking
from usarsim_server.simulation.frames import IDENTITY

CORNERS = [(x, y, z) for x in (-3.0, 3.0) for y in (-3.0, 3.0) for z in (-0.5, 3.0)]
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def indoors(spec: mujoco.MjSpec) -> None:
    """A closed magenta room around the middle, which is one mesh."""
    faces = [face for a, b, c, d in QUADS for face in ((a, b, c), (a, c, d))]
    spec.add_mesh(
        name="room",
        uservert=np.ravel(CORNERS).tolist(),
        userface=np.ravel([face[::-1] for face in faces]).tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    color = [0.8, 0.1, 0.8, 1.0]
    spec.worldbody.add_geom(
        type=Geom.mjGEOM_MESH, meshname="room", rgba=color, group=2, contype=0, conaffinity=0
    )


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.5, 4.0])
def test_a_room_is_seen_from_within(make_painter: MakePainter, bearing: float) -> None:
    """Who stands in a room sees its walls all around, and no sky through them."""
    yard = Yard(indoors)
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


FACE = RED_BOX[0] - 0.5
"""x (m) of the face of the red box that is seen from the origin."""


def red_part(yard: Yard, make_painter: MakePainter, distance: float) -> float:
    """Part of a picture that shows the box, with the eye so far (m) in front of its face."""
    eye = (FACE - distance, 0.0, RED_BOX[2])
    pose = looking(eye, RED_BOX)
    picture = make_painter().picture(View(pose, width=80, height=60), yard.look())
    return float(is_red(np.asarray(picture, np.uint8)).mean())


@pytest.mark.parametrize(
    ("distance", "seen"), [(0.10, False), (0.11, False), (0.13, True), (2 * NEAR, True)]
)
def test_the_near_plane(yard: Yard, make_painter: MakePainter, distance: float, seen: bool) -> None:
    """Nothing nearer than 0.12 m is drawn: a thing at 0.10 m is not there (robots 102)."""
    assert red_part(yard, make_painter, distance) == pytest.approx(1.0 if seen else 0.0, abs=0.02)


def test_a_camera_without_robot_stands_still(yard: Yard, make_painter: MakePainter) -> None:
    """A spectator's pose is that of the world; a robot that is not there has no eye."""
    painter, snapshot = make_painter(), yard.look()
    pose = looking((0.0, 0.0, 0.5), RED_BOX)
    still = painter.place(camera(None, pose=pose), snapshot, WIDTH, HEIGHT)
    assert still == eye_at(pose)
    assert painter.place(camera(99), snapshot, WIDTH, HEIGHT) is None
    robot = yard.park(0.0, 0.0)
    snapshot = yard.look()
    assert painter.place(camera(robot, link="nose"), snapshot, WIDTH, HEIGHT) is None
    on_robot = painter.place(camera(robot, pose=IDENTITY), snapshot, WIDTH, HEIGHT)
    assert on_robot is not None
    assert on_robot.pose.position == pytest.approx((0.0, 0.0, 0.1), abs=0.02)


def test_two_painters_in_turns(yard: Yard, make_painter: MakePainter) -> None:
    """Painters of one thread do not disturb each other, not even when one is closed."""
    robot = yard.park(0.0, 0.0)
    other_yard = Yard()
    other_yard.park(3.0, -3.0, 1.0)
    one, other = make_painter(), make_painter(of=other_yard)
    first = seen(one, yard, robot)
    seen(other, other_yard, robot)
    assert np.array_equal(seen(one, yard, robot), first)
    other.close()
    assert np.array_equal(seen(one, yard, robot), first)


def sunny(spec: mujoco.MjSpec) -> None:
    """A sun that casts shadows."""
    for light in spec.lights:
        light.castshadow = True


class TestQuality:
    """Shadows and samples, which only OpenGL has."""

    def test_shadows_are_cast(self, gl: str) -> None:
        """With a shadow map the floor behind the box is darker than without."""
        yard = Yard(sunny)
        view = View(looking((4.0, 0.3, 6.0), (4.5, 0.3, 0.0)), 0.6, 120, 90)
        pictures = []
        for shadows in (0, 1024):
            options = PainterOptions(gl, Quality(shadows=shadows))
            painter = Painter(yard.simulation.compiled, options)
            pictures.append(painter.picture(view, yard.look()).astype(int))
            painter.close()
        assert ((pictures[0] - pictures[1]).sum(axis=-1) > 30).sum() > 100

    def test_samples_smooth_edges(self, gl: str, yard: Yard) -> None:
        """With four samples the edge of the box is a mixture of its colours."""
        view = View(looking((0.0, 0.3, 0.5), (4.0, 0.0, 0.9)), 0.6, 120, 90)
        colors = []
        for samples in (0, 4):
            painter = Painter(yard.simulation.compiled, PainterOptions(gl, Quality(0, samples)))
            picture = painter.picture(view, yard.look())
            colors.append(len(np.unique(picture.reshape(-1, 3), axis=0)))
            painter.close()
        assert colors[1] > colors[0]
