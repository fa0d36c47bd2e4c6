"""Reports: what was planted is found, all of it is told, the same bytes every time (HRI-12)."""

from __future__ import annotations

import re
import shutil
import time
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from usarsim_report.page import Page
from usarsim_report.svg import COLOURS, picture
from usarsim_server import cli
from usarsim_study import report, tables
from usarsim_study.analysis import Analysis, analyse
from usarsim_study.dataset import collect
from usarsim_study.folder import StudyFolder
from usarsim_study.plots import forest, primary
from usarsim_study.synthetic import STUDY, Plan, make_study

PLANTED = Plan(20, effect=1.0, aborted=1, excluded=1, skipped=1)
THREE = STUDY.replace(
    '[[layout]]\nname = "A"',
    '[[condition]]\nname = "touch"\nlabel = "Touch"\n\n[[layout]]\nname = "A"',
    1,
).replace('[[layout]]\nname = "B"\nmission = "office-b.toml"\n\n', "")
BETWEEN = STUDY.replace("participants =", 'design = "between"\nparticipants =', 1).partition(
    '[[form]]\nname = "which"'
)[0]


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a made-up study with an effect, reported."""
    path = tmp_path_factory.mktemp("planted")
    make_study(path, PLANTED)
    assert cli.main(["study", "report", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def analysis(planted: Path) -> Analysis:
    """What its tables say."""
    return analyse(tables.read(planted / "data"))


class TestVerdict:
    """A planted advantage is found, a null study finds none."""

    def test_planted(self, planted: Path, analysis: Analysis) -> None:
        """Of 20 participants and dz = 1."""
        outcome = analysis.outcomes[0]
        assert outcome.p is not None
        assert outcome.p < analysis.alpha
        assert outcome.comparisons[0].result.mean > 0.0
        text = (planted / "report.md").read_text()
        assert "more with Gamepad than with Keyboard" in text

    @pytest.mark.slow
    def test_null(self, tmp_path: Path) -> None:
        """Without an effect neither the primary nor, after Holm, any secondary outcome differs."""
        found = analyse(collect(make_study(tmp_path, Plan(20, seed=3))))
        assert found.outcomes[0].p is not None
        assert found.outcomes[0].p > 0.05
        assert all(one.holm is not None and one.holm > 0.05 for one in found.outcomes[1:])
        sections = report.Sections(found)
        assert "no difference was found between Keyboard and Gamepad" in sections.markdown()

    def test_learning_is_an_order_effect(self, tmp_path: Path) -> None:
        """Three victims more in the second trial: found as period, not as a difference."""
        plan = Plan(20, learning=3.0, seed=5)
        found = analyse(collect(make_study(tmp_path, plan)))
        assert found.orders[0].period_p is not None
        assert found.orders[0].period_p < 0.01
        assert found.outcomes[0].p is not None
        assert found.outcomes[0].p > 0.05


class TestContents:
    """HRI-12, HRI-11, O-57."""

    def test_everything_is_told(self, planted: Path, analysis: Analysis) -> None:
        """n, exclusions with reasons, missing per cell, means, medians, intervals, tests, effect
        sizes, Holm, order, preference (HRI-12, O-57)."""
        text = (planted / "report.html").read_text()
        assert "19 participants count of 20 planned" in text
        assert "did not pass the training" in text
        assert "pad lost" in text
        rows = {one.measure.name: one for one in analysis.outcomes}
        for cell in rows["victims_found"].cells:
            assert f"<td>{len(cell.known)} ({cell.missing})</td>" in text
        assert sum(cell.missing for cell in rows["victims_found"].cells) == 1
        assert sum(cell.missing for cell in rows["tlx_raw"].cells) == 2
        for word in (
            *("Median", "95 % interval", "Wilcoxon p", "Holm p", "Rank-biserial", "dz"),
            *("Sign p", "Permutation p", "Period p", "Carried over p", "Preference", "exact"),
        ):
            assert word in text, word

    def test_numbers_have_their_units(self, planted: Path) -> None:
        """In the tables of the primary and of secondary outcomes, of tests, of order, of further
        measures and of definitions."""
        text = (planted / "report.md").read_text()
        assert "| Victims found [victims] | n | Mean" in text
        assert "| Display to mark [s], Keyboard |" in text
        assert text.count("| Distance [m] |") == 3
        assert text.count("| Mean dwell [s] |") == 2

    def test_shares_have_no_unit(self, tmp_path: Path) -> None:
        """Neither in tables nor at axes."""
        share = STUDY.replace('"victims_found"', '"teleoperation_share"', 1)
        page = report.Sections(analyse(collect(make_study(tmp_path, Plan(4), share))))
        assert "| Teleoperation share | n | Mean" in page.markdown()
        assert not re.search(r"\| 1 \||\[1\]", page.markdown().partition("## Order")[2])
        texts = re.findall(r"<text[^>]*>([^<]*)</text>", page.html())
        assert "Gamepad minus Keyboard" in texts
        assert texts.count("Teleoperation share") >= 2

    def test_nothing_empty_is_drawn(self, planted: Path, tmp_path: Path) -> None:
        """Before anybody came to the end there are neither pictures nor tables of numbers; a
        secondary outcome without values is named instead of an empty picture."""
        found = tables.read(planted / "data")
        nobody = replace(found, participants=())
        text = report.Sections(analyse(nobody)).html()
        assert "Nobody has taken part to the end" in text
        assert "<svg" not in text
        assert 'class="numbers"' not in text
        trials = [replace(one, values={**one.values, "distance": None}) for one in found.trials]
        page = report.Sections(analyse(replace(found, trials=tuple(trials))))
        assert "Without any value, and not below: Distance." in page.markdown()
        assert "| Distance [m], Keyboard |" not in page.markdown()
        secondary = page.html().partition("Secondary outcomes</h2>")[2].partition("</figure>")[0]
        assert "Switches" in secondary
        assert "Distance</text>" not in secondary

    def test_numbers_are_those_of_the_analysis(self, planted: Path, analysis: Analysis) -> None:
        """Mean and interval of the primary difference, as printed."""
        result = analysis.outcomes[0].comparisons[0].result
        for name in ("report.html", "report.md"):
            text = (planted / name).read_text()
            assert report.number(result.mean) in text
            assert report.interval(result.interval) in text

    def test_one_file_without_network(self, planted: Path) -> None:
        """Below 3 MB; no script, nothing that is loaded (HRI-12)."""
        text = (planted / "report.html").read_text()
        assert len(text.encode()) < 3_000_000
        assert not re.search(r"<script|<link|<img|@import|src=|url\((?!#)", text)
        assert set(re.findall(r'href="([^"]?)', text)) <= {"#"}

    def test_every_participant_is_visible(self, planted: Path, analysis: Analysis) -> None:
        """One mark each per condition, and one per difference (HRI-12)."""
        text = (planted / "report.html").read_text()
        svg = text[text.index("<svg") : text.index("</svg>")]
        cells = analysis.outcomes[0].cells
        result = analysis.outcomes[0].comparisons[0].result
        sides = (result.negative, result.positive)  # type: ignore[union-attr]
        for cell, side, colour in zip(cells, sides, COLOURS, strict=False):
            marks = re.findall(rf"<use [^>]*fill: {colour}", svg)
            assert len(marks) == len(cell.known) + side

    def test_no_outcome_is_left_out(self, planted: Path, analysis: Analysis) -> None:
        """A mean difference of exactly 0 has its place beside the others."""
        outcome = analysis.outcomes[1]
        zero = replace(outcome.comparisons[0].result, mean=0.0, dz=0.0)
        flat = replace(outcome, comparisons=(replace(outcome.comparisons[0], result=zero),))
        svg = forest([analysis.outcomes[0], flat])
        assert outcome.measure.title in svg

    def test_no_range_of_hundredths_around_equal_values(self, analysis: Analysis) -> None:
        """Where nobody found any, or all the same, axes tell no parts of victims, none below 0."""
        outcome = analysis.outcomes[0]
        for value, ticks in ((0.0, {"0.0", "1.0"}), (3.0, {"0", "6"})):
            cells = [replace(one, values={"A": value}, summary=None) for one in outcome.cells]
            svg = primary(replace(outcome, cells=tuple(cells), comparisons=()), True)
            told = set(re.findall(r">([^<\n]+)</text>", svg))
            assert told >= ticks
            assert "−0.02" not in told
            assert {"−1.00", "1.00"} <= told  # differences that are all 0

    def test_identifiers_are_unique(self, planted: Path) -> None:
        """Several pictures on one page do not share definitions."""
        text = (planted / "report.html").read_text()
        found = re.findall(r'\bid="([^"]+)"', text)
        assert len(found) == len(set(found))

    def test_regenerating_is_byte_identical(self, planted: Path, tmp_path: Path) -> None:
        """Also from the exported CSV alone (HRI-12, O-57)."""
        before = {name: (planted / name).read_bytes() for name in ("report.html", "results.csv")}
        data = tmp_path / "data"
        shutil.copytree(planted / "data", data)
        assert cli.main(["study", "report", str(data)]) == 0
        for name, content in before.items():
            assert (data / name).read_bytes() == content

    def test_after_forgetting(self, planted: Path, tmp_path: Path) -> None:
        """The report still runs, with one participant less (HRI-16)."""
        path = tmp_path / "copy"
        shutil.copytree(planted, path)
        code = StudyFolder(path).participants()[2].code
        assert cli.main(["study", "forget", str(path), code]) == 0
        assert cli.main(["study", "report", str(path)]) == 0
        text = (path / "report.html").read_text()
        assert "18 participants count" in text
        assert code not in text


class TestDesigns:
    """Other studies than two conditions within participants."""

    @pytest.mark.slow
    def test_three_conditions(self, tmp_path: Path) -> None:
        """Friedman's test, then pairs corrected by Holm."""
        found = analyse(collect(make_study(tmp_path, Plan(12, effect=2.0), THREE)))
        outcome = found.outcomes[0]
        assert outcome.overall is not None
        assert outcome.p == outcome.overall.p
        assert len(outcome.comparisons) == 3
        assert all(one.holm is not None and one.holm >= one.p for one in outcome.comparisons)
        assert "Friedman" in report.Sections(found).html()

    def test_between(self, tmp_path: Path) -> None:
        """Mann and Whitney's test of different participants."""
        found = analyse(collect(make_study(tmp_path, Plan(8, effect=2.0), BETWEEN)))
        assert [len(cell.values) for cell in found.outcomes[0].cells] == [4, 4]
        assert found.orders == ()
        text = report.Sections(found).html()
        assert "Cliff&#x27;s delta" in text or "Cliff's delta" in text

    @pytest.mark.parametrize("plan", [Plan(4, excluded=4), Plan(4, excluded=3), Plan(4, aborted=4)])
    def test_hardly_anybody(self, tmp_path: Path, plan: Plan) -> None:
        """Nobody, one participant, or no complete pair: said, not guessed."""
        text = report.Sections(analyse(collect(make_study(tmp_path, plan)))).markdown()
        count = 4 - plan.excluded
        told = "1 participant counts" if count == 1 else f"{count} participants count"
        assert told in text
        assert "nan" not in text


@pytest.mark.slow
def test_forty_participants_cost_little(tmp_path: Path) -> None:
    """Less than 20 s of processor, logs read included."""
    folder = make_study(tmp_path, Plan(40, effect=0.5))
    begin = time.process_time()
    report.write(collect(folder), tmp_path)
    assert time.process_time() - begin < 20.0


def test_no_folder_is_one_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2 and a cure."""
    assert cli.main(["study", "report", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("error: ")


def test_what_a_picture_shows_is_text() -> None:
    """Whatever is in its label, it stays in there."""
    label = r'a" onload="alert(1)"><script>\g<1>'
    svg = picture("p", label, 1.0, 1.0, lambda figure: None)
    assert ElementTree.fromstring(svg).get("aria-label") == label
    assert "<script" not in svg


@pytest.mark.parametrize(
    ("typed", "written"),
    [
        ("<img src=//x onerror=a()>", r"\<img src=//x onerror=a()>"),
        (r"\<b>", r"\\\<b>"),
        ("![a](http://x/p.png)", r"![a]\(http://x/p.png)"),
        ("[a][b] and [b]: //x", r"[a]\[b] and [b]\: //x"),
        ("one\n# two\u2028three", "one # two three"),
        ("a|b, p < 0.05, [0.1, 0.4]", "a|b, p < 0.05, [0.1, 0.4]"),
    ],
)
def test_what_markdown_shows_is_text(typed: str, written: str) -> None:
    """Names and reasons that people typed run no tag and load no picture in who shows the report,
    and begin no line of their own."""
    page = Page(typed)
    page.heading(typed)
    page.paragraph(typed)
    page.table(["", typed], [["row", typed]])
    cell = written.replace("|", "\\|")
    told = [f"# {written}", f"## {written}", written]
    table = f"|  | {cell} |\n| --- | --- |\n| row | {cell} |"
    assert page.markdown().split("\n\n") == [*told, f"{table}\n"]
