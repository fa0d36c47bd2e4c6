"""Checks are found, chosen, run and judged, and reported: JSON and back, JUnit, pages, tables."""

from __future__ import annotations

import asyncio
import io
import re
from collections.abc import Awaitable, Callable
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest

from usarsim_conformance import registry
from usarsim_conformance.case import Case
from usarsim_conformance.mutants.control_server import control_server
from usarsim_conformance.registry import (
    Check,
    Failed,
    Result,
    Severity,
    Verdict,
    all_checks,
    check,
    select,
)
from usarsim_conformance.report import Report, Rule, as_json, from_json
from usarsim_conformance.reports import (
    Teller,
    as_junit,
    as_list,
    as_page,
    as_text,
    compare,
    named_apart,
    summary,
)
from usarsim_conformance.runner import Progress, judge_all
from usarsim_conformance.survey import Target


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks made meanwhile are forgotten."""
    monkeypatch.setattr(registry, "_CHECKS", dict(registry._CHECKS))


def judged(
    *ids: str, tell: Callable[[Progress], None] = lambda progress: None, gives_up: float = 60.0
) -> Report:
    """Some checks against a healthy small server."""
    chosen = [one for one in registry._CHECKS.values() if one.id in ids]

    async def run() -> Report:
        async with control_server() as port:
            target = Target(ports={"control": port}, robot="P2AT", dialect="ut2004")
            return await judge_all(target, chosen, tell=tell, gives_up=gives_up)

    return asyncio.run(run())


@pytest.mark.usefixtures("fresh")
class TestNewCheck:
    def test_one_function_is_enough(self) -> None:
        """A decorated function is a check: it is found, run, and its docstring is the rule."""

        @check("control.kit.answers", "Answers", source="nowhere", dialects=registry.UT2004)
        async def answers(case: Case) -> None:
            """The server answers
            requests."""
            robot = await case.spawn()
            line = await robot.client.ask("GETCONF {Type Robot}", "CONF {")
            case.expect(line.get("Name") == "P2AT", f"{line}")

        assert "control.kit.answers" in {one.id for one in all_checks()}
        report = judged("control.kit.answers")
        assert report.results[0].verdict is Verdict.PASS
        assert report.rule("control.kit.answers").rule == "The server answers requests."

    @pytest.mark.parametrize(
        ("raise_it", "verdict"),
        [
            (lambda case: case.fail("seen"), Verdict.FAIL),
            (lambda case: case.expect(0, "seen"), Verdict.FAIL),
            (lambda case: case.skip("seen"), Verdict.NOT_APPLICABLE),
            (lambda case: case.need(None, "seen"), Verdict.INCONCLUSIVE),
            (lambda case: dict[str, int]()["seen"], Verdict.INCONCLUSIVE),
        ],
    )
    def test_words_become_verdicts(
        self, raise_it: Callable[[Case], object], verdict: Verdict
    ) -> None:
        """What a check says, or that it breaks, becomes a verdict with its reason."""

        @check("control.kit.says", "Says", source="nowhere", dialects=registry.ONCE)
        async def says(case: Case) -> None:
            """Says something."""
            raise_it(case)

        result = judged("control.kit.says").results[0]
        assert result.verdict is verdict
        assert "seen" in result.reason

    def test_a_check_that_never_ends(self) -> None:
        """It is given up after its time, inconclusively."""

        @check("control.kit.ever", "Ever", source="nowhere", dialects=registry.ONCE)
        async def ever(case: Case) -> None:
            """Never ends."""
            await asyncio.sleep(60.0)

        result = judged("control.kit.ever", gives_up=0.2).results[0]
        assert (result.verdict, result.reason) == (Verdict.INCONCLUSIVE, "not judged within 0.2 s")

    def test_exclusive_checks_run_alone(self) -> None:
        """No other check is at work while an exclusive one is; the others work together."""
        busy: list[str] = []
        seen: dict[str, int] = {}

        def make(name: str, exclusive: bool) -> Callable[[Case], Awaitable[None]]:
            async def work(case: Case) -> None:
                """Works."""
                busy.append(name)
                await asyncio.sleep(0.1)
                seen[name] = len(busy)
                busy.remove(name)

            return check(name, "x", source="x", dialects=registry.ONCE, exclusive=exclusive)(work)

        names = [f"control.kit.n{number}" for number in range(4)]
        for name in names:
            make(name, name.endswith("3"))
        judged(*names)
        assert seen["control.kit.n3"] == 1
        assert max(seen.values()) > 1

    def test_services_without_a_port(self) -> None:
        """Checks of a service that nobody named do not apply."""

        @check("images.kit.x", "x", source="x", service="images", dialects=registry.ONCE)
        async def looks(case: Case) -> None:
            """Looks."""
            raise AssertionError("must not run")

        assert judged("images.kit.x").results[0].verdict is Verdict.NOT_APPLICABLE

    def test_shared_things_are_made_once(self) -> None:
        """Checks that ask for the same thing get one; what went over the wire is shown to all."""
        made: list[str] = []

        async def make(case: Case) -> str:
            made.append(case.dialect)
            await (await case.connect()).send("HELLO")
            return "thing"

        async def ask(case: Case) -> None:
            """Asks."""
            case.fail(await case.shared("a thing", make))

        for name in ("control.kit.a", "control.kit.b"):
            check(name, "x", source="x", dialects=registry.UT2004)(ask)
        report = judged("control.kit.a", "control.kit.b")
        assert made == ["ut2004"]
        for result in report.results:
            assert result.reason == "thing"
            assert any("HELLO" in entry for entry in result.transcript)

    def test_progress_is_told(self) -> None:
        """After every check its result and how many are done."""

        @check("control.kit.p", "x", source="x", dialects=registry.ONCE)
        async def passes(case: Case) -> None:
            """Passes."""

        told: list[Progress] = []
        judged("control.kit.p", tell=told.append)
        assert [(one.done, one.total, one.check.id) for one in told] == [(1, 1, "control.kit.p")]

    @pytest.mark.parametrize(
        ("id", "service", "dialects", "source"),
        [
            ("Control.X", "control", (), "x"),
            ("control", "control", (), "x"),
            ("control.kit.x", "radio", (), "x"),
            ("control.kit.x", "control", ("ut99",), "x"),
            ("control.kit.x", "control", (), ""),
        ],
    )
    def test_mistakes_are_refused(
        self, id: str, service: str, dialects: tuple[str, ...], source: str
    ) -> None:
        """A check with a wrong name, service or dialect, or without source, cannot be made."""

        async def function(case: Case) -> None:
            """A rule."""

        with pytest.raises(ValueError, match=re.escape(id)):
            check(id, "x", source=source, service=service, dialects=dialects)(function)

    def test_a_name_is_taken_once(self) -> None:
        """Two functions of different files cannot be the same check, nor one without a rule."""

        async def function(case: Case) -> None:
            """A rule."""

        with pytest.raises(ValueError, match="two checks"):
            check("control.connection.greeting", "x", source="x")(function)
        function.__doc__ = None
        with pytest.raises(ValueError, match="needs a rule"):
            check("control.kit.x", "x", source="x")(function)


class TestAll:
    def test_checks_are_many(self) -> None:
        """The control port alone is judged by more than 120 rules, all services by over 200."""
        checks = all_checks()
        assert sum(one.service == "control" for one in checks) >= 120
        assert len(checks) >= 200
        assert len({one.id for one in checks}) == len(checks)

    @pytest.mark.parametrize("one", all_checks(), ids=lambda one: one.id)
    def test_every_check_is_explained(self, one: Check) -> None:
        """Names begin with the service; rule and title are sentences; a source is named."""
        assert one.id.startswith(f"{one.service}.")
        assert one.rule.endswith(".") or one.rule.endswith(".)")
        assert len(one.title) <= 60
        assert re.search(r"reference", one.source), one.source

    @pytest.mark.parametrize(
        ("pattern", "wanted"),
        [
            ("control.init.case", {"control.init.case"}),
            ("init.case", {"control.init.case"}),
            ("control.world.f*,*.init.second", {"control.world.form", "control.init.second"}),
            ("nothing-like-it", set()),
        ],
    )
    def test_patterns(self, pattern: str, wanted: set[str]) -> None:
        """A plain word fits anywhere, signs stand for anything, commas part several."""
        assert {one.id for one in select(all_checks(), pattern)} == wanted

    def test_no_pattern_fits_all(self) -> None:
        """Without a pattern all checks are chosen."""
        assert select(all_checks(), None) == all_checks()


def test_an_unreachable_server() -> None:
    """Nobody at the port is told at once, and is no verdict on any rule."""
    target = Target(ports={"control": 1}, robot="P2AT")
    with pytest.raises(Failed, match=re.escape("no connection to 127.0.0.1:1")):
        asyncio.run(judge_all(target, all_checks()[:1]))


def test_severities_are_used() -> None:
    """Rules differ in how bad it is to break them."""
    assert {one.severity for one in all_checks()} == set(Severity)


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
        teller = Teller(stream)
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
