"""`make fidelity`: choosing tests, verdicts, exit codes, and the three forms of output."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from motion import fidelity
from motion.fidelity import TIMESTEPS, main, run_trials
from motion.results import ANY, Band, Result, as_json, as_markdown, as_table
from motion.stage import StageError
from motion.table import TRIALS, Quantity, Trial
from motion.workshop import Workshop

from usarsim_server.base.errors import UsarsimError


def result(
    test: str = "V1",
    timestep: float | None = 0.004,
    measured: float = 1.0,
    band: Band = Band(0.9, 1.1),  # noqa: B008
) -> Result:
    return Result(test, "P2AT", "speed", timestep, measured, "m/s", "1", band)


def trials(*results: Result) -> tuple[Trial, ...]:
    """A table of trials that give just these results."""
    return tuple(
        Trial("", (one.robot,), lambda *_, value=one.measured: value, {}, False, (quantity(one),))
        for one in results
    )


def quantity(one: Result) -> Quantity:
    """The row of a result."""
    low, high = one.band.low, one.band.high
    return Quantity(one.test, one.quantity, unit=one.unit, target=one.target, low=low, high=high)


@pytest.mark.parametrize(
    ("measured", "band", "verdict"),
    [
        (1.0, Band(1.0, 2.0), "pass"),
        (0.999, Band(1.0, 2.0), "FAIL"),
        (2.001, Band(high=2.0), "FAIL"),
        (-5.0, Band(high=2.0), "pass"),
        (math.nan, Band(1.0, 2.0), "FAIL"),
        (math.nan, ANY, "info"),
        (1e9, ANY, "info"),
    ],
)
def test_verdicts(measured: float, band: Band, verdict: str) -> None:
    """A measurement passes inside its band, ends included; NaN never does."""
    one = result(measured=measured, band=band)
    assert one.verdict == verdict
    assert one.passed is (verdict != "FAIL")


@pytest.mark.parametrize(
    ("band", "text"),
    [
        (Band(0.56, 0.62), "0.56 .. 0.62"),
        (Band(high=0.5), "<= 0.5"),
        (Band(low=6.0), ">= 6"),
        (Band(4.0, 4.0), "4"),
        (ANY, "-"),
    ],
)
def test_bands_read_as_they_are_meant(band: Band, text: str) -> None:
    """A band is written as an interval, a bound, a number, or a dash."""
    assert str(band) == text


@pytest.mark.parametrize(
    ("measured", "text"),
    [
        (0.68157, "0.6816 m/s"),
        (138.42, "138.4 m/s"),
        (0.0, "0 m/s"),
        (3e-9, "0 m/s"),
        (1234.56, "1235 m/s"),
        (100.0, "100 m/s"),
        (-0.05, "-0.05 m/s"),
        (math.nan, "none m/s"),
    ],
)
def test_values_have_four_digits(measured: float, text: str) -> None:
    """Measured values are shown with four significant digits and never in powers of ten."""
    assert result(measured=measured).value == text


def test_table_has_a_line_per_result() -> None:
    """The printed table names test, robot, quantity, time step, value, target, band, verdict."""
    heads, line = as_table([result()]).splitlines()
    words = ["V1", "P2AT", "speed", "4 ms", "1 m/s", "1", "0.9 .. 1.1", "pass"]
    assert [part.strip() for part in line.split("  ") if part.strip()] == words
    assert heads.split()[:3] == ["test", "robot", "quantity"]
    assert as_table([result()], heads=False) == line


def test_json_holds_everything() -> None:
    """JSON has one object per result; an open end of a band and NaN become null."""
    text = as_json([result(measured=math.nan, band=Band(high=2.0))])
    assert json.loads(text) == [
        {
            "test": "V1",
            "robot": "P2AT",
            "quantity": "speed",
            "timestep": 0.004,
            "measured": None,
            "unit": "m/s",
            "target": "1",
            "low": None,
            "high": 2.0,
            "verdict": "FAIL",
        }
    ]


def test_markdown_puts_robots_side_by_side() -> None:
    """One row per quantity, with the range of every robot; one failure makes the row fail."""
    table = as_markdown(
        [
            result(timestep=0.001, measured=1.0),
            result(timestep=0.004, measured=1.05),
            replace(result(timestep=0.001, measured=2.0), robot="P2DX"),
            replace(result(timestep=0.004, measured=2.00001), robot="P2DX"),
            result("V9", None, 1.0),
        ]
    )
    heads, _, row, over_all = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()
    ]
    assert heads == ["Test", "Quantity", "Measured", "Target", "Band", "Verdict"]
    measured = "P2AT 1 to 1.05; P2DX 2"
    assert row == ["V1", "speed, m/s", measured, "1", "0.9 .. 1.1", "FAIL"]
    assert over_all[2:] == ["P2AT 1", "1", "0.9 .. 1.1", "pass"]


def test_table_is_complete() -> None:
    """Every acceptance test is in the table; of each item of the checklist that it answers, too."""
    numbers = {number for trial in TRIALS for number in trial.tests}
    assert {f"V{n}" for n in range(1, 28)} <= numbers
    single = (23, *range(38, 44), 46, 47, 49, *range(59, 65), 120)
    assert {f"#{n}" for n in single} <= numbers
    checks = {number for trial in TRIALS for number in trial.checks.split(", ")}
    items = (*range(20, 34), 38, *range(51, 61), 63, 64, 80, 115, 120)
    assert {f"#{n}" for n in items} <= checks


def test_rows_are_unique() -> None:
    """A robot has one row for each test and quantity."""
    rows = [
        (one.test, one.what, robot) for t in TRIALS for one in t.quantities for robot in t.robots
    ]
    assert len(rows) == len(set(rows))


def test_one_real_test(capsys: pytest.CaptureFixture[str]) -> None:
    """`--only V6 --quick` measures the 3-DX at 4 ms, prints its table, and succeeds."""
    assert main(["--only", "v6", "--quick"]) == 0
    out = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in out[1:-1]] == [["V6", "P3DX"]]
    assert out[-1] == "1 passed, 0 failed, 0 for information"


@pytest.mark.parametrize(("measured", "code"), [(1.0, 0), (2.0, 1), (math.nan, 1)])
def test_exit_code(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    measured: float,
    code: int,
) -> None:
    """The exit code is 1 as soon as one measurement is out of its band."""
    found = trials(result(), result(measured=measured), result(measured=5.0, band=ANY))
    monkeypatch.setattr(fidelity, "TRIALS", found)
    assert main(["--quick"]) == code
    expected = f"{2 - code} passed, {code} failed, 1 for information"
    assert capsys.readouterr().out.splitlines()[-1] == expected


@pytest.mark.parametrize(("args", "timesteps"), [([], TIMESTEPS), (["--quick"], (0.004,))])
def test_quick_means_one_time_step(
    monkeypatch: pytest.MonkeyPatch, args: list[str], timesteps: tuple[float, ...]
) -> None:
    """All four time steps are measured, with `--quick` only 4 ms."""
    seen: list[float] = []

    def drive(shop: Workshop, robot: str, timestep: float) -> float:
        seen.append(timestep)
        return 1.0

    monkeypatch.setattr(fidelity, "TRIALS", (replace(trials(result())[0], drive=drive),))
    assert main(args) == 0
    assert tuple(seen) == timesteps


def test_only_filters_results_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a trial that measures several tests only those asked for are reported."""
    found = trials(result("V5"), result("V6"))
    assert [one.test for one in run_trials(found, (0.004,), ("V6",))] == ["V6"]
    assert [one.test for one in run_trials(found, (0.004,))] == ["V5", "V6"]


def test_hash_may_be_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """`--only 59` means #59, which a shell would take for a comment."""
    monkeypatch.setattr(fidelity, "TRIALS", trials(result("#59"), result("V1", measured=9.0)))
    assert main(["--only", "59"]) == 0
    assert main(["--only", "#59,V1"]) == 1


def test_unknown_test(capsys: pytest.CaptureFixture[str]) -> None:
    """An unknown number is refused with the list of known ones."""
    with pytest.raises(SystemExit) as left:
        main(["--only", "V99"])
    assert left.value.code == 2
    assert "no test v99; known: V1, " in capsys.readouterr().err


def test_broken_trial_fails_and_the_next_one_runs() -> None:
    """A trial that loses its robot counts as failed; the others are still carried out."""

    def broken(shop: Workshop, robot: str, timestep: float) -> float:
        if timestep > 0.004:
            raise StageError("the robot was lost")
        return 1.0

    first = replace(trials(result("V14"))[0], drive=broken)
    found = list(run_trials((first, *trials(result("V1"))), (0.004, 0.005)))
    assert [(one.test, one.passed) for one in found] == [
        ("V14", True),
        ("V14", False),
        ("V1", True),
        ("V1", True),
    ]
    assert found[1].quantity == "the robot was lost"


def test_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`--json` and `--markdown` write the results; a page keeps what is around its marks."""
    monkeypatch.setattr(fidelity, "TRIALS", trials(result()))
    page = tmp_path / "page.md"
    page.write_text(f"# Title\n\n{fidelity.BEGIN}\nold\n{fidelity.END}\n\nThe end.\n")
    data = tmp_path / "data.json"
    assert main(["--json", str(data), "--markdown", str(page)]) == 0
    assert json.loads(data.read_text())[0]["measured"] == 1.0
    table = as_markdown([result()])
    assert page.read_text() == (
        f"# Title\n\n{fidelity.BEGIN}\n\n{table}\n{fidelity.END}\n\nThe end.\n"
    )
    bare = tmp_path / "bare.md"
    assert main(["--markdown", str(bare)]) == 0
    assert bare.read_text() == table


def test_missing_folder_is_told_before_the_work(tmp_path: Path) -> None:
    """A file in a folder that does not exist is refused before minutes are spent."""
    with pytest.raises(UsarsimError, match="no such folder"):
        main(["--json", str(tmp_path / "missing" / "data.json")])
