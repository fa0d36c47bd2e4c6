"""Names that programs for statistics do not read as words: refused, or told in begun studies."""

from __future__ import annotations

import csv
import io
import subprocess
import sys
from pathlib import Path

import pytest
from example import STUDY

from usarsim_server import cli
from usarsim_study import tables
from usarsim_study.dataset import AnswerRow, Dataset, ParticipantRow, PartRow, TrialRow, collect
from usarsim_study.errors import StudyError
from usarsim_study.folder import StudyFolder
from usarsim_study.measures import MEASURES
from usarsim_study.misread import MISSING, misread
from usarsim_study.study_file import SHIPPED, Study, read_study, words
from usarsim_study.synthetic import STUDY as MADE_UP
from usarsim_study.synthetic import Plan, make_study

PANDAS = (
    *("#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "-NaN", "-nan", "1.#IND", "1.#QNAN"),
    *("<NA>", "N/A", "NA", "NULL", "NaN", "None", "n/a", "nan", "null"),
)
"""What `pandas.read_csv` reads as missing by default, beside empty cells."""
PLACES = {
    "condition": ('name = "gamepad"', "line 13: [[condition]] 2"),
    "layout": ('name = "B"', "line 24: [[layout]] 2"),
    "form": ('name = "workload"', "[[form]] 2"),
    "item": ('name = "hand"', "[[form]] 1 (before): [[item]] 2"),
    "choice": ('name = "right"', "[[form]] 1 (before): [[item]] 2 (hand): [[choice]] 2"),
}


def written(folder: Path, text: str) -> Path:
    """A study file."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    "word", ["NA", "na", "Na", "null", "NULL", "None", "none", "nan", "NaN", "n/a", "N/A", "#NA"]
)
def test_names_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], place: str, word: str
) -> None:
    """In any case of letters, with the reason, at the line."""
    old, where = PLACES[place]
    path = written(tmp_path, STUDY.replace(old, f'name = "{word}"', 1))
    assert cli.main(["study", "check", str(path), "--without-missions"]) == 2
    told = capsys.readouterr().err
    assert where in told
    assert f"pandas reads '{word}' in a table as a missing value, quoted or not" in told


@pytest.mark.parametrize(
    ("word", "taken"),
    [("true", "a truth value"), ("False", "a truth value"), ("inf", "a number")],
)
def test_words_that_are_no_text_alone(tmp_path: Path, word: str, taken: str) -> None:
    """A column of nothing else would be truth values or numbers."""
    path = written(tmp_path, STUDY.replace('name = "B"', f'name = "{word}"', 1))
    with pytest.raises(StudyError, match=taken):
        read_study(path)


def test_the_list_is_that_of_pandas() -> None:
    """Every word of its documentation, in any case."""
    assert {one.casefold() for one in PANDAS} == MISSING
    assert misread(" NaN ") == "a missing value"
    for word in ("nature", "none-at-all", "A", "nothing", "NA1", "T"):
        assert misread(word) == ""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up study whose first condition is called NA, and its first layout None."""
    path = tmp_path_factory.mktemp("begun")
    # As under the rules before: the list of assignments is there, with these names.
    text = MADE_UP.replace('name = "keyboard"', 'name = "NA"').replace(
        'name = "A"', 'name = "None"'
    )
    (path / "allocation.csv").touch()
    study = read_study(written(path, text.format(seed=1, participants=8)))
    (path / "allocation.csv").unlink()
    study.allocation.export(path)
    make_study(path, Plan(8, effect=1.0), text)
    return path


class TestBegun:
    """A study that has begun goes on."""

    def test_it_is_reported_with_a_warning(self, folder: Path) -> None:
        """In the report and in the data dictionary, by column."""
        assert cli.main(["study", "report", str(folder)]) == 0
        text = (folder / "report.md").read_text(encoding="utf-8")
        assert "in the column condition of the tables pandas reads NA as missing" in text
        assert "in the column layout of the tables pandas reads None as missing" in text
        assert "8 participants count of 8" in text
        with (folder / "data" / "dictionary.csv").open(encoding="utf-8", newline="") as file:
            rows = {(one["table"], one["column"]): one["meaning"] for one in csv.DictReader(file)}
        assert "WARNING: pandas reads NA as missing" in rows["trials", "condition"]
        assert "keep_default_na=False" in rows["trials", "layout"]
        assert "WARNING" not in rows["participants", "participant"]
        data = tables.read(folder / "data")
        assert {one.condition for one in data.trials} == {"NA", "gamepad"}

    def test_it_is_checked_with_a_warning(
        self, folder: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """The same file elsewhere is refused."""
        assert cli.main(["study", "check", str(folder), "--without-missions"]) == 0
        assert "WARNING [[condition]] 1 (NA): name: pandas reads 'NA'" in capsys.readouterr().out
        assert StudyFolder(folder).study.condition[0].name == "NA"
        other = written(folder.parent / "elsewhere", (folder / "study.toml").read_text())
        with pytest.raises(StudyError, match="missing value"):
            read_study(other)
        assert read_study(other, folder).condition[0].name == "NA"


def everything_of(study: Study) -> Dataset:
    """Tables in which every name of a study stands, each column with one name only."""
    codes = ("BCDFGH",)
    conditions = [one.name for one in study.condition]
    layouts = [one.name for one in study.layout]
    blank = dict.fromkeys(MEASURES)
    rows = [
        (form.name, item.name, choice.name)
        for form in study.form
        for item in form.item
        for choice in item.choice
    ]
    rows += [(form.name, item.name, conditions[0]) for form in study.form for item in form.item]
    rows += [(form.name, "preferred", one) for form in study.form for one in conditions]
    return Dataset(
        {"title": study.title},
        tuple(ParticipantRow(one, 1, 1, "2026-01-01", "complete", "") for one in codes),
        tuple(
            TrialRow(codes[0], 1, 1, condition, layout, "complete", "", blank)
            for condition in conditions
            for layout in layouts
        ),
        (PartRow(codes[0], 1, "robot", "R1", "distance", 1.0),),
        tuple(
            AnswerRow(codes[0], 1, *row[:1], "questionnaire", *row[1:], None, None) for row in rows
        ),
    )


READ = """
import sys
import pandas
for table in ("participants", "trials", "parts", "answers"):
    frame = pandas.read_csv(f"{sys.argv[1]}/{table}.csv")
    for name in ("participant", "condition", "layout", "who", "form", "item", "answer"):
        for value in frame[name] if name in frame else ():
            assert isinstance(value, str), (table, name, value)
        for value in frame[name].drop_duplicates() if name in frame else ():
            alone = pandas.read_csv(__import__("io").StringIO(f"a,b\\n{value},1\\n"))
            assert isinstance(alone["a"][0], str), (name, value)
            assert alone["a"][0] == value
"""


def test_pandas_reads_every_word(tmp_path: Path) -> None:
    """Without options, alone in its column or not: of the shipped studies and of the example."""
    pytest.importorskip("pandas")
    for number, path in enumerate((*sorted(SHIPPED.glob("*.toml")), written(tmp_path, STUDY))):
        tables.write(everything_of(read_study(path)), tmp_path / str(number))
        done = subprocess.run(
            [sys.executable, "-c", READ, str(tmp_path / str(number))],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr


def test_every_name_that_comes_into_tables_is_looked_at(tmp_path: Path) -> None:
    """As the tables of a study have them."""
    study = read_study(written(tmp_path, STUDY))
    known = {name for _, name in words(study)}
    dataset = everything_of(study)
    used = {one.condition for one in dataset.trials} | {one.layout for one in dataset.trials}
    used |= {one.form for one in dataset.answers} | {one.answer for one in dataset.answers}
    used |= {one.item for one in dataset.answers} - {"preferred"}
    assert used == known


def test_no_warning_without_reason(tmp_path: Path) -> None:
    """Usual names have none, in the dictionary nor in the report."""
    data = collect(make_study(tmp_path, Plan(4)))
    tables.write(data, tmp_path / "data")
    assert "WARNING" not in (tmp_path / "data" / "dictionary.csv").read_text(encoding="utf-8")
    out = io.StringIO((tmp_path / "data" / "datapackage.json").read_text(encoding="utf-8"))
    assert "WARNING" not in out.getvalue()
