"""What a report says in words, of tables whose figures are awkward."""

from __future__ import annotations

import csv
import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from usarsim_report import statistics
from usarsim_report.statistics import (
    differences,
    paired,
    rank_sum,
    rejects,
    settled,
    several_paired,
    several_unpaired,
    signed_rank,
    summary,
    unpaired,
)
from usarsim_report.wording import number, p_value, span
from usarsim_server import cli
from usarsim_study import tables
from usarsim_study.analysis import analyse
from usarsim_study.study_file import alike

CASES = Path(__file__).parent / "cases"
ZEROS, CONTRARY = CASES / "19_equal_but_for_rounding", CASES / "20_mean_against_ranks"
NOISE = (1.200000000000001, 1.1999999999999957)
"""1.2 s as two differences of clock times have it."""


def report_of(case: Path, folder: Path, **study: object) -> str:
    """The Markdown report of a copy of a case, with other facts about the study."""
    shutil.copytree(case, folder, dirs_exist_ok=True)
    package = json.loads((folder / "datapackage.json").read_text(encoding="utf-8"))
    package["study"].update(study)
    (folder / "datapackage.json").write_text(json.dumps(package), encoding="utf-8")
    assert cli.main(["study", "report", str(folder)]) == 0
    return (folder / "report.md").read_text(encoding="utf-8")


def with_values(
    folder: Path,
    measure: str,
    columns: dict[str, Sequence[float | None]],
    *,
    between: bool = False,
    starts: int = 0,
) -> str:
    """The report of made-up values of a measure, by condition.

    Args:
        folder: where the tables are written. measure: the primary one.
        columns: values of each condition, by participant.
        between: every value has a participant of its own.
        starts: so many participants have the conditions in their order, the others the other way
            round; 0: in turn.
    """
    shutil.copytree(CONTRARY, folder)
    package = json.loads((folder / "datapackage.json").read_text(encoding="utf-8"))
    package["study"].update(
        primary=measure,
        design="between" if between else "within",
        conditions=[{"name": one, "title": one.title()} for one in columns],
    )
    (folder / "datapackage.json").write_text(json.dumps(package), encoding="utf-8")
    heads = [one.name for one in tables.TABLES["trials"]]
    names = list(columns)
    people, rows = [], []
    if between:
        given = [(name, value) for name in names for value in columns[name]]
        for place, (name, value) in enumerate(given):
            people.append(f"P{place:02}")
            rows.append((people[-1], 1, name, value))
    else:
        for place, values in enumerate(zip(*columns.values(), strict=True)):
            people.append(f"P{place:02}")
            met = list(zip(names, values, strict=True))
            turned = place >= starts if starts else place % 2 == 1
            for at, (name, value) in enumerate(reversed(met) if turned else met, start=1):
                rows.append((people[-1], at, name, value))
    with (folder / "participants.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([one.name for one in tables.TABLES["participants"]])
        for place, one in enumerate(people, start=1):
            writer.writerow([one, place, 1, "2026-01-01", "complete", "", 0])
    with (folder / "trials.csv").open("w", encoding="utf-8", newline="") as file:
        sheet = csv.DictWriter(file, heads, lineterminator="\n")
        sheet.writeheader()
        for one, at, name, value in rows:
            sheet.writerow(
                {
                    "participant": one,
                    "trial": at,
                    "attempt": 1,
                    "condition": name,
                    "layout": "A",
                    "status": "complete",
                    "inferred_stops": 0,
                    measure: "" if value is None else repr(value),
                }
            )
    assert cli.main(["study", "report", str(folder)]) == 0
    return (folder / "report.md").read_text(encoding="utf-8")


class TestRounding:
    """Values that are equal but for their last bits are equal in every test."""

    def test_zeros_of_a_study(self, tmp_path: Path) -> None:
        """Three pairs of 1.2 s get no rank: n 6, W 21, p .031 in both tests, a difference."""
        text = report_of(ZEROS, tmp_path)
        assert "Display to mark: 1.36 s longer with Gamepad than with Keyboard." in text
        assert "Wilcoxon p = 0.031, exact, n = 6 (3 more pairs are equal), W = 21" in text
        assert "matched rank-biserial 1.00, sign test p = 0.031" in text
        outcome = analyse(tables.read(tmp_path)).outcomes[0]
        result = outcome.comparisons[0].result
        assert isinstance(result, statistics.Paired)
        assert (result.n, result.changed, result.w, result.negative) == (9, 6, 21.0, 0)
        assert outcome.p == pytest.approx(0.03125)
        assert result.rank_biserial == 1.0

    @pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
    def test_in_any_unit(self, scale: float) -> None:
        """Neither small nor large units, nor one large value, decide what is zero."""
        first = np.array([NOISE[0], 1.2, NOISE[1], 7.1, 9.4, 6.2, 8.0, 5.5, 6.6, 1.0]) * scale
        second = np.array([NOISE[1], NOISE[0], 1.2, 8.2, 11.0, 8.9, 12.2, 6.1, 8.6, 9e5]) * scale
        found = paired(first.tolist(), second.tolist())
        assert found is not None
        assert (found.changed, found.w) == (7, 28.0)
        assert found.sign_p == pytest.approx(2 / 2**7)

    def test_small_differences_of_large_values_count(self) -> None:
        """1e-8 of a value is measured, 1e-10 of it is rounding."""
        assert differences([1e6, 1e6], [1e6 + 1e-2, 1e6 + 1e-4]).tolist() == pytest.approx(
            [1e-2, 0.0], abs=1e-9
        )

    def test_ties_of_differences(self) -> None:
        """Differences of clock times that are equal share their rank, up and down alike."""
        first = [100.3, 7.7, 512.4, 3.1, 0.2, 44.8]
        second = [
            one + way for one, way in zip(first, (1.1, -1.1, 1.1, 1.1, 1.1, 2.0), strict=True)
        ]
        found = paired(first, second)
        exact = paired([0.0] * 6, [1.1, -1.1, 1.1, 1.1, 1.1, 2.0])
        assert found is not None
        assert exact is not None
        assert (found.w, found.wilcoxon_p) == (exact.w, exact.wilcoxon_p)
        assert found.permutation_p == pytest.approx(exact.permutation_p)

    def test_between_participants(self) -> None:
        """Mann and Whitney's and Kruskal and Wallis's tests, and effect sizes."""
        first = [NOISE[0], 1.2, NOISE[1], 2.0]
        second = [1.2, NOISE[1], NOISE[0], 2.0 + 4e-16]
        assert rank_sum(first, second)[:2] == (8.0, 1.0)
        found = unpaired(first, second)
        assert found is not None
        assert (found.delta, found.mean, found.permutation_p) == (0.0, 0.0, 1.0)
        flat = unpaired([0.1] * 3, [0.1 + 1e-17, 0.3 - 0.2, 0.1])
        assert flat is not None
        assert (flat.d, flat.t, flat.sd) == (None, None, None)
        assert several_unpaired([first[:3], second[:3], [1.2] * 3]) is None

    def test_several_conditions(self) -> None:
        """Friedman's test: rows that are equal but for rounding have no order."""
        assert several_paired([[*NOISE, 1.2], [1.2, *NOISE], [NOISE[0], 1.2, NOISE[1]]]) is None

    def test_not_by_the_largest_value(self) -> None:
        """Around a boundary of decimals equal values stay equal, and others stay apart."""
        near = [0.1234567890125, 0.1234567890124999, 1.0]
        assert settled(near)[0] == settled(near)[1]
        assert len(set(settled([1.0, 1.00000001, 1e9]))) == 3

    def test_nothing_but_rounding(self) -> None:
        """All pairs equal: no verdict, no effect, and 0 where a number is told."""
        found = paired([NOISE[0]] * 5, [NOISE[1]] * 5)
        assert found is not None
        assert (found.mean, found.wilcoxon_p, found.sign_p, found.permutation_p) == (0, 1, 1, 1)
        assert (found.dz, found.t, found.interval, found.direction) == (None, None, None, 0)
        one = summary([0.1, 0.3 - 0.2, 0.1])
        assert one is not None
        assert (one.mean, one.sd, one.interval) == (pytest.approx(0.1), 0.0, None)

    def test_differences_that_cancel(self) -> None:
        """A mean of +.1, +.2 and -.3 is 0, and no direction."""
        found = paired([0.0, 0.0, 0.0], [0.1, 0.2, -0.3])
        assert found is not None
        assert found.mean == 0.0
        assert signed_rank([0.1, 0.2, -0.3])[:2] == (3.0, 3.0)

    def test_levels(self) -> None:
        """P of exactly alpha rejects, in the report as in `power` and `simulate`."""
        assert rejects(0.05, 0.05)
        assert rejects(0.1 + 0.2, 0.3)
        assert not rejects(0.0501, 0.05)


class TestDirection:
    """The headline goes the way of the test that decides."""

    def test_mean_against_ranks(self, tmp_path: Path) -> None:
        """19 of 20 pairs took longer with the gamepad; one pair turns the mean round."""
        text = report_of(CONTRARY, tmp_path)
        lead = text.split("\n\n")[1]
        assert (
            lead == "Length of the trial: longer with Gamepad than with Keyboard (19 of 20 pairs)."
        )
        assert "the mean points the other way than the ranks do, 7.70 s shorter" in text
        assert "The pair of participant P019 (difference −190 s) turns it" in text
        assert "without it the mean is 1.90 s longer with Gamepad" in text
        assert "less with Gamepad" not in text

    def test_as_a_secondary_outcome(self, tmp_path: Path) -> None:
        """There, too, what contradicts the ranks is said."""
        text = report_of(CONTRARY, tmp_path, primary="distance", secondary=["trial_time"])
        secondary = text[text.index("## Secondary outcomes") :]
        assert "the mean points the other way than the ranks do" in secondary

    def test_two_outliers(self, tmp_path: Path) -> None:
        """No single pair turns it: said as well."""
        second = [11.0 + 0.1 * at for at in range(18)] + [10.0, 10.0]
        columns = {"keyboard": [10.0] * 18 + [200.0, 200.0], "gamepad": second}
        text = with_values(tmp_path / "a", "trial_time", columns)
        assert "longer with Gamepad than with Keyboard (18 of 20 pairs)." in text
        assert "It is not one value alone that turns it." in text

    def test_counts(self, tmp_path: Path) -> None:
        """Of what is no time there is more or less."""
        columns = {
            "keyboard": [1.0] * 11 + [60.0],
            "gamepad": [2.0 + at for at in range(11)] + [0.0],
        }
        text = with_values(tmp_path / "a", "collisions", columns)
        columns = {"keyboard": [5.0] * 8, "gamepad": [4.0 - 0.1 * at for at in range(8)]}
        other = with_values(tmp_path / "b", "collisions", columns)
        assert "Collisions with the world: 1.35 per minute less with Gamepad" in other
        assert "more with Gamepad than with Keyboard" in text

    def test_between_participants(self, tmp_path: Path) -> None:
        """Direction by Cliff's delta; the value that turns the mean is named."""
        columns = {
            "keyboard": [*(10.0 + 0.1 * at for at in range(11)), 500.0],
            "gamepad": [20.0 + 0.1 * at for at in range(12)],
        }
        text = with_values(tmp_path / "a", "trial_time", columns, between=True)
        lead = text.split("\n\n")[1]
        assert lead.startswith("Length of the trial: longer with Gamepad than with Keyboard (92 %")
        assert "The value of participant P11 (500 s) turns it" in text

    def test_three_conditions(self, tmp_path: Path) -> None:
        """Of every pair of conditions that differs."""
        base = [10.0] * 19 + [400.0]
        columns = {
            "one": base,
            "two": [11.0 + 0.1 * at for at in range(19)] + [9.0],
            "three": [21.0 + 0.1 * at for at in range(19)] + [8.0],
        }
        text = with_values(tmp_path / "a", "trial_time", columns)
        assert "One, Two and Three differ." in text
        assert text.count("the mean points the other way than the ranks do") == 2


class TestSentences:
    """Every sentence is true of its numbers."""

    def test_interval_without_zero_and_no_verdict(self, tmp_path: Path) -> None:
        """Where interval and test disagree the report says which one decides."""
        columns = {"keyboard": [0.0] * 5, "gamepad": [1.0, 2.0, 3.0, 4.0, 5.0]}
        text = with_values(tmp_path / "a", "trial_time", columns)
        assert "no difference was found between Keyboard and Gamepad" in text
        assert "does not include 0. The test that decides goes by ranks, and it does not" in text

    def test_no_interval(self, tmp_path: Path) -> None:
        """With two pairs there is none, and no sentence about it, below pictures neither."""
        text = with_values(
            tmp_path / "a", "trial_time", {"keyboard": [1.0, 2.0], "gamepad": [3.0, 5.0]}
        )
        assert "the interval of the difference says" not in text
        assert "(no interval)" in text
        html = (tmp_path / "a" / "report.html").read_text()
        assert "Diamonds: means." in html
        assert ">mean</text>" in html
        assert len(re.findall("95 % interval(?!</th>)", html)) == 0

    def test_orders_of_those_who_count(self, tmp_path: Path) -> None:
        """A period effect does not bias only where those who count met balanced orders."""
        values = [float(at) for at in range(12)]
        columns = {"keyboard": values, "gamepad": [one + 1.5 + one % 3 for one in values]}
        even = with_values(tmp_path / "a", "trial_time", columns)
        assert "in balanced orders" in even
        uneven = with_values(tmp_path / "b", "trial_time", columns, starts=8)
        assert "Orders are not balanced" in uneven
        assert "(Keyboard then Gamepad: 8, Gamepad then Keyboard: 4)" in uneven

    def test_one_of_each(self, tmp_path: Path) -> None:
        """One participant counts, and one order has no test."""
        columns = {"keyboard": [1.0], "gamepad": [2.0]}
        text = with_values(tmp_path / "a", "trial_time", columns)
        assert "1 participant counts of 20 planned" in text
        assert "their smallest p is 1.000" in text
        columns = {"keyboard": [1.0, 2.0, 3.0], "gamepad": [2.0, 2.5, 4.0]}
        text = with_values(tmp_path / "b", "trial_time", columns, starts=3)
        assert "There are too few values for a test." in text
        assert "Test: cannot" not in text

    @pytest.mark.parametrize(
        ("value", "text"),
        [
            (0.0, "0"),
            (0.0004, "0.000400"),
            (-0.0123, "−0.0123"),
            (0.5, "0.500"),
            (9.996, "10.0"),
            (1234.4, "1234"),
            (-1e-8, "−1.00e−08"),
        ],
    )
    def test_numbers(self, value: float, text: str) -> None:
        """What is not 0 is not written as 0."""
        assert number(value) == text

    def test_spans(self) -> None:
        """An end that is not 0 is not written as 0 beside a large one."""
        assert span(0.0004, 52.0) == "0.000400 to 52.0"
        assert span(-46.1, 2.0) == "−46.1 to 2.0"

    @pytest.mark.parametrize(
        ("p", "alpha", "text"),
        [
            (0.0312, 0.05, "0.031"),
            (0.04996, 0.05, "0.050"),
            (0.0504, 0.05, "0.0504"),
            (0.0500004, 0.05, "0.0500004"),
            (0.0254, 0.025, "0.0254"),
            (0.0002, 0.05, "< 0.001"),
            (0.0002, 0.0001, "0.0002"),
        ],
    )
    def test_p_values(self, p: float, alpha: float, text: str) -> None:
        """Rounding never moves one to the other side of the level."""
        assert p_value(p, alpha) == text

    def test_methods_say_what_is_exact(self, tmp_path: Path) -> None:
        """Tests of three and more conditions are not."""
        text = report_of(CONTRARY, tmp_path)
        assert re.search(r"Rank tests of two conditions are exact", text)


@pytest.mark.parametrize(
    ("less", "more", "equal"), [(0.36, 0.40, True), (0.9, 1.0, True), (0.35, 0.4, False)]
)
def test_layouts_that_differ_by_ten_percent(less: float, more: float, equal: bool) -> None:
    """Exactly 10 % is allowed, whatever the last bits say."""
    assert alike(less, more) is equal
