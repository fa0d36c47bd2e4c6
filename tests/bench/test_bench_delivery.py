"""Pictures that arrive against a loop that only renders: demand, ratio, and the loop itself."""

from __future__ import annotations

import json
import math
import subprocess
from dataclasses import asdict
from pathlib import Path

import pytest

from usarsim_bench import delivery
from usarsim_bench import delivery as instrument
from usarsim_bench.camera_client import ViewerTrial
from usarsim_bench.delivery import Frames, delivery_figures, measure_frames, rate_for
from usarsim_bench.robot_files import SURVEYOR, SURVEYOR_CAMERAS, write_scouts
from usarsim_bench.server import BenchError, Load
from usarsim_bench.team import TeamTrial
from usarsim_server.errors import UsarsimError

TRIAL = TeamTrial(4, 1.0, 0.99, Load(1.5, 0.2, 0.0), 1.0, 1.0, 2**20, 0.0, 1.0)


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
        figures = {
            one.name: one
            for one in delivery_figures(TRIAL, [seen(60.0, 40.0), seen(50.0, 46.0)], loops)
        }
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


class TestLoop:
    def test_is_told_what_to_draw(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The instrument gets the class, its folder and the time; its answer is read."""
        told: list[list[str]] = []

        def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
            told.append(command)
            answer = asdict(Frames("rays", 8, math.nan, math.nan, math.nan))
            return subprocess.CompletedProcess(command, 0, json.dumps(answer), "")

        monkeypatch.setattr(subprocess, "run", run)
        loop = delivery._loop("office", "/there", 2, 1.5)
        assert (loop.renderer, math.isnan(loop.pictures)) == ("rays", True)
        words = told[0]
        for flag, value in (
            ("--world", "office"),
            ("--class", SURVEYOR),
            ("--folder", "/there"),
            ("--robots", "2"),
            ("--seconds", "1.5"),
        ):
            assert words[words.index(flag) + 1] == value

    def test_that_fails_says_why(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """The last words of the instrument are the reason."""

        def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
            return subprocess.CompletedProcess(command, 1, "", "no such world")

        monkeypatch.setattr(subprocess, "run", run)
        with pytest.raises(BenchError, match="no such world"):
            delivery._loop("office", "/there", 2, 1.5)


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

    def test_prints_one_object(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """What the measurement reads is what the instrument found."""
        found = Frames("egl", 4, 100.0, 1.0, 5000.0)
        monkeypatch.setattr(instrument, "measure_frames", lambda *_: found)
        assert instrument.main(["--robots", "1"]) == 0
        assert json.loads(capsys.readouterr().out)["pictures"] == 100.0
