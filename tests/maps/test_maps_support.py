"""docs/import.md says of each element of a format what its reader's table says."""

from __future__ import annotations

import re
from pathlib import Path

from usarsim_maps.reader import readers
from usarsim_maps.support import Support

PAGE = Path(__file__).parents[2] / "docs" / "import.md"
COLUMNS = [support.value for support in Support]


def page_rows() -> dict[str, dict[str, set[str]]]:
    """Names in backticks by list and column of the page's table "What of each format is read"."""
    section = PAGE.read_text(encoding="utf-8").partition("\n## What of each format is read\n")[2]
    lines = [line for line in section.partition("\n## ")[0].splitlines() if line.startswith("|")]
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert head[1:] == COLUMNS
    return {
        row[0]: {
            column: set(re.findall(r"`([^`]+)`", cell))
            for column, cell in zip(COLUMNS, row[1:], strict=True)
        }
        for row in rows
    }


def test_page_and_readers_have_the_same_tables() -> None:
    """Every list of every reader stands on the page, with the same names in the same columns."""
    declared = {
        title: {
            support.value: {name for name, what in table.items() if what is support}
            for support in Support
        }
        for reader in readers().values()
        for title, table in reader.support.items()
    }
    assert page_rows() == declared
