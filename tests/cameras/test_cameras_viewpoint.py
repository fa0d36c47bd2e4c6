"""Views, eyes and named viewpoints: geometry and refusals."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from camera_fakes import Yard
from hypothesis import assume, given
from hypothesis import strategies as st

from usarsim_server.base.errors import UsarsimError
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.spectators import FOV, Viewpoint, find_viewpoint, named_viewpoints
from usarsim_server.cameras.view import Eye, View, looking
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.worlds.description import StartPose, WorldDescription

number = st.floats(-100.0, 100.0)
point = st.tuples(number, number, number)


class TestLooking:
    """Cameras that look somewhere."""

    @given(point, point)
    def test_the_target_is_in_the_middle_and_up_is_up(
        self, position: tuple[float, float, float], target: tuple[float, float, float]
    ) -> None:
        """The axis meets the target, the left side is level, the upper edge does not hang down."""
        assume(math.dist(position, target) > 0.01)
        pose = looking(position, target)
        ahead = pose.rotate((math.dist(position, target), 0.0, 0.0))
        assert np.add(position, ahead) == pytest.approx(target, abs=1e-5)
        assert pose.rotate((0.0, 1.0, 0.0))[2] == pytest.approx(0.0, abs=1e-9)
        assert pose.rotate((0.0, 0.0, 1.0))[2] >= -1e-9

    def test_straight_down_is_a_map(self) -> None:
        """Looking down, x is up in the picture and y to the left."""
        pose = looking((1.0, 2.0, 9.0), (1.0, 2.0, 0.0))
        assert pose.rotate((0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
        assert pose.rotate((0.0, 1.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)

    @pytest.mark.parametrize("target", [(1.0, 2.0, 3.0), (math.nan, 0.0, 0.0)])
    def test_no_direction_is_refused(self, target: tuple[float, float, float]) -> None:
        """Position and target must be two places."""
        with pytest.raises(ValueError, match="two places"):
            looking((1.0, 2.0, 3.0), target)


class TestEye:
    """Pinhole geometry."""

    def test_the_field_of_view_reaches_from_edge_to_edge(self) -> None:
        """The middles of the outermost pixels lie half a pixel inside the field of view."""
        rays = Eye(Pose(), math.radians(90.0), 100, 50).rays()
        assert rays.left[0, 0] == pytest.approx(0.99)
        assert rays.left[0, -1] == pytest.approx(-0.99)
        assert rays.up[0, 0] == pytest.approx(0.49)
        assert rays.up[-1, 0] == pytest.approx(-0.49)

    def test_directions_have_unit_depth(self) -> None:
        """A direction times a depth is the place at that depth."""
        eye = Eye(looking((0.0, 0.0, 0.0), (1.0, 2.0, 0.5)), 1.0, 7, 5)
        directions = eye.rays().directions(eye.pose.matrix())
        axis = np.array(eye.pose.rotate((1.0, 0.0, 0.0)))
        assert directions @ axis == pytest.approx(np.ones((5, 7)), abs=1e-5)
        assert np.linalg.norm(directions, axis=2) == pytest.approx(eye.rays().lengths(), rel=1e-5)


@pytest.mark.parametrize(
    "wrong",
    [{"width": 0}, {"height": 5000}, {"fov": 0.0}, {"fov": 3.1}, {"mode": "x-ray"}],
)
def test_impossible_views_are_refused(wrong: dict[str, object]) -> None:
    """Size, field of view and mode are checked when a view is made."""
    with pytest.raises(ValueError, match=r"pixels|degrees|mode"):
        View(Pose(), **wrong)  # type: ignore[arg-type]


def described(**changes: object) -> WorldDescription:
    """A world around the yard."""
    start = StartPose("S", Pose((0.0, 0.0, 0.25)))
    nowhere = Path("nowhere")
    return WorldDescription("w", "w", "w", "", nowhere, nowhere, (start,), **changes)  # type: ignore[arg-type]


class TestNames:
    """Views of a world by name."""

    @pytest.fixture
    def stage(self) -> Stage:
        """The yard."""
        return Stage(Yard().simulation._engine.world)

    def inside(self, view: Viewpoint, place: tuple[float, float, float]) -> bool:
        """Whether a place is in the picture of a view, 4:3."""
        x, y, z = (view.pose.inverse() @ Pose(place)).position
        slope = math.tan(view.fov / 2)
        return x > 0 and abs(y) < slope * x and abs(z) < 0.75 * slope * x

    def test_every_world_has_three(self, stage: Stage) -> None:
        """`top` and `overview` show everything, `start` shows the start pose."""
        views = named_viewpoints(stage, described())
        assert set(views) == {"top", "overview", "start"}
        for name in ("top", "overview"):
            assert self.inside(views[name], (4.0, 0.0, 0.5))
            assert self.inside(views[name], (0.0, 6.0, 1.0))
        assert self.inside(views["start"], (0.5, 0.0, 0.1))

    def test_bounds_leave_out_the_surroundings(self, stage: Stage) -> None:
        """What is outside the bounds of the world does not make `top` higher."""
        all_, part = (
            named_viewpoints(stage, described(**limits))["top"].pose.position[2]
            for limits in ({}, {"lower": (-1.0, -1.0, -1.0), "upper": (5.0, 1.0, 2.0)})
        )
        assert part < all_

    def test_a_wall_behind_the_start(self) -> None:
        """`start` stays before what stands behind the start pose."""

        def walled() -> mujoco.MjSpec:
            spec = mujoco.MjSpec()
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 5.0, 5.0], pos=[-1.0, 0.0, 0.0]
            )
            return spec

        stage = Stage(Simulation(walled, SimulationOptions())._engine.world)
        view = named_viewpoints(stage, described())["start"]
        assert -0.9 < view.pose.position[0] < -0.5

    def test_cameras_of_the_scene_are_views(self) -> None:
        """A camera of the scene looks as in MuJoCo, and goes before an automatic view."""

        def scene() -> mujoco.MjSpec:
            spec = mujoco.MjSpec()
            spec.worldbody.add_geom(size=[0.5, 0.0, 0.0])
            spec.worldbody.add_camera(name="top", pos=[0.0, 0.0, 5.0], fovy=45.0)
            return spec

        stage = Stage(Simulation(scene, SimulationOptions())._engine.world)
        view = named_viewpoints(stage, described(), aspect=2.0)["top"]
        assert view.pose.position == pytest.approx((0.0, 0.0, 5.0))
        assert view.pose.rotate((1.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
        assert view.pose.rotate((0.0, 0.0, 1.0)) == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)
        assert math.tan(view.fov / 2) == pytest.approx(2.0 * math.tan(math.radians(22.5)))

    def test_an_empty_world(self) -> None:
        """Where there is only a floor the start poses are what is looked at."""

        def floor() -> mujoco.MjSpec:
            spec = mujoco.MjSpec()
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
            return spec

        stage = Stage(Simulation(floor, SimulationOptions())._engine.world)
        views = named_viewpoints(stage, described())
        assert self.inside(views["overview"], (0.0, 0.0, 0.25))
        assert self.inside(views["top"], (0.0, 0.0, 0.25))


class TestTexts:
    """What users write."""

    KNOWN = {"Top": Viewpoint("Top", Pose())}  # noqa: RUF012

    def test_names_in_any_case(self) -> None:
        """A name is found whatever its case."""
        assert find_viewpoint(" top", self.KNOWN) is self.KNOWN["Top"]

    def test_six_numbers_in_the_wire_frame(self) -> None:
        """z down and y right, as INIT takes places."""
        view = find_viewpoint("1, 2, -3, 4, 2, -3", self.KNOWN)
        assert view.pose.position == (1.0, -2.0, 3.0)
        assert view.pose.rotate((1.0, 0.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0))
        assert view.fov == FOV

    @pytest.mark.parametrize(
        "text", ["tip", "1,2,3", "1,2,3,4,5,6,7", "1,2,3,1,2,3", "a,b,c,d,e,f", "1,2,3,nan,0,0", ""]
    )
    def test_nonsense_is_refused_with_the_names(self, text: str) -> None:
        """One error says what there is."""
        with pytest.raises(UsarsimError, match="known: Top"):
            find_viewpoint(text, self.KNOWN)
