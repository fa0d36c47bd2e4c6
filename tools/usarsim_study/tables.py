"""Writes a study's numbers as tidy CSV with a dictionary of all columns, and reads them back.

One row per participant, trial, part of a trial, answer; UTF-8, comma, a header, missing values
empty, numbers with a point: opens in R and pandas without options. `datapackage.json` has the
schema (Frictionless Tabular Data Package, https://specs.frictionlessdata.io), `dictionary.csv` the
same for people. Nothing is lost: what is read is what was written.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from usarsim_server.base.csv_files import Cellular, csv_text, read_csv
from usarsim_server.base.errors import at
from usarsim_server.base.files import write_text
from usarsim_server.base.toml import read_text
from usarsim_server.protocol.json_text import parse_json
from usarsim_study.dataset import (
    AnswerRow,
    Dataset,
    ParticipantRow,
    PartRow,
    TrialRow,
    misread_words,
)
from usarsim_study.errors import StudyError
from usarsim_study.measures import MEASURES
from usarsim_study.misread import CURE

PACKAGE = "datapackage.json"
DICTIONARY = "dictionary.csv"
SUMMARY = "summary.csv"

Type = Literal["string", "integer", "number"]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table. earlier: its cells in tables of versions that did not write it."""

    name: str
    type: Type
    meaning: str
    unit: str = ""
    source: str = ""
    earlier: str | None = None


_CODE = Column("participant", "string", "random code of the participant")
_SCRIPTED = Column(
    "scripted",
    "integer",
    "1: made by code (study run --scripted), no person; 0: a person, or from before this was told",
    earlier="0",
)
_INFERRED = Column(
    "inferred_stops",
    "number",
    "how often an operator let go and the log, of an earlier version, has no command of it: "
    "teleoperation_share, teleoperations, interaction_time, neglect_time, attention_demand and "
    "fan_out then go by what the operator's page said; empty: no log, or not known",
    earlier="",
)
_TRIAL = Column("trial", "integer", "position of the trial, from 1; 0: before or after all")

TABLES: dict[str, tuple[Column, ...]] = {
    "participants": (
        _CODE,
        Column("number", "integer", "position in the list of assignments, from 1"),
        Column("sequence", "integer", "sequence of trials, from 1"),
        Column("day", "string", "of the session, YYYY-MM-DD"),
        Column("status", "string", "complete, running, withdrawn or excluded"),
        Column("reason", "string", "why it is not complete"),
        _SCRIPTED,
    ),
    "trials": (
        _CODE,
        _TRIAL,
        Column("attempt", "integer", "which attempt this is; more than 1: repeated; 0: none"),
        Column("condition", "string", "what was compared"),
        Column("layout", "string", "where"),
        Column("status", "string", "complete, aborted, void or missing"),
        Column("reason", "string", "why it is not complete, or ended before its time"),
        _SCRIPTED,
        _INFERRED,
        *(
            Column(one.name, "number", f"{one.title}: {one.definition}", one.unit, one.source)
            for one in MEASURES.values()
        ),
    ),
    "parts": (
        _CODE,
        _TRIAL,
        Column("level", "string", "operator or robot"),
        Column("who", "string", "number of the operator, name of the robot"),
        Column("measure", "string", "a column of trials"),
        Column("value", "number", "in the unit of that column"),
    ),
    "answers": (
        _CODE,
        _TRIAL,
        Column("form", "string", "name of the form"),
        Column("form_kind", "string", "its kind"),
        Column("item", "string", "name of the item"),
        Column("answer", "string", "what was answered; what was typed is left out"),
        Column("number", "number", "the same, if it is a number"),
        Column("time", "number", "since the form was shown", "s"),
    ),
}
"""Columns of each file."""


def write(dataset: Dataset, folder: Path) -> list[Path]:
    """Write all files of a data set into a folder.

    Returns:
        The files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows: dict[str, Iterable[Sequence[Cellular]]] = {
        "participants": (_plain(one) for one in dataset.participants),
        "trials": (
            [
                one.values.get(column.name)
                if column.name in MEASURES
                else getattr(one, column.name)
                for column in TABLES["trials"]
            ]
            for one in dataset.trials
        ),
        "parts": (_plain(one) for one in dataset.parts),
        "answers": (_plain(one) for one in dataset.answers),
    }
    written = []
    for name, columns in TABLES.items():
        path = folder / f"{name}.csv"
        write_text(path, csv_text([one.name for one in columns], rows[name]), private=True)
        written.append(path)
    misread = misread_words(dataset)
    known = [
        (table, one.name, one.type, one.unit, _meaning(one, misread), one.source)
        for table, columns in TABLES.items()
        for one in columns
    ]
    heads = ("table", "column", "type", "unit", "meaning", "source")
    write_text(folder / DICTIONARY, csv_text(heads, known))
    text = json.dumps(_package(dataset), indent=1, ensure_ascii=False)
    write_text(folder / PACKAGE, text + "\n")
    return [*written, folder / DICTIONARY, folder / PACKAGE]


def read(folder: Path) -> Dataset:
    """Read the files that `write` wrote.

    Raises:
        StudyError: one is missing or has other columns or values.
    """
    try:
        package = parse_json(read_text(folder / PACKAGE, StudyError))
        about = package["study"]
        known = [one["name"] for one in about["conditions"]]
    except (ValueError, KeyError, TypeError):
        raise StudyError(f"{folder / PACKAGE}: is no data of a study (export it again)") from None
    trials = []
    for row in _rows(folder, "trials"):
        if row["condition"] not in known:
            text = f"unknown condition {row['condition']!r} (mend it)"
            raise StudyError(f"{folder / 'trials.csv'}: {text}")
        values = {name: row.pop(name) for name in MEASURES}
        trials.append(TrialRow(**row, values=values))  # type: ignore[arg-type]
    return Dataset(
        about,
        tuple(ParticipantRow(**row) for row in _rows(folder, "participants")),  # type: ignore[arg-type]
        tuple(trials),
        tuple(PartRow(**row) for row in _rows(folder, "parts")),  # type: ignore[arg-type]
        tuple(AnswerRow(**row) for row in _rows(folder, "answers")),  # type: ignore[arg-type]
    )


def _plain(row: Any) -> list[Cellular]:
    return [getattr(row, one.name) for one in fields(row)]


def _rows(folder: Path, table: str) -> list[dict[str, Cellular]]:
    path = folder / f"{table}.csv"
    cure = "mend or export it again"
    found = read_csv(path, StudyError, cure)
    there = [one for one in TABLES[table] if one.earlier is None or one.name in found.heads]
    columns = {one.name: one.type for one in there}
    earlier = {one.name: one.earlier or "" for one in TABLES[table]}
    lacking = {one.name: one.type for one in TABLES[table] if one.name not in columns}
    if list(found.heads) != list(columns):
        raise StudyError(at(path, f"has other columns than {DICTIONARY} says", "export it again"))
    readers: dict[Type, Callable[[str], Cellular]] = {
        "string": str,
        "integer": int,
        "number": lambda text: found.number(text) if text else None,
    }
    rows = []
    for line, cells in found.rows:
        rows.append(row := dict[str, Cellular]())
        for name, kind in columns.items():
            try:
                row[name] = readers[kind](cells[name] or earlier[name])
            except ValueError:
                problem, where = f"{cells[name]!r} is no {kind}", f"line {line}: {name}"
                raise StudyError(at(path, problem, cure, where=where)) from None
        row.update({name: readers[kind](earlier[name]) for name, kind in lacking.items()})
    return rows


def _meaning(column: Column, misread: dict[str, tuple[str, ...]]) -> str:
    """What a column means, and which of its words programs read as missing."""
    words = misread.get(column.name)
    if not words:
        return column.meaning
    return f"{column.meaning}; WARNING: pandas reads {', '.join(words)} as missing ({CURE})"


def _package(dataset: Dataset) -> dict[str, Any]:
    """The schema of all tables, and what the study is."""
    misread = misread_words(dataset)
    return {
        "profile": "tabular-data-package",
        "name": "study",
        "title": dataset.about["title"],
        "study": dataset.about,
        "resources": [
            {
                "profile": "tabular-data-resource",
                "name": name,
                "path": f"{name}.csv",
                "encoding": "utf-8",
                "schema": {
                    "fields": [
                        {
                            "name": one.name,
                            "type": one.type,
                            "description": _meaning(one, misread),
                            **({"unit": one.unit} if one.unit else {}),
                        }
                        for one in columns
                    ],
                    "missingValues": [""],
                },
            }
            for name, columns in TABLES.items()
        ],
    }
