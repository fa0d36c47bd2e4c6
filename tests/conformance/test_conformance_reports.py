"""Reports: JSON and back, JUnit, pages, tables, comparisons."""

from __future__ import annotations

import io
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest

from usarsim_conformance.registry import (
    Result,
    Severity,
    Verdict,
    all_checks,
)
from usarsim_conformance.report import Report, Rule, as_json, from_json
from usarsim_conformance.reports import (
    ProgressPrinter,
    as_junit,
    as_list,
    as_page,
    as_text,
    compare,
    named_apart,
    summary,
)
from usarsim_conformance.runner import Progress

_TRANSCRIPT = tuple(f"{n:8.3f} c1 < SEN <{n}> & \\r\\n" for n in range(20))


def rule(id: str, severity: Severity = Severity.MUST) -> Rule:
    """A rule with a name."""
    return Rule(
        id=id, title=f"Title of {id}", rule="It does <so>.", source="a reference",
        severity=severity, service="control",
    )  # fmt: skip


def result(check: str, verdict: Verdict, dialect: str = "udk", reason: str = "") -> Result:
    """A result with what went over the wire."""
    kept = () if verdict is Verdict.PASS else _TRANSCRIPT
    return Result(
        check=check, dialect=dialect, verdict=verdict, reason=reason, seconds=0.25, transcript=kept
    )


REPORT = Report(
    name="Server <1>",
    server={"address": "127.0.0.1:3000", "robot": "P2AT"},
    taken=datetime(2026, 1, 2, 3, 4, tzinfo=UTC),
    seconds=12.5,
    dialects=("ut2004", "udk"),
    rules=(
        rule("control.a.passes"),
        rule("control.a.breaks"),
        rule("control.b.notes", Severity.INFORMATIVE),
        rule("control.b.once", Severity.SHOULD),
    ),
    results=(
        result("control.a.passes", Verdict.PASS, "ut2004"),
        result("control.a.passes", Verdict.NOT_APPLICABLE, "udk", "no such sensor"),
        result("control.a.breaks", Verdict.PASS, "ut2004"),
        result("control.a.breaks", Verdict.FAIL, "udk", "saw <b>\x00 & 1\u2028"),
        result("control.b.notes", Verdict.FAIL, "udk", "only a note"),
        result("control.b.once", Verdict.INCONCLUSIVE, "", "in the dark"),
    ),
)


class TestReport:
    def test_what_conforms(self) -> None:
        """Only broken rules that must be kept count."""
        assert not REPORT.conforms
        mild = [replace(one, severity=Severity.SHOULD) for one in REPORT.rules]
        assert replace(REPORT, rules=tuple(mild)).conforms

    @pytest.mark.parametrize("staged", [False, True])
    def test_inconclusive(self, staged: bool) -> None:
        """Only in the kit's own world a rule that must be kept has to be judged."""
        results = (result("control.a.passes", Verdict.INCONCLUSIVE, "", "in the dark"),)
        found = replace(REPORT, results=results, staged=staged)
        assert found.conforms is not staged
        assert from_json(as_json(found)).conforms is not staged
        assert REPORT.count(Verdict.FAIL) == 2
        assert REPORT.count(Verdict.FAIL, Severity.INFORMATIVE) == 1

    def test_json_and_back(self) -> None:
        """Nothing is lost on the way through JSON."""
        assert from_json(as_json(REPORT)) == REPORT

    @pytest.mark.parametrize(
        "text", ["", "[]", "{}", '{"format": 2}', '{"format": 1, "name": "x"}', "null"]
    )
    def test_what_is_no_report(self, text: str) -> None:
        """Other JSON, and what is none, is refused with a reason."""
        with pytest.raises(ValueError, match=r"."):
            from_json(text)


class TestJUnit:
    def test_cases_and_counts(self) -> None:
        """A suite for each dialect; counts fit; notes and what does not apply are skipped."""
        root = ElementTree.fromstring(as_junit(REPORT))
        suites = {suite.get("name"): suite for suite in root}
        assert set(suites) == {"ut2004", "udk", "any dialect"}
        assert suites["udk"].get("tests") == "3"
        assert (suites["udk"].get("failures"), suites["udk"].get("skipped")) == ("1", "2")
        assert suites["any dialect"].get("errors") == "1"

    def test_bytes_that_xml_forbids(self) -> None:
        """What a server sent cannot spoil the document."""
        failure = ElementTree.fromstring(as_junit(REPORT)).find(".//failure")
        assert failure is not None
        assert failure.get("message") == "saw <b>? & 1\u2028"
        assert "SEN <3>" in (failure.text or "")


class _Tags(HTMLParser):
    """Tags, links and what they point at."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.sources: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "href":
                self.links.append(value or "")
            if name == "id":
                self.ids.add(value or "")
            if name == "src":
                self.sources.append(value or "")

    def handle_data(self, data: str) -> None:
        self.text += data


class TestPage:
    def test_complete_in_itself(self) -> None:
        """No other file is needed, every link leads to a finding of the page."""
        page = _Tags()
        page.feed(as_page([REPORT], "Title"))
        assert not page.sources
        assert page.links
        assert all(link[1:] in page.ids for link in page.links if link.startswith("#"))
        assert all(link.startswith("#") for link in page.links)

    def test_what_servers_say_is_text(self) -> None:
        """Signs of HTML in what was seen are shown, not obeyed."""
        source = as_page([REPORT], "<Title>")
        assert "<b>\x00" not in source
        assert "SEN &lt;3&gt; &amp;" in source
        assert "<title>&lt;Title&gt;</title>" in source

    def test_matrix(self) -> None:
        """Every rule has a row, with a verdict for each dialect; one for all counts for each."""
        source = as_page([REPORT], "Title")
        rows = source.split("<tbody>")[2].split("</tr>")
        row = next(row for row in rows if "control.b.once" in row)
        assert row.count(">??</a>") == 2
        row = next(row for row in rows if "control.a.breaks" in row)
        assert row.index(">pass<") < row.index(">FAIL</a>")

    def test_several_servers(self) -> None:
        """Each server has its columns."""
        other = replace(REPORT, name="Other", dialects=("udk",))
        source = as_page([REPORT, other], "Title")
        heads = source.split("<thead>")[1].split("</thead>")[0]
        assert heads.count("Server &lt;1&gt;") == 2
        assert heads.count("Other") == 1


class TestTerminal:
    def test_findings_are_shown(self) -> None:
        """What is broken is shown with rule, reason and the end of the transcript; the rest in a
        line each."""
        text = as_text(REPORT)
        assert "FAIL  control.a.breaks [udk]  (must)" in text
        assert "Rule: It does <so>. [a reference]" in text
        assert "c1 < SEN <19>" in text
        assert "c1 < SEN <2>" not in text
        assert "note  control.b.notes [udk]  only a note" in text
        assert "??    control.b.once  in the dark" in text
        assert text.endswith("Server <1> does NOT conform.")

    def test_counts(self) -> None:
        """The summary counts verdicts and broken rules by severity."""
        told = summary(REPORT)
        assert "4 checks, 6 verdicts in 12 s: 2 pass, 2 fail, 1 not applicable, 1 inc" in told
        assert "broken: 1 must, 1 informative" in told

    def test_areas(self) -> None:
        """A table tells for each area how many passed and failed."""
        rows = [row.split() for row in as_text(REPORT).splitlines() if row.startswith("control.")]
        assert rows == [["control.a", "2", "1", "1"], ["control.b", "1", "1"]]

    def test_list(self) -> None:
        """The list has a line for every check and their number."""
        checks = all_checks()
        lines = as_list(checks).splitlines()
        assert len(lines) == len(checks) + 1
        assert lines[-1] == f"{len(checks)} checks"

    def test_progress_into_a_file(self) -> None:
        """Without a terminal only findings and now and then a count are written, no escapes."""
        stream = io.StringIO()
        teller = ProgressPrinter(stream)
        for number, verdict in enumerate((Verdict.PASS, Verdict.FAIL, Verdict.PASS), start=1):
            found = result(all_checks()[0].id, verdict, reason="seen")
            teller(Progress(number, 3, all_checks()[0], found))
        teller.done()
        first, second = stream.getvalue().splitlines()
        assert first.startswith("FAIL")
        assert first.endswith("seen")
        assert second.startswith("3/3")
        assert "\x1b" not in stream.getvalue()


class TestCompare:
    def test_differences(self) -> None:
        """Checks with different verdicts are listed, the others counted."""
        better = replace(
            REPORT,
            name="Better",
            results=tuple(result(one.check, Verdict.PASS, one.dialect) for one in REPORT.results),
        )
        text = compare([REPORT, better])
        row = next(row for row in text.splitlines() if row.startswith("control.a.breaks"))
        assert row.split() == ["control.a.breaks", "pass", "FAIL", "pass", "pass"]
        assert "0 of 4 checks have the same verdict everywhere." in text
        assert "4 of 4 checks" in compare([better, better])

    def test_equal_names_are_told_apart(self) -> None:
        """Two reports of one name get numbers."""
        names = [one.name for one in named_apart([REPORT, REPORT, REPORT])]
        assert names == ["Server <1>", "Server <1> (2)", "Server <1> (3)"]
