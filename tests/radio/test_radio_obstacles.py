"""Obstacles on a line: what counts, how often, and what nobody should be able to upset."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usarsim_server.radio.obstacles import MOST, STRIDE, SceneryObstacles
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.query import SceneryHit
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.worlds.description import Victim
from usarsim_server.worlds.victims import add_victim

Geom = mujoco.mjtGeom

EAR = (0.0, 0.0, 0.5)
"""Every line of these tests begins here; the obstacles stand along x."""


class Lane:
    """A scenery along the x axis over an endless floor, built piece by piece."""

    def __init__(self) -> None:
        self.spec = mujoco.MjSpec()
        self.spec.worldbody.add_geom(name="floor", type=Geom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])

    def box(self, x: float, thickness: float = 0.1, name: str = "", **facts: object) -> Lane:
        """A wall across the lane, centred at x."""
        self.spec.worldbody.add_geom(
            name=name, type=Geom.mjGEOM_BOX, pos=[x, 0, 0.5], size=[thickness / 2, 2, 1], **facts
        )
        return self

    def sheets(self, *places: float) -> Lane:
        """One mesh of parallel square panels, each a closed plate 2 cm thick."""
        corners = [[a, b, c] for a in (-0.01, 0.01) for b in (-2, 2) for c in (-1, 1)]
        faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
        faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
        vertices = np.concatenate([np.array(corners) + np.array([x, 0, 0.5]) for x in places])
        triangles = np.concatenate([np.array(faces) + 8 * n for n in range(len(places))])
        mesh = self.spec.add_mesh(name="sheets", uservert=vertices.ravel())
        mesh.userface = triangles.ravel()
        geom = self.spec.worldbody.add_geom(name="sheets", type=Geom.mjGEOM_MESH)
        geom.meshname = "sheets"
        return self

    def counter(self) -> SceneryObstacles:
        """What counts in this scenery."""
        return SceneryObstacles(Simulation(self.spec.copy, SimulationOptions()))

    def count(self, to: float = 10.0) -> int:
        """Obstacles up to x = `to`."""
        return self.counter().count(EAR, (to, 0.0, 0.5))


def test_nothing_between_is_no_obstacle() -> None:
    """Side channels 56: a free line over the floor counts 0."""
    assert Lane().count() == 0


@pytest.mark.parametrize("thickness", [0.01, 0.1, 0.2, 0.3, 0.41, 0.6, 2.0])
def test_a_wall_of_any_thickness_is_one_obstacle(thickness: float) -> None:
    """Side channels 56: a wall counts once, and its far side is no second one."""
    assert Lane().box(5.0, thickness).count() == 1


@pytest.mark.parametrize("kind", ["SPHERE", "CAPSULE", "CYLINDER", "ELLIPSOID"])
@pytest.mark.parametrize("turned", [False, True])
def test_a_thick_round_thing_is_one_obstacle(kind: str, turned: bool) -> None:
    """A pillar or a boulder counts once, whichever way its surface is cut into triangles."""
    lane = Lane()
    lane.spec.worldbody.add_geom(
        type=getattr(Geom, f"mjGEOM_{kind}"),
        pos=[5.0, 0.05, 0.5],
        size=[0.7, 0.8, 0.9],
        quat=[1.0, 1.0, 0.0, 0.0] if turned else [1.0, 0.0, 0.0, 0.0],
    )
    assert lane.count() == 1


def test_a_hill_is_one_obstacle() -> None:
    """A line through a height field counts it once; one through two hills counts two."""
    lane = Lane()
    x = np.linspace(-4.0, 4.0, 81)
    profile = np.exp(-((x - 2.0) ** 2) / 0.3) + np.exp(-((x + 2.0) ** 2) / 0.3)
    field = lane.spec.add_hfield(name="hills", nrow=5, ncol=81, size=[4.0, 2.0, 1.0, 0.1])
    field.userdata = np.tile(profile, 5)
    geom = lane.spec.worldbody.add_geom(type=Geom.mjGEOM_HFIELD, pos=[5.0, 0.0, 0.01])
    geom.hfieldname = "hills"
    assert lane.count(to=5.0) == 1
    assert lane.count() == 2


def test_walls_in_a_row_are_counted_each() -> None:
    """Pieces without a name are told apart."""
    assert Lane().box(2.0).box(3.0).box(4.0).box(5.0).count() == 4


def test_another_object_is_new_however_near_but_not_within_a_stride() -> None:
    """Side channels 3.3 no. 2 and 4: the search goes on 0.20 m behind a surface."""
    assert Lane().box(5.0, 0.02).box(4.99 + STRIDE + 0.02, 0.02).count() == 2
    assert Lane().box(5.0, 0.02).box(4.99 + STRIDE - 0.02, 0.02).count() == 1


def test_the_same_mesh_crossed_twice_with_a_gap_counts_twice() -> None:
    """Side channels 3.3: one object with two walls is two obstacles."""
    assert Lane().sheets(3.0, 5.0).count() == 2


def test_thin_sheets_of_one_object_count_once() -> None:
    """Side channels 3.3: sheets nearer than 0.20 m are one obstacle, and so are several in a row
    if each lies within 0.20 m of where the search went on."""
    assert Lane().sheets(3.0, 3.15).count() == 1
    assert Lane().sheets(3.0, 3.39).count() == 1
    assert Lane().sheets(3.0, 3.41).count() == 2


def test_only_what_lies_between_counts() -> None:
    """Walls before the beginning and behind the end are no obstacles."""
    counter = Lane().box(-1.0).box(5.0).box(11.0).counter()
    assert counter.count(EAR, (10.0, 0.0, 0.5)) == 1
    assert counter.count((10.0, 0.0, 0.5), EAR) == 1
    assert counter.count(EAR, (4.9, 0.0, 0.5)) == 0
    assert counter.count((5.1, 0.0, 0.5), (10.0, 0.0, 0.5)) == 0
    assert counter.count((5.1, 0.0, 0.5), (10.94, 0.0, 0.5)) == 0
    assert counter.count((5.1, 0.0, 0.5), (10.96, 0.0, 0.5)) == 1


def test_a_line_that_begins_inside_meets_the_object_once() -> None:
    """The surface that is left is the first one that is seen."""
    assert Lane().box(0.0, 1.0).count() == 1


def test_no_line_no_obstacle() -> None:
    """A robot and itself have nothing between them, even inside a wall."""
    assert Lane().box(0.0, 1.0).counter().count(EAR, EAR) == 0


def test_the_floor_counts_from_above() -> None:
    """A line into the ground meets the ground, which is the world itself (side channels 3.3
    no. 3)."""
    assert Lane().counter().count(EAR, (1.0, 0.0, -3.0)) == 1


def test_movable_things_let_a_signal_pass() -> None:
    """Side channels 57: a crate or a door between two robots does not count."""
    lane = Lane().box(5.0)
    crate = lane.spec.worldbody.add_body(name="crate", pos=[3.0, 0.0, 0.5])
    crate.add_freejoint()
    crate.add_geom(type=Geom.mjGEOM_BOX, size=[0.3, 0.3, 0.3], mass=1.0)
    door = lane.spec.worldbody.add_body(name="door", pos=[7.0, 0.0, 0.5])
    door.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    door.add_geom(type=Geom.mjGEOM_BOX, size=[0.02, 0.5, 0.5], mass=5.0)
    assert lane.count() == 1


def test_victims_let_a_signal_pass_and_hide_nothing() -> None:
    """Side channels 3.3: a person does not count, a wall right behind the person does."""
    lane = Lane()
    add_victim(lane.spec, Victim("Anna", Pose((3.0, 0.0, 0.93)), "standing", "alive"))
    free = lane.counter()
    heights = np.linspace(0.05, 1.7, 34)
    assert [free.count((0.0, 0.0, z), (10.0, 0.0, z)) for z in heights] == [0] * 34
    walled = lane.box(3.25, 0.02).counter()
    assert {walled.count((0.0, 0.0, z), (10.0, 0.0, z)) for z in heights if z < 1.5} == {1}


def test_clear_and_opaque_walls_count_alike() -> None:
    """A glass wall is an obstacle for radio, although a laser looks through it."""
    assert Lane().box(5.0, name="glass_wall", rgba=[1, 1, 1, 0.2]).count() == 1


@pytest.mark.parametrize("reach", [1e3, 9e3, 1e5, 1e9, 1e15])
def test_distant_ends_cost_no_precision(reach: float) -> None:
    """Lines from and to absurdly far away still meet the walls that stand in their way."""
    counter = Lane().box(5.0).box(-5.0).counter()
    assert counter.count((-reach, 0.0, 0.5), (reach, 0.0, 0.5)) == 2
    assert counter.count(EAR, (reach, 0.0, 0.5)) == 1


def test_lines_far_from_everything_count_nothing() -> None:
    """What lies wholly outside is not looked at."""
    counter = Lane().box(5.0).counter()
    assert counter.count((1e6, 2e6, 3e6), (1e6, 2e6, -3e6)) == 0
    assert counter.count((2e4, 0.0, 0.0), (0.0, 2e4 + 1.0, 0.0)) == 0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_coordinates_that_are_none_count_nothing(bad: float, axis: int) -> None:
    """Not-a-number and infinities are answered, not computed with."""
    counter = Lane().box(5.0).counter()
    place = [10.0, 0.0, 0.5]
    place[axis] = bad
    x, y, z = place
    assert counter.count(EAR, (x, y, z)) == 0
    assert counter.count((x, y, z), EAR) == 0


def test_work_is_bounded() -> None:
    """A world that never ends is looked at a thousand times, not for ever."""

    class Endless:
        asked = 0

        def first_sceneries(
            self, origins: object, directions: object, reaches: Sequence[float]
        ) -> list[SceneryHit]:
            self.asked += 1
            return [SceneryHit(0.0, self.asked, None, entering=True) for _ in reaches]

    world = Endless()
    assert SceneryObstacles(world).count((0.0, 0.0, 0.0), (9e3, 0.0, 0.0)) == MOST
    assert world.asked == MOST


def test_many_lines_are_counted_as_each_alone() -> None:
    """Whatever they meet and wherever they end; what is no line counts nothing."""
    counter = Lane().box(2.0).sheets(4.0, 4.1, 5.0).box(7.0, 0.5).counter()
    ends = [
        *((to, side, 0.5) for to in (1.0, 2.0, 3.0, 4.05, 6.0, 9.0) for side in (0.0, 1.0, -5.0)),
        *(EAR, (math.nan, 0.0, 0.5), (1e6, 0.0, 0.5), (3.0, 0.0, -1.0)),
    ]
    counts = counter.counts(EAR, ends)
    assert counts == [counter.count(EAR, end) for end in ends]
    assert set(counts) >= {0, 1, 2, 3, 4}
    assert counter.counts(EAR, []) == []


@settings(max_examples=60)
@given(
    gaps=st.lists(st.floats(0.45, 3.0), min_size=0, max_size=6),
    thickness=st.floats(0.02, 0.2),
    slant=st.floats(-0.2, 0.2),
)
def test_count_is_the_number_of_separate_walls(
    gaps: list[float], thickness: float, slant: float
) -> None:
    """For walls with more than a stride between them the answer is known without any rays."""
    lane, x = Lane(), 0.0
    for gap in gaps:
        x += gap
        lane.box(x, thickness)
    end = (x + 1.0, slant, 0.5)
    counter = lane.counter()
    assert counter.count(EAR, end) == len(gaps)
    assert counter.count(end, EAR) == len(gaps)
