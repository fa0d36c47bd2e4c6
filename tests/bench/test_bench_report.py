"""Reports of measurements: figures, aims, and their three forms."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime

import psutil
import pytest

from benchmarks.reports import as_markdown
from usarsim_bench.figures import Aim, Figure, Report, Section, as_json, as_text, describe_machine

MACHINE = {"Processor": "Abacus | 2", "Cores": "2 of 4", "mujoco": "3.17.0"}


def report(*figures: Figure) -> Report:
    """A report of one section."""
    section = Section("team", "A team", "Somebody drives " + "around " * 30, figures)
    return Report(MACHINE, datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC), (section,))


GOOD = Figure("Factor", 0.9994, "", 4, Aim(">=", 0.999))
BAD = Figure("Use", 12345.678, "cores", 1, Aim("<", 1.2))
PLAIN = Figure("Lines", 10.0, "1/s", 0)


class TestAim:
    @pytest.mark.parametrize(
        ("relation", "below", "equal", "above"),
        [(">=", False, True, True), ("<=", True, True, False), ("<", True, False, False)],
    )
    def test_relations(self, relation: str, below: bool, equal: bool, above: bool) -> None:
        """Each relation means what it says, at the limit too."""
        aim = Aim(relation, 2.0)  # type: ignore[arg-type]
        assert [aim.met_by(value) for value in (1.0, 2.0, 3.0)] == [below, equal, above]

    @pytest.mark.parametrize("relation", [">=", "<=", "<"])
    def test_not_a_number_never_meets(self, relation: str) -> None:
        """A figure that could not be computed is no success."""
        assert not Aim(relation, 1.0).met_by(math.nan)  # type: ignore[arg-type]


def test_figures_have_verdicts_and_digits() -> None:
    """A figure meets its aim, misses it, or has none; thousands are set apart."""
    assert (GOOD.met, BAD.met, PLAIN.met) == (True, False, None)
    assert [figure.text for figure in (GOOD, BAD, PLAIN)] == ["0.9994", "12,345.7", "10"]
    assert report(GOOD, BAD, PLAIN, BAD).missed == 2


class TestText:
    def test_columns_are_aligned(self) -> None:
        """Values end in one column, aims begin in one."""
        rows = [line for line in as_text(report(GOOD, BAD)).splitlines() if line.startswith("  ")]
        ends = [row.index(text) + len(text) for row, text in zip(rows, ["0.9994", "12,345.7"])]  # noqa: B905
        assert ends[0] == ends[1]
        assert rows[0].index(">=") == rows[1].index("<")

    def test_tells_machine_time_and_what_was_missed(self) -> None:
        """A missed aim stands out, the end counts them, and long explanations are wrapped."""
        text = as_text(report(GOOD, BAD, PLAIN))
        assert max(map(len, text.splitlines())) <= 100
        for words in ("2026-01-02 03:04 UTC", "Abacus", "2 of 4", "MISSED"):
            assert words in text
        assert text.endswith("1 of 2 aims met.")
        assert as_text(report(PLAIN)).endswith("No aims are set for these figures.")


class TestFailure:
    BROKEN = Report(
        MACHINE,
        datetime(2026, 1, 2, tzinfo=UTC),
        (Section("a", "One", "", (), "the server died"), Section("b", "Two", "So.", (GOOD,))),
    )

    def test_is_told_in_all_forms(self) -> None:
        """The reason stands where the figures would, and the other sections are there."""
        assert "One\nFAILED: the server died\n\nTwo\nSo.\n  Factor" in as_text(self.BROKEN)
        page = as_markdown(self.BROKEN)
        assert "## One\n\nFAILED: the server died\n\n## Two" in page
        sections = json.loads(as_json(self.BROKEN))["sections"]
        assert [section["failure"] for section in sections] == ["the server died", None]

    def test_is_counted_apart_from_missed_aims(self) -> None:
        """What was not measured has neither met nor missed an aim."""
        assert self.BROKEN.failed == ["a"]
        assert self.BROKEN.missed == 0


class TestMarkdown:
    def test_every_row_has_as_many_cells_as_its_head(self) -> None:
        """Tables are well formed, also where a cell contains a bar."""
        tables: list[list[str]] = [[]]
        for line in as_markdown(report(GOOD, BAD, PLAIN)).splitlines():
            if line.startswith("|"):
                tables[-1].append(line)
            elif tables[-1]:
                tables.append([])
        found = [table for table in tables if table]
        assert len(found) == 2
        assert "| Use | 12,345.7 | cores | < 1.2 | MISSED |" in found[1]
        for table in found:
            counts = {line.replace("\\|", "").count("|") for line in table}
            assert len(counts) == 1
            assert set(table[1]) <= set("| -")


class TestAllAims:
    SECTIONS = (
        Section("a", "One", "So.", (GOOD, PLAIN)),
        Section("b", "Two", "So.", (BAD,)),
        Section("c", "Three", "So.", (PLAIN,)),
    )
    MANY = Report(MACHINE, datetime(2026, 1, 2, tzinfo=UTC), SECTIONS)

    def test_stand_in_one_table(self) -> None:
        """Of several sections everything that has an aim is found at a glance, and only that."""
        table = as_markdown(self.MANY).split("## All aims\n\n")[1].split("\n\n")[0]
        assert table.splitlines() == [
            "| What | Measured | Aim |  |",
            "| --- | --- | --- | --- |",
            "| a: Factor | 0.9994 | >= 0.999 | met |",
            "| b: Use | 12,345.7 cores | < 1.2 | MISSED |",
        ]

    def test_end_the_text(self) -> None:
        """On a terminal the last lines are those that are looked at first."""
        last = as_text(self.MANY).split("All aims\n")[1].splitlines()
        assert [line.split(":")[0].strip() for line in last[:2]] == ["a", "b"]
        assert last[-1] == "1 of 2 aims met."

    def test_of_one_section_are_not_repeated(self) -> None:
        """A single table needs no second one."""
        assert "All aims" not in as_text(report(GOOD)) + as_markdown(report(GOOD))


class TestJson:
    def test_is_read_back(self) -> None:
        """Values keep their full precision, aims and verdicts are there."""
        document = json.loads(as_json(report(GOOD, BAD, PLAIN)))
        figures = document["sections"][0]["figures"]
        assert [figure["value"] for figure in figures] == [0.9994, 12345.678, 10.0]
        assert [figure["met"] for figure in figures] == [True, False, None]
        assert [figure["aim"] for figure in figures] == [">= 0.999", "< 1.2", None]
        assert document["machine"] == MACHINE
        assert document["taken"] == "2026-01-02T03:04:05+00:00"
        assert document["missed"] == 1

    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    def test_has_no_numbers_that_json_lacks(self, value: float) -> None:
        """What is not finite becomes null; strict readers accept the text."""
        text = as_json(report(Figure("Odd", value)))

        def refuse(word: str) -> object:
            raise AssertionError(word)

        document = json.loads(text, parse_constant=refuse)
        assert document["sections"][0]["figures"][0]["value"] is None


def test_the_machine_says_what_figures_depend_on() -> None:
    """Processor, cores, Python and the versions of all that computes are named."""
    facts = describe_machine("1.2.3")
    assert facts["usarsim-server"] == "1.2.3"
    assert facts["mujoco"][0].isdigit()
    assert facts["Processor"]
    assert facts["Memory"] == f"{psutil.virtual_memory().total / 2**30:.1f} GiB"
