"""`usarsim bench` understands its arguments and writes its files."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

import pytest

from usarsim_bench import command as bench
from usarsim_bench import team
from usarsim_bench.figures import Aim, Figure, Plan, Report, Section, describe_machine
from usarsim_bench.server import BenchError
from usarsim_bench.suite import ALL, MEASUREMENTS, QUICK_SECONDS
from usarsim_server import __version__
from usarsim_server.cli import main


@dataclass
class Taken:
    """What was asked for instead of being measured."""

    calls: list[tuple[tuple[str, ...], Plan, str]] = field(default_factory=list)

    def __call__(self, names: Sequence[str], plan: Plan, version: str) -> Report:
        self.calls.append((tuple(names), plan, version))
        figure = Figure("Factor", 0.5, "", 4, Aim(">=", 0.999))
        section = Section("team", "A team", "Nobody drives.", (figure,))
        return Report(describe_machine(version), datetime.now(UTC), (section,))

    @property
    def names(self) -> tuple[str, ...]:
        """The measurements asked for last."""
        return self.calls[-1][0]

    @property
    def plan(self) -> Plan:
        """The plan handed over last."""
        return self.calls[-1][1]


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> Taken:
    """Nothing is measured; a report is made up."""
    fake = Taken()
    monkeypatch.setattr(bench, "take", fake)
    return fake


class TestArguments:
    @pytest.mark.parametrize("words", [[], ["all"]])
    def test_all_is_the_default(self, taken: Taken, words: list[str]) -> None:
        """Without a word everything is measured, in the order of the suite."""
        assert main(["bench", *words]) == 0
        assert taken.names[:4] == ("swarm", "watched", "physics", "rays")
        assert {"admission", "jitter", "lockstep", "memory", "stepping"} < set(taken.names)
        assert taken.names == ALL
        assert not taken.plan.brief
        assert (taken.plan.robots, taken.plan.seconds, taken.plan.world) == (None, None, "arena")

    def test_quick_is_short(self, taken: Taken) -> None:
        """Everything but the search for the largest team, one size and some seconds each."""
        assert main(["bench", "quick"]) == 0
        assert set(ALL) - set(taken.names) == {"largest"}
        assert taken.plan.brief
        assert taken.plan.seconds == QUICK_SECONDS
        assert main(["bench", "quick", "--seconds", "9"]) == 0
        assert taken.plan.seconds == 9.0

    @pytest.mark.parametrize("name", list(MEASUREMENTS))
    def test_one_measurement(self, taken: Taken, name: str) -> None:
        """A word chooses one measurement, which is a function of its module."""
        assert main(["bench", name]) == 0
        assert taken.names == (name,)
        module = importlib.import_module(f"usarsim_bench.{MEASUREMENTS[name][0]}")
        assert callable(getattr(module, f"measure_{name}"))

    @pytest.mark.parametrize(
        "words",
        [
            ["team", "--robots", "3", "--seconds", "2.5", "--world", "empty"],
            ["--robots", "3", "--seconds", "2.5", "--world", "empty", "team"],
            ["--robots", "3", "team", "--seconds", "2.5", "--world", "empty"],
        ],
    )
    def test_options_stand_before_or_behind(self, taken: Taken, words: list[str]) -> None:
        """An option before the word is not lost to a default behind it."""
        assert main(["bench", *words]) == 0
        assert (taken.plan.robots, taken.plan.seconds, taken.plan.world) == (3, 2.5, "empty")

    @pytest.mark.parametrize(
        "words",
        [
            ["--robots", "0"],
            ["--robots", "257"],
            ["--robots", "many"],
            ["--seconds", "0"],
            ["--seconds", "601"],
            ["--seconds", "nan"],
            ["nothing"],
        ],
    )
    def test_nonsense_is_refused(self, taken: Taken, words: list[str]) -> None:
        """Numbers outside their limits and unknown words end with code 2, nothing is measured."""
        with pytest.raises(SystemExit) as ended:
            main(["bench", *words])
        assert ended.value.code == 2
        assert not taken.calls

    def test_every_measurement_is_explained(self, capsys: pytest.CaptureFixture[str]) -> None:
        """The help names all of them, each with its line."""
        with pytest.raises(SystemExit):
            main(["bench", "--help"])
        told = " ".join(capsys.readouterr().out.split())
        assert all(f"{name} {text}" in told for name, (_, text) in MEASUREMENTS.items())

    def test_the_version_goes_along(self, taken: Taken) -> None:
        """The report names the server that was measured."""
        main(["bench"])
        assert taken.calls[-1][2] == __version__

    def test_progress_goes_to_standard_error(
        self, taken: Taken, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """What goes on does not get into a report that is piped into a file."""
        main(["bench", "team"])
        capsys.readouterr()
        taken.plan.say("busy")
        told = capsys.readouterr()
        assert (told.out, told.err) == ("", "busy\n")


class TestOutput:
    def test_report_is_printed(self, taken: Taken, capsys: pytest.CaptureFixture[str]) -> None:
        """The table goes to standard output; a missed aim is no failure of the tool."""
        assert main(["bench", "team"]) == 0
        out = capsys.readouterr().out
        assert "MISSED" in out
        assert "0 of 1 aims met." in out

    def test_files_are_written(self, taken: Taken, tmp_path: Path) -> None:
        """JSON and Markdown hold the same report."""
        page, data = tmp_path / "r.md", tmp_path / "r.json"
        assert main(["bench", "team", "--json", str(data), "--markdown", str(page)]) == 0
        assert json.loads(data.read_text())["sections"][0]["figures"][0]["value"] == 0.5
        assert "| Factor | 0.5000 |  | >= 0.999 | MISSED |" in page.read_text()

    def test_a_file_that_cannot_be_written(
        self, taken: Taken, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """The error names the file and the cure; the table has been printed all the same."""
        assert main(["bench", "team", "--json", str(tmp_path / "no" / "r.json")]) == 2
        told = capsys.readouterr()
        assert "A team" in told.out
        assert told.err.startswith("error: ")
        assert "r.json: cannot be written" in told.err

    def test_a_measurement_that_fails(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """The reason stands in the report, and one line of error names the measurement."""

        def fail(plan: Plan) -> Section:
            raise BenchError("the server died: it said nothing")

        monkeypatch.setattr(team, "measure_team", fail)
        assert main(["bench", "team"]) == 2
        told = capsys.readouterr()
        assert "of a team of 16\nFAILED: the server died: it said nothing" in told.out
        assert told.err == "error: could not be measured: team (reasons above)\n"


class TestFidelity:
    @pytest.mark.parametrize("rest", [[], ["--only", "V4"], ["--json", "x", "--help"], ["a", "-q"]])
    def test_is_handed_everything_behind_its_name(
        self, monkeypatch: pytest.MonkeyPatch, rest: list[str]
    ) -> None:
        """Its options are its own, also those that the other measurements have too."""
        module = ModuleType("usarsim_bench.fidelity.fidelity")
        seen: list[list[str]] = []

        def run(args: list[str]) -> int:
            seen.append(args)
            return 3

        vars(module)["main"] = run
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setattr("usarsim_bench.fidelity.fidelity", module, raising=False)
        assert main(["bench", "fidelity", *rest]) == 3
        assert seen == [rest]
