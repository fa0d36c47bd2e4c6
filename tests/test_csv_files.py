"""Tables in CSV: what spreadsheets make of them is read; what begins as a formula is text."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from usarsim_server.base import csv_files
from usarsim_server.base.csv_files import csv_text, parse_csv, read_csv
from usarsim_server.base.errors import UsarsimError

SAVED = {
    "ours": b'name,length,note\nred,0.5,"a;b"\nblue,-12,\n',
    "with a mark": b'\xef\xbb\xbfname,length,note\r\nred,0.5,"a;b"\r\nblue,-12,\r\n',
    "semicolons": b'name;length;note\r\nred;0,5;"a;b"\r\nblue;-12;\r\n',
    "with a mark and semicolons": b'\xef\xbb\xbfname;length;note\r\nred;0,5;"a;b"\r\nblue;-12;\r\n',
    "tabs": b"name\tlength\tnote\nred\t0,5\ta;b\nblue\t-12\t\n\n",
    "told": b"sep=;\r\nname;length;note\r\nred;0.5;'a;b'\r\n".replace(b"'", b'"')
    + b"blue;-12;\r\n",
    "old line ends": b"name,length,note\rred,0.5,a;b\rblue,-12,\r",
}


@pytest.mark.parametrize("how", SAVED)
def test_what_spreadsheets_save_is_read(how: str, tmp_path: Path) -> None:
    """The same table, whatever stands between cells, in numbers and before the header."""
    path = tmp_path / "table.csv"
    path.write_bytes(SAVED[how])
    sheet = read_csv(path, UsarsimError, "mend it")
    assert sheet.heads == ("name", "length", "note")
    rows = [(row["name"], sheet.number(row["length"]), row["note"]) for _, row in sheet.rows]
    assert rows == [("red", 0.5, "a;b"), ("blue", -12.0, "")]
    assert [line for line, _ in sheet.rows] == ([3, 4] if how == "told" else [2, 3])


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"a,b\n1,2,3\n", "line 2: 3 cells, not 2 as in the header (mend it)"),
        (b'a,b\n"1,2\n', "line 2: is no CSV: unexpected end of data (mend it)"),
        (b"a,b\n1,gr\xfcn\n", "line 2: byte 0xFC is not UTF-8 (save the file as UTF-8)"),
        ("a\tb\n1\t2\n".encode("utf-16"), "is in UTF-16 (save the file as UTF-8)"),
    ],
)
def test_what_is_no_table_is_one_error(data: bytes, told: str, tmp_path: Path) -> None:
    """File, line and cure."""
    path = tmp_path / "table.csv"
    path.write_bytes(data)
    with pytest.raises(UsarsimError) as caught:
        read_csv(path, UsarsimError, "mend it")
    assert str(caught.value) == f"{path}: {told}"


def test_a_comma_in_a_number_needs_another_separator() -> None:
    """`1,234` in a table with commas may be a thousand: it is no number there."""
    sheet = parse_csv('a\n"1,234"\n', "t.csv", UsarsimError, "mend it")
    with pytest.raises(ValueError, match="1,234"):
        sheet.number(sheet.rows[0][1]["a"])


@pytest.mark.parametrize("text", ["=1+1", "+cmd", "-x", "@sum", "\tx", "\rx", "\nx", "'=1", "＝1"])
def test_no_cell_is_a_formula(text: str) -> None:
    """Text that begins as a formula is written behind an apostrophe, and read as it was."""
    written = csv_text(["name", "value"], [[text, 1]])
    [_, (cell, _)] = csv.reader(io.StringIO(written, newline=""))
    text = text.replace("\r", "\n")
    assert cell == f"'{text}"
    [(_, row)] = parse_csv(written, "t.csv", UsarsimError, "").rows
    assert row["name"] == text


@pytest.mark.parametrize("cell", [-1.5, -3, 0, "-1.5", "+2", "-inf", "1e-9", "", None])
def test_numbers_stay_numbers(cell: object) -> None:
    """Numbers are written as they are, in texts, too."""
    assert (
        csv_text(["value", "other"], [[cell, 1]])
        == f"value,other\n{'' if cell is None else cell},1\n"
    )


@given(
    st.lists(
        st.text(st.characters(exclude_characters="\r\0", exclude_categories=["Cs"]), min_size=1)
    )
)
def test_texts_come_back(texts: list[str]) -> None:
    """All that is written is read again."""
    written = csv_text(["name", "number"], [[text, 1] for text in texts])
    sheet = parse_csv(written, "t.csv", UsarsimError, "")
    assert [row["name"] for _, row in sheet.rows] == texts


def test_tables_are_written_in_one_place() -> None:
    """No module has a writer of its own, which would let formulas through."""
    root = Path(csv_files.__file__).parents[2]
    files = [*root.glob("usarsim_server/**/*.py"), *root.glob("tools/**/*.py")]
    found = [one for one in files if re.search(r"csv\.(w|DictW)riter\(", one.read_text("utf-8"))]
    assert [one.name for one in found] == ["csv_files.py"]
