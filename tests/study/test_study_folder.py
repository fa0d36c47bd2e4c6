"""Study folders: who took part, what is exported, what is forgotten."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from example import STUDY
from logs import minute

from usarsim_server import cli
from usarsim_study import tables
from usarsim_study.dataset import Dataset, collect
from usarsim_study.errors import StudyError
from usarsim_study.folder import FORMS, StudyFolder, append_form, values_of
from usarsim_study.forms import FormState
from usarsim_study.measures import MEASURES
from usarsim_study.records import last_line, read_lines
from usarsim_study.session.opening import next_participant
from usarsim_study.synthetic import Plan, make_study


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    """Eight made-up participants: one excluded, one trial cut off, one item skipped."""
    path = tmp_path_factory.mktemp("made") / "study"
    return make_study(path, Plan(8, effect=1.0, aborted=1, excluded=1, skipped=1))


@pytest.fixture(scope="module")
def dataset(made: StudyFolder) -> Dataset:
    """Its numbers."""
    return collect(made)


class TestFolder:
    """Who gets which trials, and what counts."""

    def test_admission(self, tmp_path: Path) -> None:
        """Each gets the next number, a code of its own, and the trials of the list; nothing that
        the participant's files say names a condition (HRI-04, HRI-05, O-43)."""
        (tmp_path / "study.toml").write_text(STUDY)
        folder = StudyFolder(tmp_path)
        first, second = folder.admit("2026-01-15"), folder.admit("2026-01-15")
        assert (first.number, second.number) == (1, 2)
        assert first.code != second.code
        assert StudyFolder(tmp_path).participants() == (first, second)
        assert folder.orders[2] == folder.study.allocation.order(2)
        folder.new_trial(first.code, 1)
        for path in (tmp_path / "participants").rglob("*"):
            text = path.name + (path.read_text() if path.is_file() else "")
            assert "keyboard" not in text
            assert "gamepad" not in text

    def test_repeated_trial(self, tmp_path: Path) -> None:
        """The last attempt counts and is flagged; one that was cut off is missing (O-45)."""
        (tmp_path / "study.toml").write_text(STUDY)
        folder = StudyFolder(tmp_path)
        code = folder.admit("2026-01-15").code
        minute().write(folder.new_trial(code, 1))
        again = folder.new_trial(code, 1)
        minute().write(again)
        folder.close_trial(again, "complete")
        minute().write(folder.new_trial(code, 2))  # still running when the program died
        first, second = collect(folder).trials
        assert (first.attempt, first.status, first.values["dwell"]) == (2, "complete", 20.0)
        assert (second.status, second.reason) == ("aborted", "cut off")
        assert set(second.values.values()) == {None}

    def test_kept_values(self, tmp_path: Path) -> None:
        """Values are computed again when the log has grown, and not otherwise."""
        minute().write(tmp_path)
        values, forms, inferred = values_of(tmp_path)
        kept = tmp_path / "measures.json"
        written = kept.read_bytes()
        assert values_of(tmp_path) == (values, forms, inferred)
        kept.write_bytes(written.replace(b'"dwell","team","",20.0', b'"dwell","team","",21.0'))
        assert next(v.value for v in values_of(tmp_path)[0] if v.measure == "dwell") == 21.0
        with (tmp_path / "events.jsonl").open("a") as file:
            file.write('{"seq": 100000, "t_sim": 80.0, "kind": "error", "text": ""}\n')
        assert values_of(tmp_path)[0] == values


class TestExport:
    """Tidy CSV (HRI-15, HRI-11)."""

    def test_round_trip(self, dataset: Dataset, tmp_path: Path) -> None:
        """What is read is what was written (HRI-15)."""
        tables.write(dataset, tmp_path)
        assert tables.read(tmp_path) == dataset

    @pytest.mark.parametrize(("delimiter", "point"), [(";", ","), ("\t", ",")])
    def test_tables_that_a_spreadsheet_saved(
        self, dataset: Dataset, tmp_path: Path, delimiter: str, point: str
    ) -> None:
        """Other separators, a comma for a point and a byte order mark change nothing."""
        tables.write(dataset, tmp_path)
        for name in ("participants", "trials", "parts", "answers"):
            path = tmp_path / f"{name}.csv"
            with path.open(newline="") as file:
                rows = list(csv.reader(file))
            with path.open("w", newline="", encoding="utf-8-sig") as file:
                writer = csv.writer(file, delimiter=delimiter)
                for row in rows:
                    writer.writerow(
                        [re.sub(r"^(-?\d+)\.(\d+)$", rf"\1{point}\2", cell) for cell in row]
                    )
        assert tables.read(tmp_path) == dataset

    def test_tables_of_an_earlier_version(self, dataset: Dataset, tmp_path: Path) -> None:
        """They do not say who was scripted or what was inferred: people, and not known."""
        tables.write(dataset, tmp_path)
        for name in ("participants", "trials"):
            path = tmp_path / f"{name}.csv"
            with path.open(newline="") as file:
                rows = list(csv.DictReader(file))
            with path.open("w", newline="") as file:
                new = ("scripted", "inferred_stops")
                kept = [key for key in rows[0] if key not in new]
                writer = csv.DictWriter(file, kept, extrasaction="ignore")
                writer.writeheader()
                writer.writerows(rows)
        found = tables.read(tmp_path)
        assert found.participants == dataset.participants
        assert {one.inferred_stops for one in found.trials} == {None}
        assert [one.values for one in found.trials] == [one.values for one in dataset.trials]

    def test_missing_is_empty(self, dataset: Dataset, tmp_path: Path) -> None:
        """An aborted trial, an excluded participant and a skipped item are empty cells, not 0."""
        tables.write(dataset, tmp_path)
        with (tmp_path / "trials.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        states = [row["status"] for row in rows]
        assert (states.count("aborted"), states.count("missing")) == (1, 2)
        for row in rows:
            if row["status"] != "complete":
                assert {row[name] for name in MEASURES} == {""}
        skipped = [row for row in rows if row["tlx_mental"] and not row["tlx_raw"]]
        assert len(skipped) == 1

    def test_dictionary_and_schema(self, dataset: Dataset, tmp_path: Path) -> None:
        """Every column has type and meaning, every measure its unit; the schema says the same."""
        tables.write(dataset, tmp_path)
        with (tmp_path / "dictionary.csv").open(newline="") as file:
            told = {(row["table"], row["column"]): row for row in csv.DictReader(file)}
        package = json.loads((tmp_path / "datapackage.json").read_text())
        for resource in package["resources"]:
            with (tmp_path / resource["path"]).open(newline="") as file:
                heads = next(csv.reader(file))
            assert heads == [one["name"] for one in resource["schema"]["fields"]]
            assert all(told[resource["name"], head]["meaning"] for head in heads)
        assert all(told["trials", name]["unit"] == one.unit for name, one in MEASURES.items())

    def test_nothing_typed_leaves(self, tmp_path: Path) -> None:
        """Free text and operators' names stay in the folder (HRI-16)."""
        item = '[[form.item]]\nname = "note"\ntext = "Anything?"\nkind = "text"\n\n'
        text = STUDY.replace("[[form.item]]\n", item + "[[form.item]]\n", 1)
        (tmp_path / "study.toml").write_text(text)
        folder = StudyFolder(tmp_path)
        code = folder.admit("2026-01-15").code
        state = FormState(folder.study.forms("before")[0])
        state.answer("note", "My name is Zaphod", 3.0)
        state.answer("games", 5, 4.0)
        append_form(folder.place(code) / FORMS, [state.as_json()])
        run = folder.new_trial(code, 1)
        minute().write(run)
        folder.close_trial(run, "complete")
        assert cli.main(["study", "export", str(tmp_path)]) == 0
        everything = b"".join(path.read_bytes() for path in (tmp_path / "data").iterdir())
        assert b"Zaphod" not in everything
        assert b"Ada" not in everything
        assert b",games,5," in everything
        assert b"operator 1" in everything
        assert (tmp_path / "summary.csv").exists()

    @pytest.mark.parametrize(
        ("old", "new"),
        [("keyboard", "keybord"), ("victims_found", "victims_lost"), (",1,1,", ",1,one,")],
    )
    def test_damaged_tables(self, dataset: Dataset, tmp_path: Path, old: str, new: str) -> None:
        """One error that names the file."""
        tables.write(dataset, tmp_path)
        path = tmp_path / "trials.csv"
        path.write_text(path.read_text().replace(old, new, 1))
        with pytest.raises(StudyError, match=r"trials\.csv"):
            tables.read(tmp_path)


class TestScripted:
    """Participants made by code are told from people wherever a reader may look."""

    def test_file_table_and_report(self, tmp_path: Path) -> None:
        """A field, a column, and a warning before all else; a file of before it means a person."""
        pytest.importorskip("scipy")
        folder = make_study(tmp_path, Plan(4))
        text = "made by code"
        codes = [one.code for one in folder.participants()]
        for code in codes:
            path = folder.place(code) / "participant.json"
            told = json.loads(path.read_text())
            assert told.pop("scripted") is False
            path.write_text(json.dumps(told))
        assert cli.main(["study", "report", str(tmp_path)]) == 0
        assert text not in (tmp_path / "report.html").read_text()
        for one in folder.participants()[:2]:
            folder.store(replace(one, scripted=True))
        assert cli.main(["study", "report", str(tmp_path)]) == 0
        first = (tmp_path / "report.md").read_text().split("\n\n")[1]
        told = f"Partly scripted: 2 of 4 participants were made by code ({codes[0]}, {codes[1]})."
        assert first.startswith(told)
        for one in folder.participants():
            folder.store(replace(one, scripted=True))
        assert cli.main(["study", "report", str(tmp_path)]) == 0
        first = (tmp_path / "report.md").read_text().split("\n\n")[1]
        assert first.startswith("Scripted: 4 participants made by code, no people.")
        assert "Scripted: 4" in (tmp_path / "report.html").read_text().partition("</h1>")[2][:100]
        for name in ("data/participants.csv", "data/trials.csv", "summary.csv"):
            with (tmp_path / name).open(newline="") as file:
                assert {row["scripted"] for row in csv.DictReader(file)} == {"1"}, name
        with (tmp_path / "results.csv").open(newline="") as file:
            assert {row["n_scripted"] for row in csv.DictReader(file)} == {"4"}

    def test_neither_goes_on_with_the_other(self, tmp_path: Path) -> None:
        """A script leaves a person's session alone that was cut off, and the other way round."""
        (tmp_path / "study.toml").write_text(STUDY)
        folder = StudyFolder(tmp_path)
        person, made = folder.admit("2026-01-15"), folder.admit("2026-01-15", scripted=True)
        for one in (person, made):
            with next_participant(folder, scripted=one.scripted) as found:
                assert found == one
        with (
            pytest.raises(StudyError, match=f"participant {made.code} is made by code"),
            next_participant(folder, made.code),
        ):
            pass


class Killed(BaseException):
    """The process ends here."""


def cut_off(patch: pytest.MonkeyPatch, steps: int) -> None:
    """End the process at the call after so many that change files."""
    left = steps

    def counted(call: Callable[..., object]) -> Callable[..., object]:
        def instead(*args: object, **named: object) -> object:
            nonlocal left
            if left == 0:
                raise Killed
            left -= 1
            return call(*args, **named)

        return instead

    for name in ("unlink", "rmdir", "replace", "rename"):
        patch.setattr(os, name, counted(getattr(os, name)))
    for name in ("touch", "write_bytes", "unlink", "rmdir"):
        patch.setattr(Path, name, counted(getattr(Path, name)))


class TestPrivacy:
    """HRI-16."""

    def test_forget(self, tmp_path: Path) -> None:
        """Nothing of the participant is left anywhere, the number is not given out again, and the
        others' tables still stand (HRI-16)."""
        folder = make_study(tmp_path, Plan(4))
        code = folder.participants()[1].code
        assert cli.main(["study", "export", str(tmp_path)]) == 0
        assert cli.main(["study", "forget", str(tmp_path), code]) == 0
        for path in tmp_path.rglob("*"):
            assert code not in path.name
            assert not path.is_file() or code.encode() not in path.read_bytes()
        assert len(tables.read(tmp_path / "data").participants) == 3
        assert StudyFolder(tmp_path).admit("2026-01-16").number == 5
        assert cli.main(["study", "forget", str(tmp_path), code]) == 2

    def test_forget_is_finished_by_another(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Cut off before any of its changes of files, it leaves the participant to be named again;
        then nothing is left, and the others are exported."""
        folder = make_study(tmp_path / "whole", Plan(4))
        code = folder.participants()[1].code
        assert cli.main(["study", "export", str(folder.path)]) == 0
        assert cli.main(["study", "report", str(folder.path)]) == 0
        steps = 0
        while True:
            path = tmp_path / f"cut-{steps}"
            shutil.copytree(folder.path, path)
            with monkeypatch.context() as patch:
                cut_off(patch, steps)
                try:
                    assert cli.main(["study", "forget", str(path), code]) == 0
                    break
                except Killed:
                    pass
            assert cli.main(["study", "forget", str(path), code]) == 0, f"after step {steps}"
            for one in path.rglob("*"):
                assert code not in one.name
                assert not one.is_file() or code.encode() not in one.read_bytes()
            assert len(tables.read(path / "data").participants) == 3
            steps += 1
        assert steps > 20

    def test_others_of_the_machine_read_nothing(self, tmp_path: Path) -> None:
        """Folders of participants have mode 0700, what is known of them 0600."""
        folder = make_study(tmp_path, Plan(4))
        assert cli.main(["study", "export", str(tmp_path)]) == 0
        for one in folder.participants():
            place = folder.place(one.code)
            assert place.stat().st_mode & 0o777 == 0o700
            for name in ("participant.json", "forms.jsonl"):
                assert (place / name).stat().st_mode & 0o777 == 0o600
        for name in ("allocation.csv", "data/answers.csv", "data/participants.csv", "summary.csv"):
            assert (tmp_path / name).stat().st_mode & 0o777 == 0o600

    def test_no_clock_and_no_machine(self, made: StudyFolder) -> None:
        """No file holds a time of day, an address or a host's name."""
        for path in made.path.rglob("*"):
            text = path.read_text() if path.is_file() else ""
            assert not re.search(r"\d\d:\d\d:\d\d|\d+\.\d+\.\d+\.\d+|localhost|Mozilla", text), path


def test_what_is_nested_too_deeply_is_no_record(tmp_path: Path) -> None:
    """A line of brackets in a log is one clear error, not a defect."""
    path = tmp_path / "events.jsonl"
    path.write_text("[" * 100_000 + "\n")
    with pytest.raises(StudyError, match="line 1: is no JSON object"):
        list(read_lines(path))
    assert last_line(path) is None
