"""Camera pictures against a bare renderer, and those that arrive against a mere loop."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from bench_fakes import a_trial, by_name

from usarsim_bench import rendering
from usarsim_bench.camera_client import ViewerTrial
from usarsim_bench.delivery import Frames, delivery_figures, measure_frames, rate_for
from usarsim_bench.figures import Plan
from usarsim_bench.rendering import BareRenderer, Costs, Watched, measure_rendering
from usarsim_bench.robot_files import SURVEYOR, SURVEYOR_CAMERAS, write_scouts
from usarsim_server.base.errors import UsarsimError
from usarsim_server.cameras.painter import Painter, PainterOptions
from usarsim_server.simulation.frames import Pose

COSTS = Costs("egl", 4, 6.0, 6.5, 8.0, 14.0, 25.0, 0.5, 6.0, 15.0, 0.92)


def test_figures_of_the_section(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each cost and each number of watched cameras has its figures; seconds become ms."""
    asked: list[tuple[object, ...]] = []

    def apart(measure: object, *given: object) -> Costs | Watched:
        asked.append(given)
        return COSTS if measure is rendering.measure_costs else Watched(4, 60.0, 0.02, 0.04, 0.9995)

    monkeypatch.setattr(rendering, "run_apart", apart)
    section = measure_rendering(Plan(robots=2, seconds=3.0, world="office"))
    figures = by_name(section)
    assert figures["bare mujoco.Renderer / tile"].met is True
    assert figures["tile by rays"].value == 25.0
    assert figures["4 watched: age when handed out, median"].value == pytest.approx(20.0)
    assert figures["4 watched: real-time factor"].met is True
    assert "egl" in section.setting
    assert asked == [("office", 2), *(("office", 2, cameras, 3.0) for cameras in (1, 4, 16))]


def test_bare_and_server_draw_the_same() -> None:
    """What is compared with the server is the same picture, drawn by MuJoCo's own class."""
    assembly = rendering._assembly("empty", 2, float("inf"))
    try:
        assembly.simulation.run_until(0.1)
        snapshot = assembly.simulation.look()
        painter = Painter(assembly.simulation.compiled, PainterOptions())
        if painter.renderer == "rays":
            pytest.skip("no OpenGL library on this machine")
        eye = painter.place(assembly.board.views[0], snapshot, 320, 240)
        assert eye is not None
        compiled = assembly.simulation.compiled(snapshot)
        with BareRenderer(painter.renderer, compiled, snapshot, eye) as bare:
            theirs = bare.draw(eye).astype(int)
        ours = painter.tile(eye, snapshot).astype(int)
        painter.close()
    finally:
        assembly.stop()
    assert np.abs(ours - theirs).mean() < 1.0


def test_watched_cameras_are_counted() -> None:
    """In a short run cameras are rendered, no faster than their rate, and frames have an age."""
    watched = rendering.measure_watched("empty", 1, 2, 0.5)
    assert watched.cameras == 2
    assert 0.0 < watched.pictures < 40.0
    assert math.isfinite(watched.age)
    assert watched.oldest >= watched.age


def test_extra_cameras_stand_on_robots() -> None:
    """Where a team has too few cameras further ones are mounted on its robots."""
    assembly = rendering._assembly("empty", 2, float("inf"), cameras=6)
    try:
        views = assembly.board.views
        assert len(views) == 6
        assert [view.tile for view in views] == list(range(6))
        assert {view.robot for view in views} == {one.robot for one in assembly.robots.vehicles}
        assert all(isinstance(view.pose, Pose) for view in views)
    finally:
        assembly.stop()


TRIAL = a_trial(4, 1.0)


def seen(pictures: float, news: float) -> ViewerTrial:
    """What a viewer got."""
    return ViewerTrial(pictures, news, 0.01, 0.02, 0.03, 1e4)


class TestDemand:
    def test_more_than_the_loop_makes_is_asked_for(self) -> None:
        """Else a server could not show what it can do."""
        assert 16 * rate_for(160.0, 16) == pytest.approx(1.5 * 160.0)

    @pytest.mark.parametrize(("pictures", "rate"), [(1e5, 60.0), (1.0, 5.0), (math.nan, 5.0)])
    def test_within_what_servers_can_be_asked_for(self, pictures: float, rate: float) -> None:
        """Cameras have a highest rate; where there is no loop a low one will do."""
        assert rate_for(pictures, 16) == rate


class TestFigures:
    def test_new_pictures_against_the_mean_of_the_loops(self) -> None:
        """Copies of a picture are no delivery."""
        loops = [Frames("egl", 16, 90.0, 1.0, 5e3), Frames("egl", 16, 110.0, 1.1, 5e3)]
        figures = by_name(delivery_figures(TRIAL, [seen(60.0, 40.0), seen(50.0, 46.0)], loops))
        ratio = figures["Delivered / rendered by the loop"]
        assert ratio.value == pytest.approx(0.86)
        assert ratio.met is True
        assert figures["Server: pictures of all cameras"].value == 110.0
        assert figures["Loop: processor use"].value == pytest.approx(1.05)

    def test_without_opengl_there_is_no_ratio(self) -> None:
        """There is nothing to compare with; what arrived is told all the same."""
        nothing = Frames("rays", 16, math.nan, math.nan, math.nan)
        figures = delivery_figures(TRIAL, [seen(9.0, 8.0)], [nothing])
        assert all(math.isfinite(one.value) for one in figures)
        assert figures[0].name == "Server: new pictures of all cameras"
        assert all(one.aim is None for one in figures)


class TestInstrument:
    def test_draws_all_cameras_in_turn(self, tmp_path: Path) -> None:
        """In a short run there are pictures, each a JPEG of some size."""
        write_scouts(tmp_path)
        frames = measure_frames("empty", SURVEYOR, [tmp_path], 1, 0.3)
        assert frames.cameras == SURVEYOR_CAMERAS
        if frames.renderer == "rays":
            pytest.skip("no OpenGL library on this machine")
        assert frames.pictures > 1.0
        assert frames.octets > 500.0

    def test_a_class_without_cameras_cannot_be_drawn(self, tmp_path: Path) -> None:
        """The error names the class; so it does if there is none of that name."""
        with pytest.raises(UsarsimError, match="ComStation carries no camera"):
            measure_frames("empty", "ComStation", [], 1, 0.1)
        with pytest.raises(UsarsimError, match="no robot class 'Unicorn'"):
            measure_frames("empty", "Unicorn", [], 1, 0.1)
