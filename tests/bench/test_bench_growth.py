"""The profile: curves of cost, what turning down brings, what a reading costs."""

from __future__ import annotations

import json
import math
import subprocess
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest

from usarsim_bench import growth, savings, team
from usarsim_bench.boxes import STARTS, write_boxes
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Plan
from usarsim_bench.growth import (
    beam_keys,
    curve,
    each_more,
    figures_of,
    measure_growth,
    per_picture,
    sizes_up_to,
)
from usarsim_bench.readings import measure_readings
from usarsim_bench.robot_files import scouts
from usarsim_bench.savings import BOXED, SURVEYED, USUAL, measure_savings, teams, write_variants
from usarsim_bench.suite import ALL, LONG, MEASUREMENTS, PROFILE, QUICK
from usarsim_bench.thread_cost import ROLES, Cost, Team, measure_cost, spent_between
from usarsim_server.cli import main
from usarsim_server.sensors.scanners import beam_count
from usarsim_server.testing import Rehearsal


def cost(physics: float = 0.0, factor: float = 1.0, pictures: float = 0.0, **spent: float) -> Cost:
    """A cost whose threads use what is said, and else nothing."""
    used = {**dict.fromkeys(ROLES, 0.0), "physics": physics, **spent}
    return Cost(used, factor, 100.0, pictures, 10**8, 0.0)


class TestArithmetic:
    def test_time_between_two_looks(self) -> None:
        """What was spent is taken from straight lines through the looks around both moments."""
        looks = [
            {"moment": t, "spent": {**dict.fromkeys(ROLES, 0.0), "physics": used}}
            for t, used in ((0.0, 1.0), (1.0, 1.5), (2.0, 2.5), (3.0, 2.5))
        ]
        assert spent_between(looks, 0.5, 2.5)["physics"] == pytest.approx(2.5 - 1.25)
        assert spent_between(looks, 1.0, 2.0)["physics"] == pytest.approx(1.0)
        assert spent_between(looks, 0.0, 3.0)["sockets"] == 0.0

    @pytest.mark.parametrize(("start", "stop"), [(-0.1, 0.5), (0.5, 1.1)])
    def test_looks_must_cover_the_span(self, start: float, stop: float) -> None:
        """A server that died, or did not look, is an error and no guess."""
        looks = [{"moment": t, "spent": dict.fromkeys(ROLES, t)} for t in (0.0, 1.0)]
        with pytest.raises(BenchError, match="look at its threads"):
            spent_between(looks, start, stop)

    def test_one_more(self) -> None:
        """The slope between the least and the greatest size, ms of processor time per s."""
        costs = {1: cost(0.05), 16: cost(0.3), 51: cost(0.45, reports=0.1)}
        assert each_more("robot", costs).value == pytest.approx(1e3 * 0.5 / 50)
        assert each_more("robot", {4: cost(0.3)}).value == 0.0

    def test_one_picture(self) -> None:
        """Drawing, encoding and the renderer's own threads count; time that runs slowly, too."""
        seen = cost(9.0, 0.5, 10.0, drawing=0.2, encoding=0.1, others=0.1, sockets=7.0)
        assert per_picture(seen) == pytest.approx(0.4 * 0.5 / 10.0)
        with pytest.raises(BenchError, match="no new picture"):
            per_picture(cost(drawing=0.2))

    def test_curves_show_the_figures(self) -> None:
        """Every figure of a thread is a point of its series."""
        costs = {1: cost(0.1, reports=0.02), 4: cost(0.3, reports=0.05, others=0.01)}
        drawn = {one.name: one.points for one in curve("k", "T", "x", costs).series}
        assert drawn["physics"] == ((1, 0.1), (4, 0.3))
        assert [x for x, _ in drawn["whole server"]] == [1, 4]
        assert [y for _, y in drawn["whole server"]] == pytest.approx([0.12, 0.36])
        told = {one.name: one.value for one in figures_of("robots", costs)}
        assert told["4 robots: reports"] == 0.05
        assert told["1 robot: physics"] == 0.1
        assert told["4 robots: whole server"] == pytest.approx(0.36)

    @pytest.mark.parametrize(
        ("largest", "sizes"),
        [(None, (1, 4, 16)), (8, (1, 4, 8)), (4, (1, 4)), (1, (1,)), (100, (1, 4, 16, 100))],
    )
    def test_sizes(self, largest: int | None, sizes: tuple[int, ...]) -> None:
        """A largest size is always one of them, and none is larger."""
        assert sizes_up_to((1, 4, 16), largest) == sizes


class TestFiles:
    @pytest.mark.parametrize("beams", [2, 31, 91, 181, 361, 1081, 2000])
    def test_beams(self, beams: int) -> None:
        """A scanner has exactly as many beams as asked for (protocol reference 5.2 number 15)."""
        keys = tomllib.loads(beam_keys(beams).replace(", ", "\n"))
        assert beam_count(keys["fov"], keys["resolution"]) == beams
        assert keys["fov"] <= math.pi

    @pytest.mark.parametrize("beams", [1, 40_000])
    def test_impossible_beams(self, beams: int) -> None:
        """What no scanner can have is refused."""
        with pytest.raises(ValueError, match="scanner"):
            beam_keys(beams)

    def test_boxes(self, tmp_path: Path) -> None:
        """A world has as many boxes as asked for, is equally dense at any size, and repeats."""
        sides = []
        for number in (100, 900):
            world = write_boxes(tmp_path / "a", number, 3)
            root = ElementTree.parse(world / "scene.xml").getroot()
            fixed = [g for g in root.findall("worldbody/geom") if g.get("type") == "box"]
            assert len(fixed) == number
            assert len(root.findall("worldbody/body/freejoint")) == 3
            sides.append(max(abs(float(g.attrib["pos"].split()[0])) for g in fixed))
            again = write_boxes(tmp_path / "b", number, 3)
            assert (again / "scene.xml").read_text() == (world / "scene.xml").read_text()
        assert sides[1] / sides[0] == pytest.approx(3.0, rel=0.1)

    def test_robots_start_clear_of_boxes(self, tmp_path: Path) -> None:
        """The server takes such a world, and a robot stands still on every start pose."""
        world = write_boxes(tmp_path, 300, 20)
        with Rehearsal(world=world, max_robots=STARTS) as rehearsal:
            starts = rehearsal.assembly.world.starts
            assert len(starts) == STARTS
            for start in starts:
                rehearsal.connect().send(f"INIT {{ClassName P3AT}} {{Start {start.tag}}}")
            rehearsal.run(0.5)
            for vehicle, start in zip(rehearsal.assembly.fleet.vehicles, starts, strict=True):
                state = vehicle.look()
                assert state is not None
                assert math.dist(state.pose.position[:2], start.pose.position[:2]) < 0.02

    def test_variants_are_robots(self, tmp_path: Path) -> None:
        """The server knows every class that is compared, and each differs in what it says."""
        with scouts() as words:
            folder = Path(words[1])
            write_variants(folder)
            changes = teams(1, folder, "arena", tmp_path)
            with Rehearsal(world="empty", robots=(folder,)) as rehearsal:
                found = {
                    one.team.robot_class: rehearsal.assembly.fleet.describe(one.team.robot_class)
                    for one in changes
                }
        names = {name: {s.name for s in one.items} for name, one in found.items() if one}
        assert set(names) == set(found)
        assert names["NoSensors"] == set()
        assert names["NoSonars"] == {"lms200", "GndTruth", "InsTest", "Odometer"}
        for name in ("SlowLaser", "FewBeams", "SlowSonars", "ThinSonars", "SlowPoses"):
            assert names[name] == names["BenchScout"]


class TestMeasuring:
    def test_a_team_costs_something(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """A real server with a real client: physics, reports and sockets have their own cost, and
        nobody draws."""
        monkeypatch.setattr(team, "SETTLE", 0.3)
        monkeypatch.setattr(team, "WINDOW", 0.3)
        found = measure_cost(Team(2, "P3AT", tmp_path, "empty"), Plan(), 8.0)
        assert set(found.spent) == set(ROLES)
        for role in ("physics", "reports", "sockets"):
            assert found.spent[role] > 0.0
        assert found.spent["encoding"] == 0.0
        assert found.whole == pytest.approx(sum(found.spent.values()))
        assert found.factor > 0.0
        assert found.lines > 10

    def test_growth(
        self,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        """`usarsim bench growth --plots DIR` varies four things and writes four pictures."""
        asked: list[Team] = []

        def pretend(team: Team, plan: Plan, seconds: float) -> Cost:
            asked.append(team)
            return cost(0.01 * team.robots, reports=0.02, sockets=0.01, drawing=0.1, pictures=2.0)

        monkeypatch.setattr(growth, "measure_cost", pretend)
        pages = tmp_path / "new" / "plots"
        assert main(["bench", "growth", "--robots", "4", "--plots", str(pages)]) == 0
        assert [team.robots for team in asked if team.robot_class == "BenchScout"][:2] == [1, 4]
        watched = [len(team.watching.tiles) for team in asked if team.watching.tiles]
        assert watched == list(growth.CAMERAS)
        files = sorted(file.name for file in pages.iterdir())
        assert files == [f"performance-{k}.svg" for k in ("beams", "cameras", "geoms", "robots")]
        for file in pages.iterdir():
            assert ElementTree.parse(file).getroot().tag.endswith("svg")
        assert "4 robots: physics" in capsys.readouterr().out

    def test_pictures_that_cannot_be_written(
        self,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        """One line names the file and the cure."""
        monkeypatch.setattr(growth, "measure_cost", lambda *_: cost(0.1, drawing=0.1, pictures=1.0))
        (tmp_path / "taken").write_text("")
        assert main(["bench", "growth", "--plots", str(tmp_path / "taken")]) == 2
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith("error: ")
        assert "cannot be written" in error

    def test_savings_compare_with_their_own_kind(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Teams, boxes and cameras each have their own base; a dearer change saves less than 0."""

        def pretend(team: Team, plan: Plan, seconds: float) -> Cost:
            if team.watching.tiles:
                shadows = "--shadows" in team.options
                return cost(0.1, drawing=0.4 if shadows else 0.2, pictures=10.0)
            raise AssertionError("only cameras need a clock")

        def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
            asked = json.loads(Path(command[-1]).read_text())
            dear = {"BenchScout": 1.0, "NoSensors": 0.25}
            told = [
                {"physics": 0.0, "reports": dear.get(work["robot_class"], 0.9)}
                for work in asked["works"]
            ]
            assert [work["timestep"] for work in asked["works"] if "timestep" in work] == [0.005]
            return subprocess.CompletedProcess(command, 0, json.dumps(told), "")

        monkeypatch.setattr(savings, "measure_cost", pretend)
        monkeypatch.setattr(subprocess, "run", run)
        figures = {one.name: one.value for one in measure_savings(Plan(robots=2)).figures}
        assert figures[USUAL] == 1.0
        assert figures[f"no sensors at all: less than {USUAL} by"] == pytest.approx(75.0)
        assert figures[f"--shadows 1024: less than {SURVEYED} by"] == pytest.approx(-200.0 / 3.0)
        assert figures["--shadows 1024: one picture"] == pytest.approx(40.0)
        assert not any(name.startswith((f"{BOXED}: less", f"{USUAL}: less")) for name in figures)

    def test_readings(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """What the instrument says becomes figures; if it fails the report says why."""
        row = {"type": "SICK", "count": 181, "rays": 5.0, "cast": 30.0, "text": 20.0}
        answer = json.dumps({**row, "alone": 90.0, "whole": 55.0})

        def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
            return subprocess.CompletedProcess(command, code, answer, "no such world")

        monkeypatch.setattr(subprocess, "run", run)
        code = 0
        told = {one.name: one.value for one in measure_readings(Plan()).figures}
        assert told["SICK (181 rays)"] == 55.0
        assert told["SICK (181 rays): casting"] == 30.0
        code = 2
        with pytest.raises(BenchError, match="no such world"):
            measure_readings(Plan())


def test_the_profile_is_measured_only_if_asked_for() -> None:
    """It is no part of `all` and `quick`, but every part has its own word."""
    assert not set(PROFILE) & {*ALL, *QUICK}
    assert {*ALL, *LONG, *PROFILE} == set(MEASUREMENTS)
    assert MEASUREMENTS["growth"][0] is measure_growth
    assert MEASUREMENTS["savings"][0] is measure_savings
    assert MEASUREMENTS["readings"][0] is measure_readings
